"""What each entry recognized each object as; entries that were not asked are left out."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import (
    asked_to_recognize,
    entries_of,
    entry_axes,
    paired_blocks,
    values_of,
)
from sweeps.analysis.paired import reading_notes
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.text_table import TextTable, number_text
from warpgrasp.objects.catalogue_names import NO_ANSWER, NONE_OF_THESE


@dataclass(frozen=True)
class Confusion:
    """Counts of answers by entry and object."""

    labels: tuple[str, ...]
    objects: tuple[str, ...]
    answers: tuple[str, ...]
    """The study's objects, then other names, then none of these and no answer where they occur."""
    counts: dict[tuple[str, str], Counter[str]]
    recognized: dict[str, float]
    """By entry, the share of episodes with the right answer, as the leaderboard's column has it:
    the mean over objects. An object that is not in the catalogue is rightly none of these."""
    notes: tuple[str, ...]


def read_confusion(plan: Plan, stores: Sequence[Store]) -> Confusion:
    """Reads a study's units once."""
    axes, _ = entry_axes(plan, None)
    entries = entries_of(plan, axes)
    counts: dict[tuple[str, str], Counter[str]] = {}
    right: dict[tuple[str, str], list[float]] = {}
    missing, objects, asked = 0, [], []
    for number, body in enumerate(plan.study.objects):
        seen = False
        for block in paired_blocks(plan, stores, entries, axes, number):
            if block.missing:
                missing += block.missing
                continue
            seen = True
            for entry, rows in zip(entries, block.rows, strict=True):
                key = entry.label, body.name
                right.setdefault(key, []).extend(values_of(rows, "recognized"))
                if not asked_to_recognize(rows):
                    continue
                asked += [] if entry.label in asked else [entry.label]
                answers = rows.get("recognized_as", [""] * block.count)
                counts.setdefault(key, Counter()).update(map(str, answers))
        objects += [body.name] if seen else []
    counts = {key: _named(count) for key, count in counts.items()}
    given = {name for count in counts.values() for name in count}
    last = [name for name in (NONE_OF_THESE, NO_ANSWER) if name in given]
    answers = [*objects, *sorted(given - {*objects, NONE_OF_THESE, NO_ANSWER}), *last]
    notes = list(reading_notes(plan, missing, len(objects)))
    if objects and given <= {NO_ANSWER}:
        notes.append("no strategy of this study names what it felt")
    shares = {label: float(np.mean([np.mean(right[label, body]) for body in objects]))
              for label in asked}
    return Confusion(tuple(asked), tuple(objects), tuple(answers), counts, shares, tuple(notes))


def _named(count: Counter[str]) -> Counter[str]:
    return Counter({name or NO_ANSWER: number for name, number in count.items()})


def confusion_table(found: Confusion) -> TextTable:
    """The table of `warpgrasp table DIR confusion`: the answers that were given, a line each."""
    rows = []
    for label in found.labels:
        for body in found.objects:
            count = found.counts.get((label, body), Counter())
            rows += [(label, body, answer, str(count[answer]),
                      number_text(count[answer] / count.total(), 4))
                     for answer in found.answers if count[answer]]
    return TextTable(("strategy", "object", "recognized_as", "n_episodes", "share"),
                     tuple(rows), found.notes)
