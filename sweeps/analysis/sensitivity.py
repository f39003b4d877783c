"""Which estimated constants change a ranking of strategies? One at a time, over their brackets.

A study like any other, whose one zip axis holds the defaults in its first row and in every further
row one constant at an end of its bracket: of the robot that is and of the one that is believed
alike (`both`), then of either alone, where the robot's conclusions use it. A constant that is wrong
in both is known to the robot; one that differs between them is an error it does not know of.
Episodes meet the same objects, poses and noise in every row, so rows differ by the constant alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from sweeps.analysis.entries import Entry, value_text
from sweeps.analysis.paired import read_objects
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.spec.cell import APART
from sweeps.spec.errors import Problem, SpecError
from sweeps.text_table import number_text

STRATEGIES = ("ring6", "column9", "random18", "rim12-ring12")
OBJECTS = ("block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel")
EPISODES = 16
_DRAWS = 500  # of a pair of studies, for what is chance
METRIC = "chamfer_mm"
SIDES = ("both", "truth", "belief")
SWEPT = "robot.swept"
"""The key that says whose a constant is."""
SURE = 0.05
"""The chance that any pair is called swapped in any setting and is not, at most."""


@dataclass(frozen=True)
class Bracket:
    """A constant in the units of a spec, its default, the ends of what it may be, and why."""

    key: str
    default: Any
    ends: tuple[Any, ...]
    why: str
    apart: bool = True
    """Whether what the robot concludes depends on it, so that truth and belief may differ."""

    @property
    def rows(self) -> list[tuple[Any, str]]:
        """Values and whose they are, a row of the study each."""
        return [(end, side) for end in self.ends for side in (SIDES if self.apart else SIDES[:1])]


BRACKETS = (
    Bracket("hand.link_length_mm", [43.0, 33.0, 28.0], ([43.2, 29.6, 25.4], [54.0, 38.4, 30.0]),
            "GraspIt!'s human hand; Allegro hand"),
    Bracket("hand.finger_spacing_mm", 28.0, (22.0, 43.5), "Allegro hand: 43.5"),
    Bracket("hand.palm_gap_mm", 80.0, (60.0, 100.0), "a quarter either way"),
    Bracket("hand.link_radius_mm", 8.0, (6.0, 10.0), "a quarter either way"),
    Bracket("hand.moment_arm_mm", [10.0, 10.0, 8.0, 6.0],
            ([7.0, 7.0, 5.6, 4.2], [14.0, 14.0, 11.2, 8.4]), "0.7 and 1.4 times"),
    Bracket("hand.joint_stiffness_Nm_rad", 2.0, (1.0, 5.0), "half to 2.5 times", apart=False),
    Bracket("hand.skin_stiffness_N_m", 2e4, (5e3, 1e5), "a quarter to five times", apart=False),
    Bracket("contact.friction", 0.5, (0.2, 1.0), "of rubber and of finger pads; 0.4 to 2 times",
            apart=False),
    Bracket("hand.tendon_friction", 0.07, (0.02, 0.15), "over pulleys, or in a tube"),
    Bracket("hand.co_contraction_N", 9.0, (5.0, 15.0), "0.6 to 1.7 times", apart=False),
    Bracket("sensors.tension_noise_N", 0.3, (0.1, 1.0), "a third to three times"),
    Bracket("sensors.joint_noise_deg", 0.3, (0.1, 1.0), "a third to three times"),
    Bracket("errors.mount_mm", 0.5, (0.1, 2.0), "a fifth to four times"),
    Bracket("errors.mount_deg", 0.2, (0.05, 1.0), "a quarter to five times"),
    Bracket("object.prior_sigma_mm", 10.0, (5.0, 20.0), "half to twice", apart=False),
)


def sensitivity_spec(
    brackets: Sequence[Bracket] = BRACKETS, strategies: Sequence[str] = STRATEGIES,
    objects: Sequence[str] = OBJECTS, episodes: int = EPISODES, seed: int = 1990,
) -> str:
    """The study as the text of a spec."""
    lines = ["# One constant at a time over its bracket; written by `warpgrasp sensitivity`.",
             "schema = 1", 'name = "sensitivity"', f"seed = {seed}",
             f"episodes_per_cell = {episodes}", f"objects = {_toml(list(objects))}"]
    for name in strategies:
        lines += ["", "[[strategy]]", f"name = {_toml(name)}"]
    lines += ["", "[sweep.zip]"]
    for bracket in brackets:
        row = [value if other is bracket else bracket.default
               for other in brackets for value, _ in other.rows]
        lines.append(f'"{bracket.key}" = {_toml([bracket.default, *row])}  # {bracket.why}')
    sides = [SIDES[0], *(side for bracket in brackets for _, side in bracket.rows)]
    lines.append(f'"{SWEPT}" = {_toml(sides)}')
    return "\n".join([*lines, ""])


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value)


HEADER = ("constant", "value", "varied", "tau", "best", "best_chamfer_mm", "mean_change_mm",
          "swapped_for_sure")


def check_study(plan: Plan, file: Path) -> None:
    """Raises SpecError for a study that does not compare strategies, one constant at a time, first
    with the defaults of all."""
    problems = []
    if len(plan.study.strategies) < 2:
        problems.append(Problem(str(file), "strategy", "is one; a ranking needs two at least"))
    if plan.study.setting_count < 2:
        problems.append(Problem(str(file), "sweep", "is of one setting; should be one [sweep.zip] "
                                "whose first row holds the defaults, and each other one change"))
    given, si = plan.study.setting(0)
    for key in si:
        if not all(plan.study.holds(n, key, si[key]) for n in range(len(plan.study.strategies))):
            problems.append(Problem(
                str(file), "sweep", f"{key} is {value_text(given[key])} in the first setting; "
                "should be the default there, or what the study's table says beside the sweep"))
    for number in range(plan.study.setting_count):
        keys = [key for key, _ in _changes(plan, number)]
        if len(keys) > 1:
            problems.append(Problem(
                str(file), "sweep", f"setting {number + 1} changes {' and '.join(keys)}; each "
                "should change one constant of the first setting, which holds the defaults"))
            break
        side = _side(plan, number)
        if keys and side != SIDES[0] and keys[0].partition(".")[0] not in APART:
            problems.append(Problem(
                str(file), "sweep", f"setting {number + 1} changes {keys[0]} where {SWEPT} is "
                f"{side}; should be {SIDES[0]}, for truth and belief differ in "
                f"{', '.join(APART)} alone"))
    if problems:
        raise SpecError(problems)


def sensitivity_table(plan: Plan, store: Store) -> tuple[list[tuple[str, ...]], list[str]]:
    """A row a setting, and notes. `tau` is Kendall's rank correlation with the default's."""
    scores, read = _scores(plan, store)  # (setting, strategy, object, episode)
    names = [s.name for s in plan.study.strategies]
    base = scores[0]
    sure = _sure(scores)
    rows = []
    for number, values in enumerate(scores):
        key, value, side = _changed(plan, number)
        means = _means(values)
        best, least, mean = "NA", "NA", "NA"
        if np.isfinite(means).all():
            best, least = names[int(means.argmin())], f"{means.min():.3f}"
            mean = f"{(means - _means(base)).mean():+.3f}"
        rows.append((key, value, side, number_text(_tau(_means(base), means), 2), best, least, mean,
                     _swapped(base, values, names, sure)))
    shape = "{2} objects x {3} episodes".format(*scores.shape)
    return rows, [
        f"{len(names)} strategies x {shape} a setting, ranked by mean {METRIC}",
        _chance_note(base), *read]


def _chance_note(base: np.ndarray) -> str:
    if base.shape[-1] < 2:  # drawn again, one episode is itself: tau would be 1
        return "fewer than two episodes do not tell which tau is chance"
    low, middle = (number_text(v, 2) for v in np.quantile(_tau_by_chance(base), [0.05, 0.5]))
    return (f"redrawing the default's episodes alone gives tau {middle} (5 %: {low}): "
            "a tau above that says nothing")


def _scores(plan: Plan, store: Store) -> tuple[np.ndarray, list[str]]:
    """Scores (setting, strategy, object, episode) of the same episodes everywhere, as on a
    leaderboard of all settings: a failed one counts as the worst, what not all have is left out.
    And notes of what was read."""
    study = plan.study
    sizes = tuple(len(axis.values) for axis in study.axes)
    entries = [Entry(strategy, given.name, dict(enumerate(map(int, np.unravel_index(n, sizes)))))
               for n in range(study.setting_count)
               for strategy, given in enumerate(study.strategies)]
    failed, missing, lost, found = np.zeros(len(entries), int), 0, [], []
    for rows in read_objects(plan, [store], entries, range(len(sizes)), [METRIC]):
        missing += rows.missing
        filled = rows.filled(METRIC) if rows.episodes else np.full((1, len(entries)), np.nan)
        if not np.isfinite(filled).all():
            lost.append(rows.name)
            continue
        failed += (~np.isfinite(rows.values[METRIC])).sum(axis=0)
        found.append(filled)
    shape = study.setting_count, len(study.strategies)
    out = np.full((*shape, len(found), max(map(len, found), default=1)), np.nan)
    for n, values in enumerate(found):
        out[:, :, n, :len(values)] = values.T.reshape(*shape, -1)
    notes = [f"{count} of {shape[0] * sum(map(len, found))} episodes of {given.name} have no score "
             "and count as the worst on their object" for count, given in
             zip(failed.reshape(shape).sum(axis=0), study.strategies, strict=True) if count]
    if missing:
        notes.append(f"{missing} units are missing; blocks of episodes that not every strategy has "
                     "in every setting are left out")
    return out, notes + [f"{name} is left out: nothing has a score there" for name in lost]


def _means(values: np.ndarray) -> np.ndarray:
    """Mean of each strategy over objects, of means over episodes; (strategy, object, episode)."""
    return _mean(_mean(values))


def _mean(values: np.ndarray) -> np.ndarray:
    """Mean over the last axis of finite values; NaN where there is none."""
    there = np.isfinite(values)
    total, count = np.where(there, values, 0.0).sum(-1), there.sum(-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _tau(one: np.ndarray, other: np.ndarray) -> float:
    """Of the strategies that have both means; NaN where fewer than two do."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < 2:
        return float("nan")
    return float(kendalltau(one[both], other[both])[0])  # pyright: ignore[reportArgumentType]


