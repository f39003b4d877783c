"""`warpgrasp compare A B`: what changed in the specs, and paired differences of what is shared."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sweeps.analysis.entries import check_metric, digits_of
from sweeps.analysis.leaderboard import few_lines
from sweeps.analysis.paired import MANY_OBJECTS, interval_note
from sweeps.compare.matching import Shared, changes, shared_by
from sweeps.compare.shift import Shift, measure_shift
from sweeps.output import note
from sweeps.result_file import check_table, write_result
from sweeps.run.plan import Plan, plan_study
from sweeps.run.race_record import refuse_races
from sweeps.run.store import Store, open_study
from sweeps.spec.errors import StoreError
from sweeps.spec.reader import read_spec
from sweeps.text_table import TextTable, number_text, print_json, print_table
from warpgrasp.core.plain_text import on_one_line

LISTED = 50
"""Changes that are printed; the rest is a number."""


def compare(one: Path, other: Path, out: Path | None, *, metric: str | None, over: str | None,
            as_json: bool) -> int:
    """Prints what changed from A to B, what they share, and its differences.

    Of spec files only the changes. Raises LeaderboardError where two studies share nothing or no
    episode of it is finished, StoreError and SpecError for what cannot be read, StoreError for a
    race.
    """
    if metric is not None:
        check_metric(metric)
    check_table(out)
    sides = [_read(path) for path in (one, other)]
    (plan, mine), (later, theirs) = sides
    changed = changes(plan, later)
    if mine is None or theirs is None:
        for name, value in (("-o", out), ("--metric", metric), ("--over", over)):
            if value is not None:
                raise StoreError(f"{name}: is of a table, which needs two studies; A and B should "
                                 "be directories")
        if as_json:
            print_json({"changes": changed})
        else:
            _print_changes(changed)
        return 0
    refuse_races(plan, mine)
    refuse_races(later, theirs)
    if not as_json:
        _print_changes(changed)
        print()
    shared = shared_by(plan, later)
    metric = metric or "chamfer_mm"
    shift = measure_shift((plan, mine), (later, theirs), shared, metric, over)
    if not shift.objects:
        raise StoreError(f"no episode of what A and B share is finished in both and has a value "
                         f"of {metric}; `warpgrasp status` says how far each is")
    made = shift_table(shared, shift, metric)
    if out is not None:
        write_result(out, made.csv())
    if as_json:
        print_json({"changes": changed, "shared": _shared_record(shared, shift),
                    "table": made.records(), "notes": made.notes})
        return 0
    print(_shared_text(shared, shift), end="\n\n")
    print_table(made.header, made.rows, False)
    for text in made.notes:
        note(text)
    return 0


def _read(path: Path) -> tuple[Plan, list[Store] | None]:
    """A study from its directory, or from a spec, which has no rows."""
    if path.is_file() or path.suffix == ".toml":
        return plan_study(read_spec(path)), None
    plan, stores = open_study([path])
    return plan, stores


def _print_changes(lines: Sequence[str]) -> None:
    print("changes from A to B" if lines else "the specs of A and B are the same")
    for line in lines[:LISTED]:
        print(f"  {on_one_line(line)}")
    if len(lines) > LISTED:
        print(f"  ... {len(lines) - LISTED} more")


def _shared_record(shared: Shared, shift: Shift) -> dict[str, Any]:
    return {"strategies": list(shared.strategies), "objects": list(shared.objects),
            "entries": [match.label for match in shared.matches],
            "paired": _is_paired(shared), "episodes_a": shift.episodes[0],
            "episodes_b": shift.episodes[1]}


def _is_paired(shared: Shared) -> bool:
    return shared.same_seed and all(match.same_noise for match in shared.matches)


def _shared_text(shared: Shared, shift: Shift) -> str:
    """What both have, in a few lines."""
    one, other = shift.episodes
    episodes = f"{one} pairs of the same object, number and noise" if _is_paired(shared) else (
        f"{one} of A and {other} of B, "
        + ("not all of them paired" if shared.same_seed
           and any(match.same_noise for match in shared.matches) else "none of them paired"))
    return "\n".join([
        "shared by A and B",
        f"  strategies: {on_one_line(', '.join(shared.strategies))}",
        f"  objects:    {on_one_line(', '.join(shared.objects))}",
        f"  entries:    {len(shared.matches)} (a strategy under a setting)",
        f"  episodes:   {episodes}, of each entry"])


def shift_table(shared: Shared, shift: Shift, metric: str) -> TextTable:
    """A row for each shared entry, and one for all together."""
    digits = digits_of(metric)
    labels = [match.label for match in shared.matches]
    means = [(a, b) for a, b in zip(shift.one, shift.other, strict=True)]
    if len(labels) > 1:
        labels.append("(all of these)")
        means.append((shift.one.mean(), shift.other.mean()))
    found = shift.difference
    rows = tuple(
        (label, *(number_text(float(v), digits) for v in (*means[n], found.value[n], found.low[n],
                                                          found.high[n])),
         str(shift.objects), str(shift.episodes[0]), str(shift.episodes[1]))
        for n, label in enumerate(labels))
    header = ("strategy", f"{metric}_a", f"{metric}_b", "b_minus_a", "ci_low", "ci_high",
              "n_objects", "n_episodes_a", "n_episodes_b")
    return TextTable(header, rows, tuple(_notes(shared, shift, len(rows))))


def _notes(shared: Shared, shift: Shift, rows: int) -> list[str]:
    notes = [interval_note(shift.over)]
    if shift.over == "like-these" and shift.objects < MANY_OBJECTS:
        notes.append(f"{shift.objects} objects: below {MANY_OBJECTS} nothing can be claimed about "
                     "other objects")
    if rows > 1:
        notes.append(f"the {rows} intervals hold together (95 %, Bonferroni)")
    if not shared.same_seed:
        notes.append("the seeds differ, and with them poses and noise: episodes are not paired, "
                     "the differences are those of two independent means")
    elif others := [match.label for match in shared.matches if not match.same_noise]:
        notes.append(f"the noise_stream differs: episodes of {', '.join(others[:8])}"
                     f"{', ...' if len(others) > 8 else ''} are not paired")
    notes += few_lines([*_without_score(shared, shift)])
    if shift.missing:
        notes.append(f"{shift.missing} units are missing; blocks of episodes that not every "
                     "shared entry has are left out")
    return notes


def _without_score(shared: Shared, shift: Shift) -> Iterator[str]:
    """Entries of which episodes have no score: what changed may be how often they fail."""
    for match, *counts in zip(shared.matches, *shift.unscored, strict=True):
        told = [f"{count} of {side}" for count, side in zip(counts, "AB", strict=True) if count]
        if told:
            yield (f"{match.label}: episodes without a score count as the worst on their object: "
                   f"{', '.join(told)}")
