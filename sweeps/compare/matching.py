"""What two studies share, and where their specs differ.

An entry of one is an entry of the other where the strategy has the same name and every key that
either study sweeps has the same value; a key that a study does not sweep, or of which its sweep
has one value alone, is fixed in it. What is fixed in both may differ: that is what is compared. An
object is the same where its content is. Episodes are paired where seed, object, number and noise
stream are the same, since pose and noise are then.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sweeps.analysis.entries import (
    Entry,
    LeaderboardError,
    entries_of,
    entry_axes,
    setting_index,
    value_text,
)
from sweeps.run.plan import Plan, by_key, canonical_body, differences

NAMED = ("strategies", "objects")


@dataclass(frozen=True)
class Match:
    """An entry that both studies have."""

    label: str
    strategy: str
    one: Entry
    other: Entry
    same_noise: bool
    """Whether its episodes meet the same noise in both."""


@dataclass(frozen=True)
class Shared:
    """What two studies share."""

    matches: tuple[Match, ...]
    objects: tuple[str, ...]
    same_seed: bool

    @property
    def strategies(self) -> tuple[str, ...]:
        """Names of the strategies, each once."""
        return tuple(dict.fromkeys(match.strategy for match in self.matches))


def changes(one: Plan, other: Plan) -> list[str]:
    """Where the specs differ, a line each; what only one of them has is one line."""
    old, new = by_key(one.resolved), by_key(other.resolved)
    lines = []
    for section in NAMED:
        for name in sorted({*old[section]} ^ {*new[section]}):
            lines.append(f"{section}.{name}: only in {'A' if name in old[section] else 'B'}")
        for side, rest in ((old, new), (new, old)):
            side[section] = {name: value for name, value in side[section].items()
                             if name in rest[section]}
    return sorted([*lines, *differences(old, new)])


def shared_by(one: Plan, other: Plan) -> Shared:
    """The entries and objects of both. Raises LeaderboardError where there are none."""
    bodies = {body.name: canonical_body(body) for body in other.study.objects}
    objects = [body.name for body in one.study.objects
               if bodies.get(body.name) == canonical_body(body)]
    if not objects:
        raise LeaderboardError("A and B share no object of the same content: "
                               + _sides(one.resolved["objects"], other.resolved["objects"]))
    matches = tuple(_matches(one, other))
    if not matches:
        known = [[entry.label for entry in _entries(plan)] for plan in (one, other)]
        raise LeaderboardError(f"A and B share no strategy under the same setting: "
                               f"{_sides(*known)}")
    return Shared(matches, tuple(objects), one.study.head.seed == other.study.head.seed)


def _sides(one: Sequence[str] | Mapping[str, Any], other: Sequence[str] | Mapping[str, Any]
           ) -> str:
    def some(names: Sequence[str] | Mapping[str, Any]) -> str:
        return ", ".join([*names][:8]) + (f", ... ({len(names)} in all)" if len(names) > 8 else "")

    return f"A has {some(one)}; B has {some(other)}"


def _entries(plan: Plan) -> list[Entry]:
    return entries_of(plan, entry_axes(plan, None)[0])


def _matches(one: Plan, other: Plan) -> Iterator[Match]:
    keys = list(dict.fromkeys([*_swept(one), *_swept(other)]))
    names = [strategy.name for strategy in other.study.strategies]
    theirs = [(entry, *_values(other, entry)) for entry in _entries(other)]
    for mine in _entries(one):
        strategy = one.study.strategies[mine.strategy]
        given, si = _values(one, mine)
        for entry, their_given, their_si in theirs:
            if names[entry.strategy] != strategy.name or not all(
                    _agree(key, si, one, mine, their_si, other, entry) for key in keys):
                continue
            values = their_given | given
            told = [f"{key}={value_text(values[key])}" for key in keys if key in values]
            label = strategy.name + (f" [{', '.join(told)}]" if told else "")
            streams = {strategy.noise_stream, other.study.strategies[entry.strategy].noise_stream}
            yield Match(label, strategy.name, mine, entry, len(streams) == 1)


def _swept(plan: Plan) -> Iterator[str]:
    """Keys that tell entries apart."""
    for n in entry_axes(plan, None)[0]:
        if len(plan.study.axes[n].values) > 1:
            yield from plan.study.axes[n].keys


def _values(plan: Plan, entry: Entry) -> tuple[dict[str, Any], dict[str, Any]]:
    """What an entry has for the keys of its axes, as given and in SI."""
    points = dict.fromkeys(range(len(plan.study.axes)), 0) | entry.points
    own = {key for n in entry.points if n not in plan.study.idle[entry.strategy]
           for key in plan.study.axes[n].keys}
    given, si = plan.study.setting(setting_index(plan, points))
    return ({key: value for key, value in given.items() if key in own},
            {key: value for key, value in si.items() if key in own})


def _agree(key: str, si: Mapping[str, Any], one: Plan, mine: Entry, their_si: Mapping[str, Any],
           other: Plan, entry: Entry) -> bool:
    """Whether two entries have the same value of a key that at least one study sweeps."""
    if key in si and key in their_si:
        return si[key] == their_si[key]
    if key not in si and key not in their_si:  # it says nothing of this strategy
        return True
    if key in si:
        return other.study.holds(entry.strategy, key, si[key])
    return one.study.holds(mine.strategy, key, their_si[key])
