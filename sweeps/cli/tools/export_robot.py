"""What `warpgrasp export` does: the robot, and an object before it, as a file for other
simulators."""

from pathlib import Path

from sweeps.cli.app import refuse_existing
from sweeps.output import init_warp, note, quiet_stdout
from sweeps.result_file import check_result, write_result
from sweeps.spec.errors import StoreError
from sweeps.spec.objects import object_of_argument
from warpgrasp.geometry.body import BodyError
from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, PadTable

DEFAULT_HAND = "utah_mit"
HAND_ABOVE_M = 0.15
"""Hand alone with an object: the hand frame this far above the object, pointing down."""


def export_robot(
    file: Path, *, arm: str | None, what: str | None, units: str | None, hand: str = "utah_mit",
    force: bool = False,
) -> int:
    """Write `file` (.xml: MJCF, .urdf: URDF; then meshes beside it) and print what was written.

    Files that exist are written over only with `force`: StoreError.
    """
    kind = file.suffix.lower()
    if kind not in (".xml", ".urdf"):
        raise StoreError(f"{file}: ends in {kind or 'nothing'}; .xml writes MJCF, .urdf URDF")
    check_result(file)
    refuse_existing(file, force)
    with quiet_stdout():
        init_warp()
        files = _files(file, kind, arm, what, units, hand)
    for path in files:
        check_result(path)
        refuse_existing(path, force)
    for path, text in files.items():
        write_result(path, text.encode())
        print(path)
    return 0


def _files(
    file: Path, kind: str, arm: str | None, what: str | None, units: str | None, hand_word: str
) -> dict[Path, str]:
    from warpgrasp.chain.chain_hand import hand_of_kind
    from warpgrasp.export.convex_solids import hull_excess, object_solids
    from warpgrasp.export.mjcf import mjcf_text
    from warpgrasp.export.model_tree import arm_model_tree, hand_model_tree
    from warpgrasp.export.robot_tree import STILL, arm_hand_tree, hand_tree
    from warpgrasp.export.urdf import urdf_text
    from warpgrasp.objects.catalogue import body_from_name, body_from_table
    from warpgrasp.objects.mesh_import import mesh_triangles

    hand, pads, stands = HandTable(), PadTable(), ObjectTable()
    model = None  # the default hand is the tables', pads included
    if hand_word != DEFAULT_HAND:
        model = hand_of_kind(hand_word)
    solids, top = [], 0.0
    if what is not None:
        table = object_of_argument(what, units)
        if units is not None and "mesh" not in table:
            raise StoreError(f"--units: is of a mesh file; {what} is none")
        triangles = None
        if "mesh" in table:
            body = body_from_table(table, Path())
            triangles = mesh_triangles(Path(table["mesh"]), units=table["units"])
        elif set(table) == {"name"}:
            body = body_from_name(str(table["name"]))
        else:  # a member of a family
            body = body_from_table(table, Path())
        solids, top = object_solids(body, triangles), body.high_m[2]
        if triangles is not None and (excess := hull_excess(solids[0])):
            note(f"{what}: is not convex, and its convex hull is {excess:.0%} larger: MuJoCo and "
                 "most simulators touch the hull; cut it into convex pieces for them (CoACD)")
    if arm:
        carries = ArmTable(kind=arm)
        links = (arm_hand_tree(carries, hand, pads) if model is None
                 else arm_model_tree(carries, model, hand.mount_length_m))
        place = (stands.x_m, stands.y_m, *STILL[2:])
    else:
        above = (0.0, 0.0, top + HAND_ABOVE_M, 1.0, 0.0, 0.0, 0.0)
        at = above if solids else STILL
        links = (hand_tree(hand, pads, place=at) if model is None
                 else hand_model_tree(model, place=at))
        place = STILL
    hand_name = "utah_mit_hand" if model is None else model.name
    name = f"{Path(arm).stem}_{hand_name}" if arm else hand_name
    if kind == ".xml":
        return {file: mjcf_text(links, solids, name=name, object_place=place,
                                table=bool(arm or solids))}
    try:
        text, meshes = urdf_text(links, solids, name=name, object_place=place,
                                 mesh_stem=f"{file.stem}_object")
    except ValueError as error:
        raise BodyError(f"{what}: {error}") from None
    return {file: text, **{file.parent / mesh: obj for mesh, obj in meshes.items()}}
