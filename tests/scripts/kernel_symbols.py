"""The names of functions in kernels that are loaded, for `perf report`.

Warp's compiled kernels have no symbols that a profiler of the system sees. In a process that has
launched what is to be looked at, call `write_symbols()`, then record the process:

    perf record -e cpu-clock -F 4000 -p PID
    perf report --sort symbol
"""

import os
import subprocess
import sys
from pathlib import Path

import warp as wp


def write_symbols() -> Path:
    """The file in which `perf` looks for the names of this process's functions."""
    file = Path(f"/tmp/perf-{os.getpid()}.map")
    runtime = wp._src.context.runtime
    with file.open("w") as lines:
        for module in wp._src.context.user_modules.values():
            for loaded in module.execs.values():
                symbols = _functions(str(loaded.binary_path))
                entry = next((name for name in symbols if name.endswith("_cpu_forward")), None)
                if entry is None:
                    continue
                at = runtime.llvm.wp_lookup(loaded.handle.encode(), entry.encode())
                for name, (begin, size) in symbols.items():
                    lines.write(f"{at + begin - symbols[entry][0]:x} {size:x} {name}\n")
    return file


def _functions(compiled: str) -> dict[str, tuple[int, int]]:
    """Where functions of an object file begin, and how long they are."""
    listed = subprocess.run(["nm", "-S", "--defined-only", compiled], check=True, text=True,
                            capture_output=True).stdout
    rows = (line.split() for line in listed.splitlines())
    return {row[3]: (int(row[0], 16), int(row[1], 16))
            for row in rows if len(row) == 4 and row[2] in "tTwW"}


def main(arguments: list[str]) -> None:
    """Profile one row of the bench: its name, object and batch; prints the functions that take
    most."""
    from sweeps.bench.rows import ROWS
    from sweeps.output import init_warp
    from warpgrasp.core.kernel_launch import set_thread_count

    init_warp()
    set_thread_count(1)
    row, of, batch = arguments
    call = ROWS[row](of, int(batch)).call
    call()
    write_symbols()
    record = subprocess.Popen(["perf", "record", "-e", "cpu-clock", "-F", "4000", "-o",
                               "/tmp/perf.data", "-p", str(os.getpid())])
    for _ in range(200):
        call()
    record.send_signal(2)
    record.wait()
    subprocess.run(["perf", "report", "-i", "/tmp/perf.data", "--stdio", "--sort", "symbol",
                    "--percent-limit", "1"], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
