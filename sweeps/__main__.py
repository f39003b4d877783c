"""`warpgrasp` and `python -m sweeps`, apart from the commands, since workers import it again."""


def main() -> None:
    """The command line's entry point."""
    from sweeps.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