def _tau_by_chance(base: np.ndarray) -> np.ndarray:
    """Kendall's tau of two rankings from episodes drawn with replacement from one study."""
    rng = np.random.default_rng(0)
    episodes = base.shape[-1]
    drawn = [_means(base[..., rng.integers(0, episodes, episodes)]) for _ in range(2 * _DRAWS)]
    return np.array([_tau(a, b) for a, b in zip(drawn[::2], drawn[1::2], strict=True)])


def _sure(scores: np.ndarray) -> float:
    """How unlikely each of a pair's two leads must be by chance, for it to be swapped for sure:
    Bonferroni's correction for all pairs and settings, two-sided."""
    settings, strategies = scores.shape[:2]
    claims = settings * strategies * (strategies - 1) / 2
    return SURE / (2.0 * claims)


def _swapped(base: np.ndarray, values: np.ndarray, names: Sequence[str], sure: float) -> str:
    """Pairs that are surely one way by default and surely the other way now (paired episodes)."""
    found = []
    for a, b in combinations(range(len(names)), 2):
        (before, once), (after, now) = _lead(base[a] - base[b]), _lead(values[a] - values[b])
        if max(once, now) < sure and before * after < 0:
            found.append(f"{names[a]} {'<' if after < 0 else '>'} {names[b]}")
    return "; ".join(found) or "none"


