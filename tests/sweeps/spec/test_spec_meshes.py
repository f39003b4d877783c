"""Meshes that a spec names: checked, and known by their content."""

from pathlib import Path

import numpy as np
import trimesh
from studies import SMALL, read

from sweeps.run.plan import canonical_body
from sweeps.spec.errors import SpecError
from warpgrasp.objects.catalogue import body_from_table


def test_meshes_are_checked(tmp_path: Path) -> None:
    mug = trimesh.creation.box((80, 80, 80))
    mug.export(tmp_path / "mug.stl")
    mug.update_faces(np.arange(len(mug.faces)) > 0)
    mug.export(tmp_path / "open.stl")
    (tmp_path / "empty.stl").write_bytes(b"")

    def said(table: str) -> str:
        text = SMALL.replace('"block"', table)
        try:
            return f"ok {read(tmp_path, text).objects[0].name}"
        except SpecError as error:
            return str(error)

    assert said('{ mesh = "mug.stl", units = "mm" }') == "ok mug"
    assert said('{ mesh = "mug.stl", units = "mm", name = "cup" }') == "ok cup"
    for table in ('{ mesh = "mug.stl", units = "m" }', '{ mesh = "open.stl", units = "mm" }',
                  '{ mesh = "mug.stl" }'):
        assert "spec.toml:4: objects[0]: " in said(table)
    assert "spec.toml:4: objects[0].mesh: 'empty.stl' is empty" in said(
        '{ mesh = "empty.stl", units = "mm" }')


def test_a_mesh_is_known_by_its_content_not_its_path(tmp_path: Path) -> None:
    bodies = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        trimesh.creation.box((80, 80, 80)).export(folder / "mug.stl")
        text = SMALL.replace('"block"', '{ mesh = "mug.stl", units = "mm" }')
        bodies.append(read(folder, text).objects[0])
    assert bodies[0].table["mesh"] != bodies[1].table["mesh"]
    assert canonical_body(bodies[0]) == canonical_body(bodies[1])
    body_from_table(bodies[0].table, Path())
    trimesh.creation.box((80, 80, 81)).export(tmp_path / "b" / "mug.stl")
    assert canonical_body(read(tmp_path / "b", text).objects[0]) != canonical_body(bodies[1])
