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
from strategies.recovery.evidence import Evidence
from sweeps.episode.scores import ROUGH, Scorer, Scores

GROWTH = 1.5
"""Touches of a free form on the way, at least, as a multiple of those of the one before."""
CURVES = ("curve_touches", "curve_time_s", "curve_chamfer_mm", "curve_iou", "curve_touched10mm")
Rebuild = Callable[[Belief, Recovered, Evidence, np.ndarray], Reconstruction | None]
"""Bodies of what was believed, recovered and felt, of the worlds asked for (world,)."""


@dataclass(frozen=True)
class Moment:
    """What an episode had reached when its bodies were fitted. Shapes (world,)."""

    step: int
    """How many steps had been made."""
    touches: np.ndarray
    time_s: np.ndarray
    scores: Scores
    """Of the models recovered."""
    recovered: Recovered
    touched: np.ndarray
    """Share of the surface near a contact so far."""
    rebuilt: Scores | None = None
    """Of the bodies that `[fit] reconstruct` makes; NaN in worlds where none was made then."""

    @property
    def reached(self) -> Scores:
        """What an episode would have scored that ended here, NaN where that is not known."""
        return self.scores if self.rebuilt is None else self.rebuilt


def no_scores(worlds: int) -> Scores:
    """Scores that are not known."""
    return Scores(*(np.full(worlds, np.nan) for _ in fields(Scores)))


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
    scorer: Scorer, moments: Sequence[Moment], believed: Sequence[tuple[Belief, Evidence]],
    rebuild: Rebuild, final: Scores
) -> tuple[Moment, ...]:
    """The moments with the scores of the bodies that `rebuild` makes, those of the last `final`.

    `believed` is what the robot believed and had felt at each of the moments.
    """
    from sweeps.episode.mesh_scores import scores_with_meshes

    rough = replace(scorer, samples=ROUGH)
    found, last = [], np.zeros(len(final.chamfer_m))
    for moment, (belief, felt) in zip(moments[:-1], believed[:-1], strict=True):
        wanted = (moment.touches > 0) & (moment.touches >= GROWTH * last)
        last = np.where(wanted, moment.touches, last)
        scores = moment.scores
        made = rebuild(belief, moment.recovered, felt, wanted) if wanted.any() else None
        if made is not None:
            scores = scores_with_meshes(rough, made.meshes, scores)
        found.append(replace(moment, rebuilt=Scores(*(
            np.where(wanted, getattr(scores, f.name), np.nan) for f in fields(Scores)))))
    return (*found, *(replace(moment, rebuilt=final) for moment in moments[-1:]))


def curves(moments: Sequence[Moment], worlds: int) -> dict[str, np.ndarray]:
    """Columns of arrays: touches, time and scores at each fit; of fits at the same touches and
    time the last."""
    columns: dict[str, list[np.ndarray]] = {name: [] for name in CURVES}
    for world in range(worlds):
        at = np.array([(m.touches[world], m.time_s[world]) for m in moments]).reshape(-1, 2)
        # A pose that was barred took time, and the fit after it is another one.
        kept = np.append((np.diff(at, axis=0) > 0).any(1), True)[:len(at)]
        kept &= np.array([m.rebuilt is None or np.isfinite(m.rebuilt.chamfer_m[world])
                          for m in moments], bool)
        for name, values in (
                ("curve_touches", at[:, 0]), ("curve_time_s", at[:, 1]),
                ("curve_chamfer_mm", [m.reached.chamfer_m[world] * 1e3 for m in moments]),
                ("curve_iou", [m.reached.iou[world] for m in moments]),
                ("curve_touched10mm", [m.touched[world] for m in moments])):
            columns[name].append(np.array(values, float)[kept])
    found = {}
    for name, rows in columns.items():
        found[name] = np.empty(worlds, object)
        found[name][:] = rows
    return found