def _lead(difference: np.ndarray) -> tuple[float, float]:
    """The mean over objects of means over episodes, (object, episode), in its standard errors, the
    objects being given; and the chance of one so far from zero on that side.

    Student's t has Welch and Satterthwaite's degrees of freedom: one object of a large spread has
    few, however many there are of the others.
    """
    from scipy.special import stdtr

    count = np.isfinite(difference).sum(-1)
    told, count = difference[count > 1], count[count > 1]
    if not len(told):
        return 0.0, 0.5
    part = np.nanvar(told, axis=-1, ddof=1) / count
    lead = float(_mean(_mean(told)) / max(np.sqrt(part.sum()) / len(told), 1e-12))
    square = (part**2 / (count - 1)).sum()
    freedom = part.sum() ** 2 / square if square > 0.0 else float((count - 1).sum())
    return lead, float(stdtr(freedom, -abs(lead)))


def _changed(plan: Plan, number: int) -> tuple[str, str, str]:
    """The constant of a setting that is not as in the first one, its value, and whose it is."""
    found = _changes(plan, number)
    side = _side(plan, number)
    if not found:
        return "(default)", "", side
    key, value = found[0]
    values = value if isinstance(value, tuple) else (value,)
    return key, " ".join(map(value_text, values)), side


def _side(plan: Plan, number: int) -> str:
    """Whose constants a setting varies."""
    given, _ = plan.study.setting(number)
    return str(given.get(SWEPT, plan.study.tables["robot"].swept))


def _changes(plan: Plan, number: int) -> list[tuple[str, Any]]:
    base, _ = plan.study.setting(0)
    given, _ = plan.study.setting(number)
    return [(key, value) for key, value in given.items() if key != SWEPT and value != base[key]]
