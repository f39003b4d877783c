"""Pieces of the report's markup. Every text is escaped here, and nowhere else."""

import base64
import hashlib
import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Any


def page(title: str, body: str, data: dict[str, Any], scripts: Sequence[str],
         data_id: str = "episodes") -> bytes:
    """A whole page that may load nothing, run only its own scripts, and talk to nobody."""
    style = asset("style.css")
    code = [asset(name) for name in scripts]
    policy = ("default-src 'none'; base-uri 'none'; form-action 'none'; "
              f"style-src {source_hash(style)}; "
              f"script-src {' '.join(source_hash(text) for text in code)}")
    plain = json.dumps(data, separators=(",", ":"), sort_keys=True).replace("<", "\\u003c")
    return "".join([
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>\n", body,
        f'<script type="application/json" id="{data_id}">{plain}</script>\n',
        *(f"<script>{text}</script>\n" for text in code), "</body></html>\n"]).encode()


def asset(name: str) -> str:
    """A file of the page, as text."""
    return (files("sweeps.report") / "assets" / name).read_text(encoding="utf-8")


def source_hash(text: str) -> str:
    """How a content security policy names an inline style or script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def section(title: str, *parts: str, name: str = "") -> str:
    """A section under a heading."""
    place = f' id="{escape(name)}"' if name else ""
    return f"<section{place}><h2>{escape(title)}</h2>{''.join(parts)}</section>\n"


def paragraph(text: str, kind: str = "soft") -> str:
    """A paragraph of text."""
    return f'<p class="{kind}">{escape(text)}</p>'


def listed(items: Iterable[str], kind: str) -> str:
    """A list of texts."""
    return f'<ul class="{kind}">{"".join(f"<li>{escape(item)}</li>" for item in items)}</ul>'


def table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], *,
          row_names: int = 0, pictures: dict[int, Sequence[str]] | None = None,
          heat: Sequence[Sequence[str]] | None = None, sortable: bool = True) -> str:
    """A table; column `row_names` names the rows, `pictures` are columns of markup at the end."""
    every = list(rows)
    words = [n == row_names or not all(_is_number(row[n]) for row in every)
             for n in range(len(header))]
    head = "".join(f'<th scope="col"{_left(left)}>{escape(name)}</th>'
                   for left, name in zip(words, header, strict=True))
    body = []
    for r, row in enumerate(every):
        cells = []
        for n, cell in enumerate(row):
            if pictures and n in pictures:
                cells.append(f'<td data-value="{escape(cell)}">{pictures[n][r]}</td>')
            elif n == row_names:
                cells.append(f'<th scope="row">{escape(cell)}</th>')
            else:
                tint = f' class="{heat[r][n]}"' if heat and heat[r][n] else _left(words[n])
                cells.append(f"<td{tint}>{escape(cell)}</td>")
        body.append(f"<tr>{''.join(cells)}</tr>")
    kind = ' class="sortable"' if sortable else ""
    return (f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
            f"<table{kind}><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{''.join(body)}</tbody></table></div>")


def _left(left: bool) -> str:
    return ' class="text"' if left else ""


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell in ("", "NA")
    return True


def details(summary: str, inner: str, opened: bool = False) -> str:
    """A part that opens at a click."""
    return (f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{inner}"
            "</details>")


def drawing(markup: str, caption: str) -> str:
    """A figure with its caption."""
    return f"<figure>{markup}<figcaption>{escape(caption)}</figcaption></figure>"


def preformatted(text: str) -> str:
    """Text as it stands."""
    return f'<pre tabindex="0">{escape(text)}</pre>'
