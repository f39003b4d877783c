"""Text that came from a user, made safe for where it is shown."""

import unicodedata
from collections.abc import Sequence

_CONTROLS = {"Cc", "Cf", "Cs", "Co", "Zl", "Zp"}
"""Unicode categories that draw nothing, or change how the text around them is drawn."""
_FORMULA = ("=", "+", "-", "@")


def printable(text: str) -> str:
    """A text for a terminal: control characters and marks of direction as escapes.

    Line ends and tabs stay: messages have lines of their own. A text without such characters comes
    back as it is.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        char if char in "\n\t" or unicodedata.category(char) not in _CONTROLS
        else char.encode("unicode_escape").decode() for char in text)


def on_one_line(text: str) -> str:
    """A `printable` text whose line ends and tabs are escapes too: a name, a path, a table's cell.
    """
    return printable(text).replace("\n", r"\n").replace("\t", r"\t")


def counted(count: int, name: str) -> str:
    """A number of things: "1 unit", "1,200 units"."""
    return f"{count:,} {name}{'s' * (count != 1)}"


def first_few(names: Sequence[str], most: int = 5) -> str:
    """Names for a message: the first ones, and how many more there are."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def csv_cell(text: str) -> str:
    """A cell that a spreadsheet takes for text: with an apostrophe before what begins a formula.

    Numbers stay as they are.
    """
    if not text.startswith(_FORMULA):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
