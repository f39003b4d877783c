"""Meshes from files: read, checked, stood on the table, baked to a distance grid, cached."""

import codecs
import hashlib
import io
import logging
import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from warpgrasp.geometry.body import Body, BodyError
from warpgrasp.objects.grid_baking import Distance, baked_body, cached_grid, lost, volumes_m3
from warpgrasp.objects.mesh_orientation import mesh_distance, mesh_of, outward_faces
from warpgrasp.objects.welding import edge_counts, welded_faces

KINDS = ("stl", "obj", "ply", "off")
"""File kinds that are read. Archives and scenes (3MF, GLB, ZIP) could unfold to any size."""
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
LARGEST_FILE_BYTES = 256 * 2**20
LARGEST_FACE_COUNT = 2_000_000
SMALLEST_M, LARGEST_M = 0.005, 1.0  # of the longest side: what one hand can explore
_LIKE_M = 0.12  # the longest side that a message offers
_ROUNDED = 1e-3  # of the longest side: vertices may be rounded by this, as the grid rounds more
_FOLDED_RAD, _FOLD_M2 = 1e-3, 1e-6  # slivers of scans fold, too, and are not felt


def body_from_mesh(path: Path, *, units: str, name: str | None = None) -> Body:
    """A body from a watertight mesh file (STL, OBJ, PLY or OFF), standing on its lowest point.

    The file's z axis is up; the middle of its bounding box goes on the z axis. `units` is "m",
    "cm", "mm" or "in", or how long one unit of the file is, as "120 mm". Vertices that differ by
    rounding are welded where that closes the surface (`welding`). Raises BodyError with what is
    wrong (missing, empty, open, out of size, rounded far from the origin, too thin for the grid)
    and the mend.
    """
    _unit_m(path, units)
    kind = path.suffix.lower().lstrip(".")
    if kind not in KINDS:
        raise BodyError(f"{path}: not a kind of mesh that is read; {', '.join(KINDS)} are")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise BodyError(f"{path}: cannot be read: {error.strerror or error}") from None
    if size == 0:
        raise BodyError(f"{path}: the file is empty; a mesh with faces is wanted")
    if size > LARGEST_FILE_BYTES:
        raise BodyError(f"{path}: {size / 2**20:.0f} MiB; at most {LARGEST_FILE_BYTES >> 20} MiB: "
                        "simplify the mesh first")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BodyError(f"{path}: cannot be read: {error.strerror or error}") from None
    key = hashlib.sha256(content)
    key.update(f"{kind} {units}".encode())

    def baked() -> Body:
        with _quiet_reader():
            vertices, faces = _read_checked(path, content, units)
        try:
            return _bake(vertices, faces)
        except BodyError as error:
            raise BodyError(f"{path}: {error}") from None

    return replace(cached_grid(key.hexdigest(), baked), name=name or path.stem,
                   doc=f"mesh {path.name}")


def _unit_m(path: Path, units: str) -> float:
    """How long one unit of the file is [m]."""
    words = re.fullmatch(r"([\d.e+-]*) ?([a-z]+)", units) if isinstance(units, str) else None
    size = math.nan
    if words and words[2] in UNITS_M:
        with suppress(ValueError):
            size = float(words[1] or 1.0) * UNITS_M[words[2]]
    if not 0.0 < size < math.inf:
        raise BodyError(f"{path}: units {units!r}: one of {', '.join(UNITS_M)}, or how long one "
                        'unit of the file is, as "120 mm"')
    return size


def can_be_explored(longest_m: float) -> bool:
    """Whether an object whose longest side is so long is one that a hand explores."""
    slack = 1e-3  # files keep lengths in single precision, compounds are measured by sampling
    return SMALLEST_M * (1.0 - slack) <= longest_m <= LARGEST_M * (1.0 + slack)


def mesh_triangles(path: Path, *, units: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m], (n, 3), and faces, (m, 3), of a mesh file as `body_from_mesh` stands it.

    The file is one that `body_from_mesh` takes. Raises BodyError as it does.
    """
    with _quiet_reader():
        return _read_checked(path, path.read_bytes(), units)


@contextmanager
def _quiet_reader() -> Iterator[None]:
    """Keeps the reader's log and warnings off stderr: errors are reported once, by BodyError."""
    log, nowhere = logging.getLogger("trimesh"), logging.NullHandler()
    before, log.propagate = log.propagate, False
    log.addHandler(nowhere)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.propagate = before
        log.removeHandler(nowhere)


