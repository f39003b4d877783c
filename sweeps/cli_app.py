"""The command line's app, on which the files `cli_*.py` hang their commands."""

from typing import Annotated

from cyclopts import App, Parameter


def _version() -> str:
    from importlib.metadata import version  # heavy, and only --version needs it

    return version("warpgrasp")


app = App(name="warpgrasp", help="Batched simulation of robots that learn shape by touch. "
          "Every command takes --quiet: no progress and no notes.",
          version=_version, version_flags=["--version"], help_format="plaintext",
          suppress_keyboard_interrupt=False)

Json = Annotated[bool, Parameter(negative="")]
Settings = Annotated[list[str] | None, Parameter(name="--set", negative="")]


class UsageError(ValueError):
    """An argument that cannot be used."""
