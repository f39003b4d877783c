"""What an episode had reached each time its bodies were fitted, and the curve of its errors.

    fits on the way → bodies of `[fit] reconstruct` → scores → columns of curves

A curve is that of the body that is scored at the end. A free form costs as much as many fits, and
the more the more was touched: on the way one is made each time that touches have grown by half.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from strategies.reconstruct.free_form import Reconstruction
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from sweeps.episode.scores import ROUGH, Scorer, Scores

GROWTH = 1.5
"""Touches when a free form is made on the way, at least, as a multiple of those of the one before.
"""
CURVES = ("curve_touches", "curve_time_s", "curve_chamfer_mm", "curve_iou", "curve_touched10mm")
Asked = tuple[int, Belief, np.ndarray]
"""The number of a moment, what was believed then, and the worlds whose body is to be made."""
Rebuild = Callable[[Belief, Recovered, np.ndarray],
                   tuple[Belief, Recovered, Reconstruction | None]]
"""Of what was believed and recovered, what stands for the bodies of the worlds asked for (world,).
"""


@dataclass(frozen=True)
class Moment:
    """What an episode had reached when its bodies were fitted. Shapes (world,)."""

    step: int
    """How many steps had been made."""
    touches: np.ndarray
    time_s: np.ndarray
    scores: Scores
    """Of the models recovered; NaN where nothing asks for them."""
    recovered: Recovered
    touched: np.ndarray
    """Share of the surface near a contact so far."""
    rebuilt: Scores | None = None
    """Of the bodies that `[fit] reconstruct` makes, if it makes any."""
    made: np.ndarray | None = None
    """Worlds in which `rebuilt` is known, bool (world,); all where no other body is made."""


def no_scores(worlds: int) -> Scores:
    """Scores that are not known."""
    return Scores(*(np.full(worlds, np.nan) for _ in fields(Scores)))


class Grown:
    """Tells when touches have grown by half since it last said so, world by world."""

    def __init__(self, worlds: int) -> None:
        self._last = np.zeros(worlds)

    def __call__(self, touches: np.ndarray) -> np.ndarray:
        """Worlds in which they have, bool (world,)."""
        grown = (touches > 0) & (touches >= GROWTH * self._last)
        self._last = np.where(grown, touches, self._last)
        return grown


def scored_moments(scorer: Scorer, begin: Moment, reached: Sequence[Moment], curve: bool
                   ) -> tuple[Moment, ...]:
    """The moments after `begin` with the scores of their models: the last finely, those before it
    roughly, or not at all without `curve`."""
    rough = replace(scorer, samples=ROUGH)
    scored, last = [], begin
    unknown = no_scores(len(begin.touches))
    for moment in reached[:-1]:
        scored.append(last := replace(moment, scores=rough.score_again(
            moment.recovered, last.recovered, last.scores) if curve else unknown))
    return (*scored, *(replace(moment, scores=scorer.score_again(
        moment.recovered, begin.recovered, begin.scores)) for moment in reached[-1:]))


def rebuilt_moments(
    scorer: Scorer, begin: Moment, moments: Sequence[Moment], asked: Sequence[Asked],
    rebuild: Rebuild, final: Scores
) -> tuple[Moment, ...]:
    """The moments after `begin` with the scores of the bodies that `rebuild` makes where it is
    `asked`; those of the last are `final`. Where it makes none the model is scored, as at the end.
    """
    from sweeps.episode.mesh_scores import scores_with_meshes

    rough = replace(scorer, samples=ROUGH)
    worlds = len(final.chamfer_m)
    found = [replace(moment, rebuilt=no_scores(worlds), made=np.zeros(worlds, bool))
             for moment in moments]
    for number, belief, wanted in asked:
        if number < len(found) - 1:
            _, model, made = rebuild(belief, moments[number].recovered, wanted)
            assert made is not None
            models = rough.score_again(model, begin.recovered, begin.scores)
            found[number] = replace(found[number], made=wanted, rebuilt=scores_with_meshes(
                rough, made.meshes, models))
    return (*found[:-1], *(replace(moment, rebuilt=final, made=np.ones(worlds, bool))
                           for moment in found[-1:]))


def curves(moments: Sequence[Moment], worlds: int) -> dict[str, np.ndarray]:
    """Columns of arrays: touches, time and scores at each body made; of those at the same touches
    and time the last."""
    columns: dict[str, list[np.ndarray]] = {name: [] for name in CURVES}
    for world in range(worlds):
        mine = [m for m in moments if m.made is None or m.made[world]]
        scores = [m.scores if m.rebuilt is None else m.rebuilt for m in mine]
        at = np.array([(m.touches[world], m.time_s[world]) for m in mine]).reshape(-1, 2)
        # A pose that was barred took time, and the fit after it is another one.
        kept = np.append((np.diff(at, axis=0) > 0).any(1), True)[:len(at)]
        for name, values in (
                ("curve_touches", at[:, 0]), ("curve_time_s", at[:, 1]),
                ("curve_chamfer_mm", [s.chamfer_m[world] * 1e3 for s in scores]),
                ("curve_iou", [s.iou[world] for s in scores]),
                ("curve_touched10mm", [m.touched[world] for m in mine])):
            columns[name].append(np.array(values, float)[kept])
    found = {}
    for name, rows in columns.items():
        found[name] = np.empty(worlds, object)
        found[name][:] = rows
    return found
