"""`warpgrasp` and `python -m sweeps`, apart from the commands, since workers import it again."""

import sys


def main() -> None:
    """The command line's entry point."""
    if sys.platform == "win32":
        from sweeps.output import say

        say("warpgrasp: runs on Linux and macOS; on Windows use the Windows Subsystem for Linux "
            "(WSL)")
        sys.exit(2)
    from sweeps.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
