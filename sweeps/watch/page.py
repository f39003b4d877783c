"""The page of `warpgrasp watch`: an empty frame that its script fills from the state.

It is self-contained. Its policy permits its own style and script, and requests to where it came
from. Texts of a study reach it as JSON, and become text nodes.
"""

from functools import cache
from html import escape
from importlib.resources import files

from sweeps.figures.style import VERDICTS
from sweeps.report.html import asset, source_hash

FRAME = """\
<header><h1 id="name"></h1><p class="lead" id="headline">waiting for the first episodes</p>
<div class="bar" id="bar" role="progressbar" aria-label="share of the units that are done">\
<div></div></div><dl class="facts" id="facts"></dl></header>
<ul class="warnings" id="notes" hidden></ul>
<main>
<section id="board"><h2>Leaderboard</h2><p class="soft" id="about"></p>
<div class="scroll" tabindex="0" role="region" aria-label="leaderboard"><table>
<thead><tr id="head"></tr></thead><tbody id="rows"></tbody></table></div>
<p class="soft" id="more"></p></section>
<div class="pair">
<section id="survivors" hidden><h2>Survivors</h2><figure><svg class="plot" role="img"></svg>
<figcaption>Entries that took part in each rung, by the episodes of each object that they had \
after it.</figcaption></figure></section>
<section id="error" hidden><h2>Error against touches</h2><figure><svg class="plot" role="img"></svg>
<ul id="legend"></ul><figcaption></figcaption></figure></section>
</div>
<section id="failures"><h2>Failures</h2><p class="soft" id="nofailure"></p>
<div class="scroll"><table><tbody id="reasons"></tbody></table></div><ul id="units"></ul></section>
</main>
<footer class="soft"><span id="fresh"></span></footer>
<script>"""


def watch_page(name: str) -> bytes:
    """The whole page; `name` is its title until the state comes."""
    return "".join([
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(name)}: warpgrasp watch</title><style>{_style()}</style></head><body>\n",
        FRAME, _script(), "</script></body></html>\n"]).encode()


@cache
def content_policy() -> str:
    """What the page may do."""
    return ("default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
            f"connect-src 'self'; style-src {source_hash(_style())}; "
            f"script-src {source_hash(_script())}")


@cache
def _style() -> str:
    colours = " ".join(f"--{verdict}: {colour};" for verdict, colour in VERDICTS.items())
    return f"{asset('style.css')}:root {{ {colours} }}\n{_own('watch.css')}"


@cache
def _script() -> str:
    return _own("watch.js")


def _own(name: str) -> str:
    return (files("sweeps.watch") / "assets" / name).read_text(encoding="utf-8")
