"""What README.md and the pages of docs ask a reader to type: commands, Python, specs; in order."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = re.compile(
    r"(?:\.venv/bin/)?(?:warpgrasp|make|python|pytest|pip)(?= )|source |sbatch |cp "
    r"|sweeps/bench/\S+\.sh|examples/\S+\.sh")
OUTPUT = re.compile(r"rank |spec \(TOML\)")  # indented blocks that a reader does not type
_FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"(?<=\n\n)(?:(?:    [^\n]*)?\n)*    [^\n]*(?=\n)")
_INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_COMMENT = re.compile(r"\s+#.*$")


@dataclass(frozen=True)
class Block:
    """Something to type. `kind`: shell (one command), script (a whole file), python or toml."""

    page: str
    line: int
    kind: str
    text: str
    inline: bool = False

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


@cache
def pages() -> tuple[Path, ...]:
    """README.md, then the pages in the order of the menu."""
    menu = re.search(r"```{toctree}\n(.*?)```", (ROOT / "docs/index.md").read_text(), re.DOTALL)
    assert menu
    names = [name for name in menu[1].split() if (ROOT / f"docs/{name}.md").exists()
             and not name.startswith("api/")]
    return ROOT / "README.md", *(ROOT / f"docs/{name}.md" for name in names)


@cache
def blocks() -> tuple[Block, ...]:
    """All of them, in the order in which a reader meets them."""
    return tuple(block for page in pages() for block in _blocks_of(page))


def commands() -> list[Block]:
    """The commands alone, each once."""
    return list({block.text: block for block in reversed(blocks())
                 if block.kind == "shell"}.values())[::-1]


def _blocks_of(page: Path) -> list[Block]:
    text, name = page.read_text(), str(page.relative_to(ROOT))
    found: list[Block] = []

    def take(match: re.Match[str], parts: Iterator[tuple[str, str]], inline: bool = False) -> str:
        line = text.count("\n", 0, match.start()) + 1
        found.extend(Block(name, line, kind, part, inline) for kind, part in parts)
        return re.sub(r"[^\n]", " ", match[0])  # places stay where they were

    rest = _FENCE.sub(lambda m: take(m, _fenced(m[1].strip(), m[2])), text)
    rest = _INDENTED.sub(lambda m: take(m, _indented(m[0])), rest)
    _INLINE.sub(lambda m: take(m, _inline(m[1]), True), rest)
    return sorted(found, key=lambda block: block.line)


def _fenced(language: str, body: str) -> Iterator[tuple[str, str]]:
    if language in ("python", "toml"):
        yield language, body
    elif body.startswith("#!"):
        yield "script", body
    elif language in ("bash", "sh"):
        yield from _lines(body)
    else:
        assert language in ("text", "{toctree}"), f"a fence of {language!r}: name its language"


def _indented(body: str) -> Iterator[tuple[str, str]]:
    body = re.sub(r"^    ", "", body, flags=re.MULTILINE)
    if not OUTPUT.match(body.strip()):
        yield from _lines(body)


def _lines(body: str) -> Iterator[tuple[str, str]]:
    for line in body.replace("\\\n", " ").splitlines():
        if command := _COMMENT.sub("", line).strip():
            assert PROGRAM.match(command), f"no command: {command}"
            yield "shell", command


def _inline(text: str) -> Iterator[tuple[str, str]]:
    if PROGRAM.match(text):
        yield "shell", text
