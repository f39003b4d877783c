"""A block of episodes, from placing the objects to the rows of results.

    cell + episode numbers → placed objects → exploration → recovered bodies → scores → rows

Cells that differ in their object, or in where their waypoints stand, can be run in one block: many
episodes at once cost less each.

An episode's object, pose, prior and noise come from (study seed, object, episode number)
alone: the same for every strategy, setting and block.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np

from fit.arrays import joined
from strategies.exploration import explore
from strategies.exploration_record import Exploration
from strategies.planners.from_strategy import MOST_STEPS, budget_of, fits_on_way, planner_of
from strategies.planners.oracle import Oracle
from strategies.planners.ordered import axis_unseen
from strategies.planners.planner_file import PlannerError
from strategies.planners.register import Planner
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.possible import FAILED, STATUS, NotPossible, fault_status
from strategies.recognition.answers import Recognition
from strategies.reconstruct.bent_model import with_bends
from strategies.reconstruct.free_form import Reconstruction, reconstruct
from strategies.reconstruct.plug_in_name import BUILT_IN, CHOSEN
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from strategies.recovery.evidence import Evidence
from strategies.recovery.recovery_failure import why_failed
from sweeps.episode.columns import model_columns, model_names
from sweeps.episode.contact_rows import contact_tables
from sweeps.episode.curve_moments import (
    Asked,
    Grown,
    Moment,
    curves,
    no_scores,
    rebuilt_moments,
    scored_moments,
)
from sweeps.episode.given_prior import (
    SEEN,
    draw_prior,
    normalized_chamfer,
    prior_recovered,
    score_priors,
    seen_prior,
    worse_than_prior,
)
from sweeps.episode.recognition_columns import columns_of_recognition, recognize_objects
from sweeps.episode.scores import ROUGH, SAMPLES, Scorer, Scores
from sweeps.episode.touched_share import TouchedSurface
from sweeps.episode.untouched import mostly_itself, why_untouched, without_axis
from sweeps.spec.cell import CONTACTS, ENDED, Cell
from warpgrasp.core.array_checks import check_array
from warpgrasp.core.kernel_launch import check_device
from warpgrasp.core.random import Purpose, counter_key, counter_uniform
from warpgrasp.geometry.body import Body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ObjectTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps, Robot, Truth

REBUILD_FAILED = "reconstruct_failed"
FAULTY = (FAILED, STATUS, REBUILD_FAILED)
"""Statuses whose note is what a user's function did wrong, or the hand cannot do."""
STOPPED = f"stopped: it wanted more than {MOST_STEPS} steps"
Part = tuple[Cell, np.ndarray]
"""A cell and the numbers of some of its episodes."""


@dataclass(frozen=True)
class EpisodeBlock:
    """Everything about a block of episodes, for rows, files and figures."""

    bodies: tuple[Body, ...]
    """The objects of its cells, in turn."""
    truth: Truth
    prior: BoundingCylinder
    exploration: Exploration
    scores: Scores
    prior_scores: Scores
    """Of the prior itself: what an episode without a touch would have."""
    moments: tuple[Moment, ...]
    recognition: Recognition
    """Which known object was felt."""
    touched: np.ndarray
    """Share of each true surface within 10 mm of a contact (`touched_share`), (world,)."""
    axis_unseen: np.ndarray
    """Worlds in which cameras were to see an axis and did not, bool (world,)."""

    @property
    def body(self) -> Body:
        """The object of a block of one cell."""
        body, = self.bodies
        return body

    @property
    def status(self) -> np.ndarray:
        """How each world ended."""
        return self.exploration.status

    @property
    def worse_than_prior(self) -> np.ndarray:
        """The scores in which each world is worse than the prior it was given, as text."""
        return worse_than_prior(self.scores, self.prior_scores)

    @property
    def recovered(self) -> Recovered:
        """The models recovered, which are scored where nothing stands in their place."""
        return self.exploration.recovered

    @property
    def rebuilt(self) -> Reconstruction | None:
        """Bodies that are scored in place of `recovered`, where they were asked for."""
        return self.exploration.rebuilt

    @property
    def evidence(self) -> Evidence:
        """All that was felt, as placed for the last fit of a model."""
        return self.exploration.belief.evidence

    @property
    def grasps(self) -> list[Grasps]:
        """Every batch of grasps, in order."""
        return [p.felt for p in self.exploration.procedures if isinstance(p.felt, Grasps)]


