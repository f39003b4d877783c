"""What follows from the rows of a run: sentences whose numbers and verdicts are computed.

Differences are paired by episode, of the same objects with other episodes (95 %). Where an interval
holds zero the sentence says that the run does not tell.
"""

from collections.abc import Sequence

import numpy as np

from sweeps.analysis.interval import ObjectMeans

SUFFICES = 0.8
"""Median IoU from which on an object counts as recovered."""
PRINTED = 15
"""The most iterations that the paper prints."""
Scores = Sequence[np.ndarray]
"""IoU of each object's episodes, (episode,) each, in one order of objects and episodes."""


def paired(one: Scores, other: Scores) -> tuple[float, float, float]:
    """Mean of `other` less `one` over objects, and the ends of its interval."""
    means = ObjectMeans(2, 0)
    for a, b in zip(one, other, strict=True):
        means.add(np.stack([a, b], 1))
    found = means.differences(0, "these")
    return float(found.value[1]), float(found.low[1]), float(found.high[1])


def changed(one: Scores, other: Scores) -> str:
    """Such as "+0.061 (0.042 to 0.080)"."""
    mean, low, high = paired(one, other)
    return f"{mean:+.3f} ({low:.3f} to {high:.3f})"


def where_touched(on_distal: int, on_other: int, off_distal_mm: float, off_other_mm: float) -> str:
    """Which links touched, and how far the fingertip estimate is from the true points there."""
    whole = max(on_distal + on_other, 1)
    return (f"The distal link made {on_distal} of {whole} contacts "
            f"({100 * on_distal / whole:.0f} %). There the fingertip estimate lies "
            f"{off_distal_mm:.1f} mm from the true point in the median; where another link "
            f"touched, {off_other_mm:.1f} mm.")


def link_or_place(
    told: Scores, link: Scores, tip: Scores, both: Scores, points: Scores
) -> str:
    """Which error of the fingertip estimate costs more."""
    _, low, high = paired(link, tip)
    verdict = ("The place on the tip matters more than the link" if low > 0.0 else
               "The link matters more than the place on the tip" if high < 0.0 else
               "The run does not tell which of the two matters more")
    return (f"With Solina's residual alone, the mean IoU changes by {changed(told, link)} if the "
            f"link that touched is known, by {changed(told, tip)} if the true point is known "
            f"wherever the tip touched, by {changed(told, both)} if both are, and by "
            f"{changed(told, points)} with all true points. {verdict}: the second less the first "
            f"is {changed(link, tip)}.")


def what_limits(names: Sequence[str], points: Scores, ours: Scores) -> str:
    """On which objects true points do not suffice, and what other evidence does there."""
    medians = [float(np.median(iou)) for iou in points]
    poor = [k for k, value in enumerate(medians) if value < SUFFICES]
    if not poor:
        return (f"With true points, Solina's residual alone reaches a median IoU of {SUFFICES} or "
                f"more on every object (least {min(medians):.2f}): errors of the contacts are what "
                "limits the first rows.")
    words = [f"{names[k]} {medians[k]:.2f} ({np.median(ours[k]):.2f})" for k in poor]
    best = sum(float(np.median(ours[k])) > medians[k] for k in poor)
    said = ("more than true points give there" if best == len(poor) else
            f"more than true points give on {best} of these {len(poor)}")
    return (f"Even with true points, Solina's residual alone stays below a median IoU of "
            f"{SUFFICES} on {len(poor)} of {len(names)} objects; in brackets all evidence, with "
            f"contacts by joint torques: {', '.join(words)}. All evidence gives {said}"
            + (": what limits the first rows there is not the contacts alone, but what the fit "
               "does not know." if best else "."))


def what_rivals_do(
    what: str, names: Sequence[str], alone: Scores, rivalled: Scores, replaced: Sequence[np.ndarray]
) -> str:
    """How often a rival's body replaced the first, and what that changes."""
    counts = ", ".join(f"{name} {int(won.sum())}" for name, won in zip(names, replaced, strict=True)
                       if won.any())
    whole = sum(len(won) for won in replaced)
    if not counts:
        return f"{what}, no rival replaced a fit in {whole} episodes."
    _, low, high = paired(alone, rivalled)
    verdict = ("better" if low > 0.0 else "worse" if high < 0.0 else "not clearly changed")
    return (f"{what}, a rival's fit replaced the first in {sum(int(r.sum()) for r in replaced)} of "
            f"{whole} episodes ({counts}). The mean IoU is {verdict}: {changed(alone, rivalled)}.")


def iterations_said(iterations: np.ndarray) -> str:
    """How many fits are done by as many iterations as the paper prints."""
    share = 100.0 * float((iterations <= PRINTED).mean())
    return (f"{share:.0f} % of {len(iterations)} plain fits have settled after {PRINTED} "
            "iterations, the most that the paper prints.")


def what_makes_six(medians: Sequence[tuple[str, float, str, str]], typical_deg: float) -> str:
    """Which sources of error make the printed angle typical, of (source, largest median error,
    size, blocks that it is of)."""
    def listed(chosen: list[tuple[str, float, str, str]]) -> str:
        return "; ".join(f"{source} ({error:.1f} deg{' at ' if size else ''}{size}, {blocks})"
                         for source, error, size, blocks in chosen)

    enough = [m for m in medians if m[1] >= typical_deg]
    nearly = [m for m in medians if 0.8 * typical_deg <= m[1] < typical_deg]
    others = [m for m in medians if m[1] < 0.8 * typical_deg]
    words = [f"An error of {typical_deg:.0f} degrees is typical with (largest median error, of the "
             f"blocks whose two sides were both crossed): "
             f"{listed(enough) if enough else 'none of the sources tried'}."]
    if nearly:
        words.append(f"Nearly: {listed(nearly)}.")
    if others:
        words.append(f"Not with: {listed(others)}.")
    return " ".join(words)


def which_contour(names: Sequence[str], paper: Scores, ours: Scores, ways: tuple[str, str]) -> str:
    """Whose volumes are nearer to the truth, of relative errors of each bottle's worlds."""
    better = [name for name, a, b in zip(names, paper, ours, strict=True)
              if np.median(b) < np.median(a)]
    _, low, high = paired(paper, ours)
    verdict = (f"the volumes of {ways[1]} are nearer to the truth" if high < 0.0 else
               f"the volumes of {ways[0]} are nearer to the truth" if low > 0.0 else
               "the run does not tell whose volumes are nearer to the truth")
    return (f"The median error of the volume is smaller with {ways[1]} on {len(better)} of "
            f"{len(names)} bottles"
            f"{' (' + ', '.join(better) + ')' if better else ''}. Over all, {verdict}: the mean "
            f"error changes by {100 * paired(paper, ours)[0]:+.2f} ({100 * low:.2f} to "
            f"{100 * high:.2f}) % of the volume from {ways[0]} to {ways[1]}.")
