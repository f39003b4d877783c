"""What may be wrong with a study's directory, apart from what reads it: commands without a study
need not wait for its imports."""

from pathlib import Path


class OtherStudy(ValueError):
    """The directory belongs to another spec; `lines` say where the two differ."""

    def __init__(self, folder: Path, lines: list[str]) -> None:
        self.lines = lines
        shown = [f"  {line}" for line in lines[:20]]
        more = [f"  ... {len(lines) - 20} more"] if len(lines) > 20 else []
        super().__init__("\n".join([
            f"{folder}: belongs to another spec; choose another directory, or undo:",
            *shown, *more]))


class StoreError(ValueError):
    """A directory that cannot be used; the message says why."""

    def __init__(self, message: str, exit_code: int = 2) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class Held(StoreError):
    """Another run holds the directory."""
