"""What kernels share: number types, launches, rows of structs, random numbers from counters."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "array_checks": ["check_array", "check_finite", "check_kind", "check_poses", "check_range"],
    "cache_file": ["cache_home", "cache_root", "drop_cached", "kernel_root", "read_cached",
        "write_cached"],
    "cores": ["core_count", "thread_count"],
    "dtypes": ["HALF", "ONE", "PI", "TINY", "TWO", "TWO_PI", "ZERO", "float32",
        "float32_vec3", "greater",
        "lesser", "mat32", "mat33", "mat34", "mat42", "mat44", "mat66",
        "mat76", "mat77", "quat", "real", "struct",
        "transform", "uint8", "vec2", "vec3", "vec4", "vec5", "vec6", "vec7"],
    "kernel_cache": ["check_kernels", "drop_kernels", "has_kernels", "place_kernels",
        "seal_kernels"],
    "kernel_launch": ["GPU_BLOCK", "ShapeError", "array_of", "check_device",
        "launch", "launch_in_turn", "poses_of", "set_thread_count"],
    "lanes": ["LANES", "has_lanes", "lanes_begin", "polynomial"],
    "plain_text": ["counted", "csv_cell", "first_few", "on_one_line", "printable"],
    "random": ["Purpose", "counter_key", "counter_normal", "counter_uniform", "normal_vector"],
    "turns": ["frame_axes", "sine_cosine"],
    "struct_array": ["Records", "record_type", "repeated"],
})
