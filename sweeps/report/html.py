"""Elements of the report's markup; they escape every text that they are given."""

import base64
import hashlib
import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import matplotlib

from sweeps.figures.style import encode
from sweeps.text_table import is_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page(title: str, body: str, data: dict[str, Any], scripts: Sequence[str]) -> bytes:
    """A whole page. Its policy permits its own style and scripts only."""
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
        f'<script type="application/json" id="episodes">{plain}</script>\n',
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


def table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], *,
          row_names: int = 0, heat: Sequence[Sequence[str]] | None = None,
          sortable: bool = True) -> str:
    """A table; column `row_names` names the rows, `heat` gives the class of each cell's tint."""
    every = list(rows)
    kinds = [' class="text"' if n == row_names or not all(is_number(row[n]) for row in every)
             else "" for n in range(len(header))]
    # A heading may break after an underscore, so that it is no wider than its numbers.
    head = "".join(f'<th scope="col"{kind}>{escape(name).replace("_", "_<wbr>")}</th>'
                   for kind, name in zip(kinds, header, strict=True))
    body = []
    for r, row in enumerate(every):
        cells = []
        for n, cell in enumerate(row):
            if n == row_names:
                cells.append(f'<th scope="row">{escape(cell)}</th>')
            else:
                tint = f' class="{heat[r][n]}"' if heat and heat[r][n] else kinds[n]
                cells.append(f"<td{tint}>{escape(cell)}</td>")
        body.append(f"<tr>{''.join(cells)}</tr>")
    sorts = ' class="sortable"' if sortable else ""
    return (f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
            f"<table{sorts}><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{''.join(body)}</tbody></table></div>")


def details(summary: str, inner: str, opened: bool = False) -> str:
    """A part that a click opens or closes."""
    return (f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{inner}"
            "</details>")


def drawing(drawn: "Figure", name: str, title: str, caption: str) -> str:
    """A matplotlib figure as inline SVG with a caption; `name` makes its ids unique in the page.

    Styles become presentation attributes, since the page's policy forbids style attributes.
    """
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        root = ElementTree.fromstring(encode(drawn, "svg"))
    for node in root.iter():
        node.tag = _local(node.tag)
        given = {_local(key): " ".join(value.split()) for key, value in node.attrib.items()}
        styles = given.pop("style", "").split("; ")
        given |= dict(style.split(": ", 1) for style in styles if style)
        given.pop("font-family", "")  # the style sheet's
        node.attrib = {key: _own(key, value, name) for key, value in given.items()}
        for child in [child for child in node if _local(child.tag) in ("metadata", "style")]:
            node.remove(child)
        node.tail = None
    root.attrib = {"class": "chart", "role": "img", "aria-label": title,
                   "viewBox": root.attrib["viewBox"]}
    for tag, text in (("desc", caption), ("title", title)):
        first = ElementTree.Element(tag)
        first.text = text
        root.insert(0, first)
    svg = ElementTree.tostring(root, encoding="unicode")
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def _local(name: str) -> str:
    """A name without its XML namespace."""
    return name.rpartition("}")[2]


def _own(key: str, value: str, name: str) -> str:
    """An attribute's value, with the ids of the page in it."""
    if key == "id":
        return f"{name}-{value}"
    if key == "href" and value.startswith("#"):
        return f"#{name}-{value[1:]}"
    return value.replace("url(#", f"url(#{name}-")


def preformatted(text: str) -> str:
    """Text with its own line breaks and spaces."""
    return f'<pre tabindex="0">{escape(text)}</pre>'