def run_cells(parts: Sequence[Part], device: str) -> list[dict[str, np.ndarray]]:
    """Rows of each of some `(cell, episodes)`, as `run_episodes` would give them, bit for bit.

    The cells have one `batch_key`. Raises TypeError or ValueError for no episodes or no device.
    """
    for _, episodes in parts:
        check_array("episodes", episodes, "whole numbers", "episode")
        if not len(episodes):
            raise ValueError("episodes: are none; should be one number or more")
    check_device(device)
    objects = [repr((cell.object_name, cell.body_table)) for cell, _ in parts]
    made = {what: cell_body(cell) for what, (cell, _) in zip(objects, parts, strict=True)}
    names = list(made)
    bodies = [made[what] for what in objects]
    numbers = sorted(range(len(parts)), key=lambda n: names.index(objects[n]))
    rows = _rows_of([parts[n] for n in numbers], [bodies[n] for n in numbers], device)
    ends = np.cumsum([len(parts[n][1]) for n in numbers])
    found: dict[int, dict[str, np.ndarray]] = {}
    for n, end in zip(numbers, ends, strict=True):
        mine = slice(end - len(parts[n][1]), end)
        found[n] = {name: values[mine] for name, values in rows.items()}
    return [found[n] for n in range(len(parts))]


def run_episodes(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
    """Rows of episodes `episodes` (numbers within the study) of a cell, a column each.

    Columns as in `docs/leaderboard.md`; text columns hold str, curves an array a row.
    """
    return run_cells([(cell, episodes)], device)[0]


def _rows_of(
    parts: Sequence[Part], bodies: Sequence[Body], device: str
) -> dict[str, np.ndarray]:
    cell = parts[0][0]
    counts = [len(episodes) for _, episodes in parts]
    block = run_parts(parts, bodies, device)
    worlds = sum(counts)
    belief, scores, recovered = block.exploration.belief, block.scores, block.recovered
    # Probes in turn, a column each: which of them the arm could not make, and why.
    probes = np.concatenate([np.zeros((worlds, 0), int),
                             *(g.moves.status[:, :, 0] for g in block.grasps)], axis=1)
    columns: dict[str, np.ndarray] = {
        "episode": np.concatenate([np.asarray(episodes, np.int64) for _, episodes in parts]),
        "strategy": np.repeat([cell.strategy.name for cell, _ in parts], counts),
        "object": np.repeat([cell.object_name for cell, _ in parts], counts),
        "seed": np.full(worlds, cell.seed, np.int64),
        "status": block.status,
        "note": episode_notes(block, cell, np.repeat(_which(bodies), counts)),
        "contacts": belief.evidence.mask.sum(1),
        "touches": belief.touches,
        "touched10mm": block.touched,
        "probes": (probes == ProbeStatus.CONTACT).sum(1),
        "unreachable": (probes == ProbeStatus.UNREACHABLE).sum(1),
        "collisions": (probes == ProbeStatus.COLLISION).sum(1),
        "procedures": _procedures(block),
        "robot_time_s": belief.time_s,
        "arm_path_m": belief.path_m,
        **_score_columns(scores, block.prior_scores),
        **columns_of_recognition(block.recognition, cell.recognition, bodies, counts),
        "shape": _shape_names(block, model_names(recovered, cell.fit)),
        **_score_columns(block.prior_scores, block.prior_scores, "prior_"),
        "worse_than_prior": block.worse_than_prior,
    }
    if cell.keep == "contacts":
        columns[CONTACTS] = contact_tables(block.exploration, block.truth)
    if block.exploration.ended.any():
        columns[ENDED] = block.exploration.ended
    replaced = None if block.rebuilt is None else block.rebuilt.made
    return columns | model_columns(belief, recovered, replaced) | curves(block.moments, worlds)


def _score_columns(scores: Scores, prior: Scores, prefix: str = "") -> dict[str, np.ndarray]:
    return {f"{prefix}{name}": values for name, values in (
        ("chamfer_mm", scores.chamfer_m * 1e3),
        ("normalized_chamfer", normalized_chamfer(scores, prior)),
        ("hausdorff95_mm", scores.hausdorff95_m * 1e3),
        ("iou", scores.iou), ("volume_ratio", scores.volume_ratio),
        ("coverage5mm", scores.coverage))}


def episode_notes(block: EpisodeBlock, cell: Cell, which: np.ndarray) -> np.ndarray:
    """What there is to say of each episode in words, or nothing, (world,).

    `which` (world,) tells which of the block's bodies stands in each.
    """
    why = why_untouched(block.exploration, [block.bodies[n] for n in which], block.truth,
                        block.prior, cell.arm, cell.hand)
    failed = why_failed(block.status, block.exploration.belief)
    why = np.where(why == "", _both(failed, mostly_itself(block.exploration)), why)
    why = _both(np.where(block.exploration.stopped, STOPPED, ""), why)
    why = _both(without_axis(block.exploration, block.axis_unseen), why)
    if block.rebuilt is not None and block.rebuilt.note is not None:
        why = _both(why, block.rebuilt.note)
    return np.where(np.isin(block.status, FAULTY), block.exploration.fault, why)


def _both(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Two texts of each world as one, (world,)."""
    return np.array(["; ".join(filter(None, both)) for both in zip(one, other, strict=True)],
                    object)


def _shape_names(block: EpisodeBlock, names: np.ndarray) -> np.ndarray:
    """Of each world the name of its model, or how its free form was made."""
    if block.rebuilt is None:
        return names
    return np.array([block.rebuilt.name_of(world) if made else str(name)
                     for world, (made, name) in enumerate(zip(block.rebuilt.made, names,
                                                              strict=True))])


def run_block(cell: Cell, episodes: np.ndarray, device: str, curve: bool = True) -> EpisodeBlock:
    """Run a block of episodes of one cell and keep all of it; see `run_parts`."""
    return run_parts([(cell, episodes)], [cell_body(cell)], device, curve)


def run_parts(
    parts: Sequence[Part], bodies: Sequence[Body], device: str, curve: bool = True
) -> EpisodeBlock:
    """Run the episodes of some cells that differ in their object alone, and keep all of it.

    Without `curve`, touched shares of the moments are NaN, and so are scores but the last.
    """
    cell = parts[0][0]
    which = np.repeat(_which(bodies), [len(episodes) for _, episodes in parts])
    key = np.concatenate([
        counter_key(int(cell.seed) & (2**63 - 1), _content_number(body), episodes)
        for (cell, episodes), body in zip(parts, bodies, strict=True)])
    bodies = [body for n, body in enumerate(bodies) if not n or body is not bodies[n - 1]]
    body_pose = place_objects(cell.placement, key)
    scorer = Scorer(bodies, which, body_pose, device, SAMPLES[cell.scores.samples])
    prior = joined([draw_prior(body, body_pose[rows], cell.placement, key[rows])
                   for body, rows in scorer.worlds()])
    truth = Truth(body_pose)
    noise = _noise_key(key, cell.strategy.noise_stream)
    robot = Robot(bodies, which, truth, noise, cell.arm, cell.hand, cell.sensors,
                  pads=cell.pads, errors=cell.errors, contact=cell.contact,
                  true=cell.true, device=device)
    unseen = np.full(len(key), "", object)
    if cell.placement.prior in SEEN:
        prior, unseen = seen_prior(robot, prior, cell.stereo, cell.placement.prior)
    given = prior_recovered(prior)
    surface = TouchedSurface(scorer.worlds(), body_pose)
    begin = Moment(0, np.zeros(len(key)), np.zeros(len(key)), score_priors(scorer, given), given,
                   surface.share(truth))
    rebuilds = curve and cell.fit.reconstruct != BUILT_IN[0]
    reached: list[Moment] = []
    asked: list[Asked] = []
    grown = Grown(len(key))

    def observe(belief: Belief, recovered: Recovered) -> None:
        reached.append(Moment(belief.step, belief.touches, belief.time_s, no_scores(len(key)),
                              recovered,
                              surface.share(truth) if curve else np.full(len(key), np.nan)))
        if rebuilds and (wanted := grown(belief.touches)).any():
            asked.append((len(reached) - 1, belief, wanted))

    def rebuild(belief: Belief, recovered: Recovered, wanted: np.ndarray
                ) -> tuple[Belief, Recovered, Reconstruction | None]:
        made = reconstruct(cell.fit.reconstruct, recovered, belief.evidence, prior, cell.fit,
                           felt=belief.unplaced, links=belief.links, belief=belief, wanted=wanted)
        if made is not None and cell.fit.reconstruct == CHOSEN:
            belief, recovered = with_bends(belief, recovered, wanted & ~made.made)
        return belief, recovered, made

    planner, fault = _planner(parts, robot, prior)
    # No subclass and nothing that looks like it: the truth is for the shipped one alone.
    oracle = planner if type(planner) is Oracle else None
    if oracle is not None:
        rough = replace(scorer, samples=ROUGH)
        oracle.let_see(lambda recovered, rows: rough.of(rows).score(recovered).chamfer_m)
    found = explore(robot, planner, prior, counter_key(noise, int(Purpose.STRATEGY)),
                    table=cell.fit, closings=cell.strategy.closings,
                    budget=budget_of(cell.strategy), observe=observe, oracle=oracle,
                    fits_on_way=fits_on_way(cell.strategy, planner))
    faults = np.full(len(key), fault, object) if fault else unseen
    if faults.any():
        wrong = faults != ""
        found = replace(found, fault=np.where(wrong, faults, found.fault),
                        status=np.where(wrong, fault_status(faults), found.status))
    moments = scored_moments(scorer, begin, reached, curve and not rebuilds)
    scores = moments[-1].scores if moments else begin.scores
    recognition = recognize_objects(found.belief, found.recovered, cell.recognition, device)
    straight = found.recovered
    belief, recovered, rebuilt = rebuild(found.belief, straight, np.ones(len(key), bool))
    if rebuilt is not None:
        from sweeps.episode.mesh_scores import scores_with_meshes

        found = replace(_rebuilt_status(found, rebuilt), belief=belief, recovered=recovered,
                        rebuilt=rebuilt)
        scores = scores_with_meshes(scorer, rebuilt.meshes,
                                    scorer.score_again(recovered, straight, scores))
        if rebuilds:
            moments = rebuilt_moments(scorer, begin, moments, asked, rebuild, scores)
    return EpisodeBlock(tuple(bodies), truth, prior, found, scores, begin.scores, moments,
                        recognition, surface.share(truth), axis_unseen(planner, len(key)))


def _which(bodies: Sequence[Body]) -> np.ndarray:
    """Of each part's body: which it is, parts of one object standing side by side."""
    return np.cumsum([0, *(body is not last for last, body in pairwise(bodies))])


def _rebuilt_status(found: Exploration, rebuilt: Reconstruction) -> Exploration:
    """How each world ended: one whose free form was made is `ok`, one whose plug-in failed is
    `reconstruct_failed`; a strategy's own failure stays."""
    kept = np.isin(found.status, (FAILED, STATUS))
    wrong = (rebuilt.fault != "") & ~kept
    status = np.where(rebuilt.made & ~kept, "ok", found.status)
    return replace(found, status=np.where(wrong, REBUILD_FAILED, status),
                   fault=np.where(wrong, rebuilt.fault, found.fault))


def _noise_key(key: np.ndarray, stream: int) -> np.ndarray:
    """Keys of the noise: the episodes' own, or those of another stream."""
    return key if stream == 0 else counter_key(key, int(Purpose.NOISE_STREAM), stream)


def _planner(parts: Sequence[Part], robot: Robot, prior: BoundingCylinder) -> tuple[Planner, str]:
    """The strategy, or one without probes and the reason why the named one cannot be used."""
    cell = parts[0][0]
    waypoints = [(part.strategy.waypoints, len(episodes)) for part, episodes in parts]
    try:
        return planner_of(cell.strategy, cell.planar, cell.contour, cell.decide, cell.stereo,
                          robot, prior, waypoints), ""
    except (PlannerError, NotPossible) as error:
        return lambda belief: [], str(error)


def _procedures(block: EpisodeBlock) -> np.ndarray:
    """The procedures that each world took part in, in order, as text: "containment planar"."""
    worlds = len(block.status)
    words: list[list[str]] = [[] for _ in range(worlds)]
    for procedure in block.exploration.procedures:
        for world in np.flatnonzero(procedure.took_part):
            if not words[world] or words[world][-1] != procedure.name:
                words[world].append(procedure.name)
    return np.array([" ".join(w) for w in words])


def cell_body(cell: Cell) -> Body:
    """The object of a cell. Raises BodyError."""
    table = dict(cell.body_table)
    if set(table) == {"name"}:
        return body_from_name(table["name"])
    return body_from_table(table, Path())


def _content_number(body: Body) -> int:
    return int(body.content[:15], 16)


def place_objects(placement: ObjectTable, key: np.ndarray) -> np.ndarray:
    """True poses of the objects on the table, (world, 7): yaw at random unless it is given."""
    stream = counter_key(key, int(Purpose.PLACEMENT))
    yaw = (2.0 * counter_uniform(stream) - 1.0) * pi
    if placement.yaw_rad is not None:
        yaw = np.full(len(key), placement.yaw_rad)
    pose = np.zeros((len(key), 7))
    pose[:, 0], pose[:, 1] = placement.x_m, placement.y_m
    pose[:, 5], pose[:, 6] = np.sin(yaw / 2), np.cos(yaw / 2)
    return pose
