"""The files of one episode: contacts.csv, shape.json and figures."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fit.fit_status import status_names
from fit.superquadric.geometry import SuperquadricLike
from strategies.procedures.touches import REASON_TEXT, EndReason
from strategies.reconstruct.plug_in_name import CHOSEN, PARTS
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import accepted_rms
from strategies.strategy import Strategy
from sweeps.episode.columns import (
    NODES,
    contour_nodes,
    interval_columns,
    model_names,
    revolution_parameters,
    superquadric_parameters,
)
from sweeps.episode.contact_rows import contacts_csv
from sweeps.episode.episodes import REBUILD_FAILED, EpisodeBlock, episode_notes, run_block
from sweeps.episode.given_prior import normalized_chamfer
from sweeps.figures.contacts import contacts_shown, draw_contacts
from sweeps.figures.contour import contour_figure
from sweeps.figures.faces import crossed_faces, draw_faces, faces_shown
from sweeps.figures.meshes import mesh_of_world
from sweeps.figures.style import encode
from sweeps.figures.taxels import draw_taxels, pad_touches, taxels_shown
from sweeps.output import note, say, write_atomic
from sweeps.report.picture_process import Drawn, PictureProcess, attempt
from sweeps.report.surfaces import draw_surfaces, surfaces_shown
from sweeps.report.trust import choice_sentence, trust_sentence
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError
from warpgrasp.parameters import ArmTable, FitTable, HandTable, ObjectTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps

OTHERS = ("recovered.ply", "surfaces.png", "contacts.png", "faces.png", "taxels.png",
          "contour.png", "replay.html")
"""What an episode may have besides `contacts.csv` and `shape.json`."""


def explore(
    *, body_table: Mapping[str, Any], strategy: Strategy, seed: int, yaw_rad: float | None,
    x_m: float, y_m: float, out: Path, device: str, replay: bool = False,
    reconstruct: str = CHOSEN, hand: HandTable | None = None, arm: ArmTable | None = None,
    pictures: PictureProcess | None = None,
) -> list[Path]:
    """Runs one episode; writes `contacts.csv`, `shape.json` and figures; returns their paths.

    `contacts.png` and `surfaces.png` always; `faces.png` where faces were crossed, `contour.png`
    where a contour was followed, `taxels.png` where pads had contact, `replay.html` for `replay`.
    Notes on stderr say how far to trust the recovered shape, what was chosen and why, and what the
    note of the episode's row would be; a fault, and which figures could not be drawn, is said even
    where notes are suppressed.
    `body_table` names the object as in a spec; `yaw_rad` None gives it a random yaw; `hand` and
    `arm` None are the robot of the paper; `pictures` draws figures beside the episode, else they
    are drawn here. Raises BodyError for an object that cannot be built, OSError where `out` cannot
    be written.
    """
    name = str(body_table.get("name") or Path(str(body_table.get("mesh", "object"))).stem)
    cell = Cell(strategy, body_table, name, seed=seed, hand=hand or HandTable(),
                arm=arm or ArmTable(),
                placement=ObjectTable(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad),
                fit=FitTable(reconstruct=reconstruct))
    block = run_block(cell, np.arange(1), device, curve=False)
    record = shape_record(cell, block)
    files = {"contacts.csv": contacts_csv(block.exploration, block.truth),
             "shape.json": json.dumps(record, indent=2) + "\n"}
    if (out / "shape.json").exists():  # an earlier episode's files would be taken for this one's
        for old in OTHERS:
            (out / old).unlink(missing_ok=True)
    for file, content in files.items():
        write_atomic(out / file, content.encode())
    written = list(files)
    mesh = mesh_of_world(block)
    if mesh is not None:
        write_atomic(out / "recovered.ply", mesh.as_ply())
        written.append("recovered.ply")
    for file, picture in _pictures(cell, block, pictures):
        if isinstance(picture, Exception):  # the episode is kept without the figure
            say(f"{out / file}: cannot be drawn: {picture}")
            continue
        write_atomic(out / file, picture)
        written.append(file)
    if replay and _replayed(cell, block, out / "replay.html"):
        written.append("replay.html")
    note(f"{block.status[0]}: {trust_sentence(block)}")
    if reconstruct == CHOSEN:
        note(choice_sentence(block))
    if reconstruct == PARTS and not (block.rebuilt and block.rebuilt.made[0]):
        note("parts: contacts ask for one superquadric only, or prior or table contradict several; "
             "the recovered model stands")
    if block.exploration.fault[0]:
        what = "reconstruct" if block.status[0] == REBUILD_FAILED else "the strategy"
        say(f"{what} failed: {block.exploration.fault[0]}")
    elif record["note"]:
        note(record["note"])
    if block.worse_than_prior[0]:
        note("worse than the prior it was given: " + ", ".join(block.worse_than_prior[0].split()))
    if block.rebuilt is not None and block.rebuilt.made[0]:
        note(f"{block.rebuilt.name_of(0)}: body made in {block.rebuilt.time_s:.1f} s")
    return [out / file for file in sorted(written)]


def _replayed(cell: Cell, block: EpisodeBlock, file: Path) -> bool:
    """Writes the replay; whether there is one. Where the robot did not move there is none, and why
    it did not is said with the rest."""
    from sweeps.figures.replay_frames import make_replay
    from sweeps.report.replay import write_replay

    try:
        shown = make_replay(cell, block)
    except StoreError as error:
        say(f"{file}: not written: {error}")
        return False
    write_replay(shown, file)
    return True


def _pictures(
    cell: Cell, block: EpisodeBlock, process: PictureProcess | None
) -> Iterator[tuple[str, Drawn]]:
    """The names of the figures that an episode has, and each file, or why there is none.

    `process` draws what can be shown without the simulator, if there is one."""
    name, profile = cell.object_name, block.exploration.belief.profile
    wanted = [("surfaces.png", draw_surfaces, surfaces_shown),
              ("contacts.png", draw_contacts, contacts_shown)]
    if crossed_faces(block):
        wanted.append(("faces.png", draw_faces, faces_shown))
    if pad_touches(block):
        wanted.append(("taxels.png", draw_taxels,
                       lambda block, name: taxels_shown(block, cell.pads, name)))
    shown: dict[str, tuple[Callable[[Any], bytes], Any]] = {}
    for file, draw, show in wanted:
        try:
            shown[file] = draw, show(block, name)
        except Exception as error:
            yield file, error
    if process is not None:
        process.begin(list(shown.values()))
    if profile is not None and np.isfinite(profile.volume_m3[0]):
        yield "contour.png", attempt(lambda: encode(contour_figure(block, name, wide=True), "png"))
    yield from zip(shown, process.finish() if process is not None
                   else [attempt(*job) for job in shown.values()], strict=True)


def shape_record(cell: Cell, block: EpisodeBlock, world: int = 0) -> dict[str, Any]:
    """The content of `shape.json`: the recovered models, the chosen one, and its scores."""
    scores, belief = block.scores, block.exploration.belief
    name = str(model_names(block.recovered, cell.fit)[world])
    pose = block.truth.body_pose[world]
    return {
        "object": cell.object_name,
        "strategy": cell.strategy.name,
        "seed": cell.seed,
        "status": str(block.status[world]),
        "note": str(episode_notes(block, cell, np.zeros(len(block.status), int))[world]),
        "trust": trust_sentence(block, world),
        "models": list(_models(cell, block, world)),
        "chosen": block.rebuilt.name_of(world) if block.rebuilt and mesh_of_world(block, world)
        else name,
        "interval": _interval(block, world),
        "recognized_as": str(block.recognition.name[world]) or None,
        "recognized_by": str(block.recognition.way[world]) or None,
        "recognized_probability": (float(block.recognition.probability[world])
                                   if block.recognition.name[world] else None),
        "true_pose": {"x_m": float(pose[0]), "y_m": float(pose[1]),
                      "yaw_rad": float(2 * np.arctan2(pose[5], pose[6]))},
        "procedures": list(_ends(block, world)),
        "metrics": {
            "chamfer_mm": float(scores.chamfer_m[world] * 1e3),
            "normalized_chamfer": float(normalized_chamfer(scores, block.prior_scores)[world]),
            "hausdorff95_mm": float(scores.hausdorff95_m[world] * 1e3),
            "iou": float(scores.iou[world]),
            "volume_ratio": float(scores.volume_ratio[world]),
            "coverage5mm": float(scores.coverage[world]),
            "touches": int(belief.touches[world]),
            "robot_time_s": float(belief.time_s[world]),
            "arm_path_m": float(belief.path_m[world]),
        },
        "worse_than_prior": str(block.worse_than_prior[world]),
        "grid_error_mm": block.body.grid_error_m * 1e3,
    }


def _interval(block: EpisodeBlock, world: int) -> dict[str, float | bool | None]:
    """The 90 % interval of the chosen body's volume, and what tells of trust in it; None where
    that is not known."""
    rebuilt = block.rebuilt
    belief = block.exploration.belief
    columns = interval_columns(belief, block.recovered,
                               accepted_rms(block.recovered, belief.evidence),
                               None if rebuilt is None else rebuilt.made)
    prior = block.recovered.shape[world] == Shape.PRIOR
    found = {name: None if prior or np.isnan(values[world]) else values[world].item()
             for name, values in columns.items()}
    if rebuilt is not None and mesh_of_world(block, world) is not None:
        volume = rebuilt.volume(world)
        if volume is not None:
            low, high = volume.interval_m3()[0].tolist()
            found |= {"volume_low_m3": low, "volume_high_m3": high}
    return found


def _models(cell: Cell, block: EpisodeBlock, world: int) -> Iterator[dict[str, Any]]:
    """Every model of the body: the superquadric (or the prior), faces, the contour."""
    belief = block.exploration.belief
    yield from _free_form(block, world)
    ok = bool(belief.fitted[world])
    kind = str(model_names(Recovered(
        np.where(belief.fitted, Shape.SUPERQUADRIC, Shape.PRIOR), belief.body), cell.fit)[world])
    numbers = superquadric_parameters(belief.body)
    yield {"shape": kind, "parameters": {k: float(v[world]) for k, v in numbers.items()},
           "rms_mm": float(belief.fits.rms_m[world] * 1e3) if ok else None,
           "status": status_names(belief.fits.status)[world],
           "contacts": int(belief.fits.n_points[world])}
    for face in belief.faces:
        fit = face.fit
        if fit.n_points[world] == 0:
            continue
        yield {"shape": "plane", "parameters": {
            **dict(zip(("nx", "ny", "nz"), face.normal[world].tolist(), strict=True)),
            "offset_m": float(face.offset_m[world]),
            **dict(zip(("extent_u_m", "extent_v_m"), fit.extent_m[world].tolist(), strict=True))},
            "rms_mm": float(fit.rms_m[world] * 1e3), "flat": bool(face.flat[world]),
            "status": status_names(fit.status)[world], "contacts": int(fit.n_points[world])}
    profile = belief.profile
    if profile is not None and np.isfinite(profile.volume_m3[world]):
        numbers, nodes = revolution_parameters(profile), contour_nodes(profile, world)
        yield {"shape": "revolution", "parameters": {
            **{k: float(v[world]) for k, v in numbers.items()},
            **{k: v.tolist() for k, v in zip(NODES, nodes, strict=True)}},
            "rms_mm": float(profile.rms_m[world] * 1e3),
            "status": status_names(profile.fit.status)[world],
            "contacts": int(profile.fit.n_points[world])}


def _free_form(block: EpisodeBlock, world: int) -> Iterator[dict[str, Any]]:
    """The free-form body of a world: its size, and for a Gaussian process what it is sure of."""
    mesh, rebuilt = mesh_of_world(block, world), block.rebuilt
    if mesh is None or rebuilt is None:
        return
    found: dict[str, Any] = {
        "shape": rebuilt.name_of(world), "file": "recovered.ply",
        "parameters": {"volume_m3": mesh.volume_m3, "faces": len(mesh.faces)}}
    if world in rebuilt.parts:
        found["parts"] = _superquadrics(rebuilt.parts[world])
    if world in rebuilt.polyhedra:
        planes = rebuilt.polyhedra[world]
        found["planes"] = [
            {**dict(zip(("nx", "ny", "nz"), normal.tolist(), strict=True)),
             "offset_m": float(offset), "felt": number < planes.felt}
            for number, (normal, offset) in enumerate(zip(planes.normals, planes.offset_m,
                                                          strict=True))]
    volume = rebuilt.volume(world)
    if volume is not None:
        fit, about = rebuilt.forms[world].fit, rebuilt.forms[world].about
        if about.superquadric is not None:
            found["about"], = _superquadrics(about.superquadric)
        found["parameters"] |= {
            "volume_m3": float(volume.volume_m3[0]),
            "length_m": float(fit.length_m[0]), "amplitude_m": float(fit.amplitude_m[0]),
            "noise_m": float(fit.noise_sigma_m[0]),
            "surface_std_m": float(volume.surface_std_m[0].mean())}
        found |= {"rms_mm": float(fit.rms_m[0] * 1e3),
                  "status": status_names(fit.status)[0], "contacts": int(fit.n_points[0])}
    yield found


def _superquadrics(bodies: SuperquadricLike) -> list[dict[str, float]]:
    """The parameters of each."""
    numbers = superquadric_parameters(bodies)
    return [{k: float(v[part]) for k, v in numbers.items()} for part in range(len(bodies.size_m))]


def _ends(block: EpisodeBlock, world: int) -> Iterator[dict[str, Any]]:
    """Contacts of each procedure that took part, and why each exploratory one ended."""
    for procedure in block.exploration.procedures:
        if not procedure.took_part[world]:
            continue
        if isinstance(procedure.felt, Grasps):
            status = procedure.felt.closing.status[world]
            yield {"procedure": procedure.name, "contacts": int((status == ProbeStatus.CONTACT)
                                                                .sum())}
        else:
            reason = EndReason(int(procedure.felt.reason[world]))
            felt = procedure.felt.touches
            yield {"procedure": procedure.name, "ended": reason.name.lower(),
                   "because": REASON_TEXT[reason],
                   "touches": int(procedure.felt.touch_count[world]),
                   "contacts": int((felt.world[felt.status == ProbeStatus.CONTACT] == world).sum()),
                   "thrown_out": int(procedure.felt.rejected[world])}
