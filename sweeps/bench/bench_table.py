"""The lines of a benchmark as Markdown: rates, scaling, peers with ratios, starts."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

Line = Mapping[str, Any]
PEERS = ("same_closing", "mujoco_rollout", "numba_closing", "jax_closing", "scipy_fits",
         "sklearn_free_forms", "trimesh_distances", "mujoco_scipy_episode")


def markdown(lines: Sequence[Line]) -> str:
    """The tables of one run."""
    head = next((v for v in lines if v["row"] == "environment"), {})
    if head.get("device", "cpu") != "cpu":
        return _on_device(head, lines)
    rates = [v for v in lines if v["row"] not in ("environment", "start", "study", *PEERS)]
    text = [f"Commit {str(head.get('commit'))[:10]}, {head.get('processor')}, "
            f"{head.get('cores')} cores, load {head.get('load')} at the start, "
            f"warp-lang {head.get('version.warp-lang')}, jax {head.get('version.jax')}, "
            f"Python {head.get('python')}. `a second of processor` is one core's rate whatever "
            "else the machine does.", ""]
    text += _table(
        ("what", "of", "batch", "threads", "a second", "a second of processor", "first call [s]",
         "peak [MiB]", "bytes each"),
        ((v["row"], v["of"], v["batch"], v["threads"], _rate(v, "per_s"), _rate(v, "per_cpu_s"),
          v.get("first_s", ""), v.get("peak_MiB", ""), v.get("bytes_per_episode", ""))
         for v in rates))
    peers = [v for v in lines if v["row"] in PEERS]
    if peers:
        text += ["", "Peers, same work, same run; the ratio is ours over theirs, by processor "
                 "time.", ""]
        text += _table(("peer", "setting", "a second", "a second of processor", "ratio", "notes"),
                       ((v["row"], v["of"], _rate(v, "per_s"), _rate(v, "per_cpu_s"),
                         _ratio(v, lines), _notes(v)) for v in peers))
    starts = [v for v in lines if v["row"] == "start"]
    if starts:
        text += [""]
        text += _table(("start", "s", "s of processor"),
                       ((v["of"], v["s"], v["cpu_s"]) for v in starts))
    studies = [v for v in lines if v["row"] == "study"]
    if studies:
        text += ["", "Whole studies, from the shell to the leaderboard; beside them an episode "
                 "without what the smallest study takes to start and to end.", ""]
        text += _table(("study of", "episodes", "workers", "s", "a second",
                        "a second of processor", "ms each", "ms of processor each"),
                       ((v["of"], v["batch"], v["threads"], v["s"], _rate(v, "per_s"),
                         _rate(v, "per_cpu_s"), v.get("s_ms_each", ""),
                         v.get("cpu_s_ms_each", "")) for v in studies))
    return "\n".join(text) + "\n"


def _on_device(head: Line, lines: Sequence[Line]) -> str:
    """What a device does, beside all cores of its machine."""
    device = head["device"]
    pairs = [(v, next((w for w in lines if w.get("device") == device and
                       all(w[key] == v[key] for key in ("row", "of", "batch", "threads"))), None))
             for v in lines if v.get("device") == "cpu"]
    text = [f"Commit {str(head.get('commit'))[:10]}, {head.get('accelerator')}, beside "
            f"cores of {head.get('processor')}, load {head.get('load')} at the "
            f"start, warp-lang {head.get('version.warp-lang')}, jax {head.get('version.jax')}, "
            f"Python {head.get('python')}. Scores and episodes are made by that many processes, "
            "which share the device.", ""]
    return "\n".join(text + _table(
        ("what", "of", "batch", "cores", "CPU, a second", f"{device}, a second", "ratio",
         "first call [s]"),
        ((v["row"], v["of"], v["batch"], v["threads"], _rate(v, "per_s"),
          _rate(w, "per_s") if w else "", "" if w is None or "failed" in v or "failed" in w else
          f"{w['per_s'] / v['per_s']:.2g}", (w or {}).get("first_s", ""))
         for v, w in pairs))) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    return ["| " + " | ".join(head) + " |", "|" + "---|" * len(head),
            *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)]


def _rate(line: Line, key: str) -> str:
    if "failed" in line:
        return "failed"
    value = line[key]
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def ratio(line: Line, lines: Sequence[Line]) -> float | None:
    """Our rate over that of a peer's `line`, by processor time; None without a row of ours."""
    wanted = {"mujoco_rollout": ("same_closing", "-"), "numba_closing": ("same_closing", "-"),
              "jax_closing": ("same_closing", "-"), "scipy_fits": ("fits", line.get("of")),
              "sklearn_free_forms": ("free_forms", "fit"),
              "trimesh_distances": ("trimesh_distances", "ours"),
              "mujoco_scipy_episode": ("episodes", line.get("of"))}.get(line["row"])
    ours = next((v for v in lines if (v["row"], v.get("of")) == wanted and "failed" not in v), None)
    if line["row"] not in PEERS or ours is None or ours is line or "failed" in line:
        return None
    return ours["per_cpu_s"] / line["per_cpu_s"]


def _ratio(line: Line, lines: Sequence[Line]) -> str:
    found = ratio(line, lines)
    return "" if found is None else f"{found:,.1f}"


def _notes(line: Line) -> str:
    known = ("tip_error_mm", "steps", "steps_off", "off_mm", "closings", "failed")
    return ", ".join(f"{key} {line[key]}" for key in known if key in line)