def _read_checked(path: Path, content: bytes, units: str) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # heavy, and only meshes need it

    kind = path.suffix.lower().lstrip(".")
    content = content.removeprefix(codecs.BOM_UTF8)  # editors write it, readers stumble over it
    _check_declared_faces(path, kind, content)
    if kind == "off":
        content = _fanned(content)
    elif kind == "obj":
        content = content.replace(b"\t", b" ")
    try:  # from memory: files that a mesh names beside itself (materials, textures) stay closed
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False)
    except Exception as error:  # any reader's failure is the file's fault here
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        polygons = ("; all faces of a binary PLY need as many corners: make triangles of polygons "
                    "first" if kind == "ply" else "")
        raise BodyError(f"{path}: not a mesh that can be read ({reason}); STL, OBJ, PLY and OFF "
                        f"files are{polygons}") from None
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        _check_length(path, kind, content)
        raise BodyError(f"{path}: no faces in it; a closed surface of triangles is wanted")
    if len(mesh.faces) > LARGEST_FACE_COUNT:
        raise BodyError(f"{path}: {len(mesh.faces):,} faces; at most {LARGEST_FACE_COUNT:,}: "
                        "simplify the mesh first")
    if not np.isfinite(mesh.vertices).all():
        number = int(np.argmin(np.isfinite(mesh.vertices).all(1)))
        raise BodyError(f"{path}: vertex {number} is not a finite number: "
                        f"{mesh.vertices[number].tolist()}; remove it and close the hole")
    _check_rounding(path, np.asarray(mesh.vertices))
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    # Three corners on a line close a T-junction; a face that names one twice closes nothing.
    a, b, c = np.asarray(mesh.faces).T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.remove_unreferenced_vertices()
    if not mesh.nondegenerate_faces().any():
        raise BodyError(f"{path}: every face is a line or a point; faces with an area are wanted")
    unit_m = _unit_m(path, units)
    own = float(mesh.extents.max())
    longest = own * unit_m
    if not can_be_explored(longest):
        fits = [u for u, s in UNITS_M.items() if can_be_explored(own * s)]
        hint = f"; read as {', '.join(fits)} it would fit" if fits else ""
        raise BodyError(f"{path}: {longest:.4g} m long when read in {units}; "
                        f"{SMALLEST_M} to {LARGEST_M} m can be explored{hint}: are the units "
                        f'right? units = "{_LIKE_M * 1e3 / own:.3g} mm" would make it '
                        f"{_LIKE_M * 1e3:g} mm long")
    if (edge_counts(np.asarray(mesh.faces)) == 1).any():
        mesh.faces = welded_faces(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        mesh.remove_unreferenced_vertices()
    _check_closed(path, edge_counts(np.asarray(mesh.faces)))
    vertices = mesh.vertices * unit_m
    low, high = vertices.min(0), vertices.max(0)
    vertices = vertices - [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    try:
        faces = outward_faces(vertices, np.asarray(mesh.faces))
    except BodyError as error:
        raise BodyError(f"{path}: {error}") from None
    _check_folds(path, vertices, faces)
    return vertices, faces


def _check_rounding(path: Path, vertices: np.ndarray) -> None:
    """Refuse an object so far from the origin that the single precision of its file rounds it."""
    single = vertices.astype(np.float32)
    step, longest = float(np.spacing(np.abs(single).max())), float(np.ptp(vertices, axis=0).max())
    if step > _ROUNDED * longest > 0.0 and (single == vertices).all():
        raise BodyError(f"{path}: lies {np.abs(single).max():.4g} of its units from the origin, "
                        f"where numbers of single precision are {step:.2g} apart and round it; "
                        "move it to the origin before the file is written")


def _check_folds(path: Path, vertices_m: np.ndarray, faces: np.ndarray) -> None:
    """Refuse faces that are folded back on the next one, with nothing between them: so readers
    cut polygons with a hollow corner, which then are felt where the body is not."""
    import trimesh

    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    area = mesh.area_faces[mesh.face_adjacency].min(axis=1)
    folded = (mesh.face_adjacency_angles > np.pi - _FOLDED_RAD) & (area > _FOLD_M2)
    if folded.any():
        raise BodyError(f"{path}: faces folded back on the one beside them, with nothing between: "
                        f"{int(folded.sum())}. So readers cut polygons with a hollow corner: make "
                        "triangles of polygons first (Blender 'Triangulate Faces', MeshLab 'Turn "
                        "into a Pure-Triangular mesh'); blunt edges as sharp as a blade's")


def _check_closed(path: Path, counts: np.ndarray) -> None:
    """Refuse a surface of which an edge borders not just two faces; `counts` has how many each."""
    if (counts == 1).any():
        raise BodyError(
            f"{path}: the surface is open: {int((counts == 1).sum())} edges border one face; close "
            "its holes first (trimesh.repair.fill_holes, with use_fan=True for holes of more than "
            "four edges, MeshLab 'Close Holes', Blender 3D-Print toolbox)")
    if (counts > 2).any():
        raise BodyError(
            f"{path}: {int((counts > 2).sum())} edges are shared by more than two faces: remove "
            "faces that are there twice, and unite bodies that touch along a face or an edge "
            "(MeshLab 'Remove Duplicate Faces', 'Mesh Boolean: Union')")


def _check_declared_faces(path: Path, kind: str, content: bytes) -> None:
    """Refuse a header that declares more than can be read, before anything is read on."""
    head = content[:65_536]
    declared = 0
    if kind == "ply":
        for line in head.split(b"\n"):
            words = line.split()
            if len(words) == 3 and words[0] == b"element":
                declared = max(declared, _count(words[2]))
    elif kind == "stl" and len(head) >= 84 and head[:5].lower() != b"solid":
        declared = int.from_bytes(head[80:84], "little")
    elif kind == "off":
        words = [word for line in head.split(b"\n") for word in line.partition(b"#")[0].split()]
        declared = max(map(_count, words[:4]), default=0)
    elif kind == "obj":
        declared = content.count(b"\nf")
    if declared > LARGEST_FACE_COUNT:
        raise BodyError(f"{path}: its header declares {declared:,} faces or vertices; at most "
                        f"{LARGEST_FACE_COUNT:,}")


def _check_length(path: Path, kind: str, content: bytes) -> None:
    """Refuse a binary STL in which no faces were found since its length is not what it says."""
    if kind == "stl" and len(content) >= 84 and b"\0" in content:
        declared = int.from_bytes(content[80:84], "little")
        if len(content) != 84 + 50 * declared:
            raise BodyError(f"{path}: its header declares {declared:,} faces, for which a binary "
                            f"STL has {84 + 50 * declared:,} bytes; it has {len(content):,}: is it "
                            "cut short? Export or copy it again")


def _fanned(content: bytes) -> bytes:
    """An OFF file with fans of triangles for polygons of five and more corners, at which the reader
    fails; of other kinds of files it makes these fans itself. A file that is wrong stays so."""
    lines = [words for line in content.split(b"\n") if (words := line.partition(b"#")[0].split())]
    try:
        vertices = lines[1:] if lines[0][1:] else lines[2:]
        count, face_count = map(int, (lines[0][1:] or lines[1])[:2])
        faces = [face[1:int(face[0]) + 1] for face in vertices[count:count + face_count]]
    except (IndexError, ValueError):
        return content
    if all(len(face) < 5 for face in faces):
        return content
    fans = [(b"3", face[0], *ends) for face in faces for ends in pairwise(face[1:])]
    return b"\n".join([b"OFF", b"%d %d 0" % (count, len(fans)),
                       *map(b" ".join, [*vertices[:count], *fans])])


def _count(word: bytes) -> int:
    return int(word[:20]) if word.isdigit() else 0


def _bake(vertices: np.ndarray, faces: np.ndarray) -> Body:
    mesh = mesh_of(vertices, faces)
    distance = lambda points: mesh_distance(mesh, points)  # noqa: E731
    body = baked_body(vertices.min(0), vertices.max(0), distance)
    _check_volume(body, distance)
    return body


def _check_volume(body: Body, distance: Distance) -> None:
    """Refuse a body that does not hold what its mesh does."""
    held, wanted = volumes_m3(body, distance)
    if lost(held, wanted):
        cell = body.parts[0].grid_cell_m
        raise BodyError(
            f"it would be baked to nodes {1000 * cell:.2g} mm apart, which hold {held * 1e6:.3g} "
            f"of its {wanted * 1e6:.3g} cm3: walls and gaps of two nodes, {2000 * cell:.2g} mm, "
            "are kept; thicken its walls, or bring a mesh whose longest side is shorter")
