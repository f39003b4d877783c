"""Tactile pads, guarded lines that end when a pad feels, tactile images."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "guarded_motion": ["guarded_line"],
    "line_touch": ["LineMove", "LineTouch", "LineTruth", "Until", "check_rows"],
    "pad": ["read_pads"],
    "tactile_image": ["Lines", "Moments", "hough_lines", "laplacian_of_gaussian", "mean_filter",
        "median_filter", "moments", "sobel", "sobel_edges", "zero_crossings"],
})
