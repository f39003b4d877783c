"""The paper's experiments: small ones give the same bytes twice; the shipped ones are current."""


import numpy as np
import pytest
from places import ROOT

from sweeps.paper.bottles import bottle_rows, follow_bottles
from sweeps.paper.command import documents, paper
from sweeps.paper.faces import cases, explore_faces, face_rows, typical_sizes
from sweeps.paper.recovery import recover_objects

DOCS = ROOT / "docs" / "paper"


def test_faces_and_bottles_twice_the_same() -> None:
    chosen = [cases()[0], cases()[-1]]
    rows = face_rows(explore_faces(3, chosen))
    assert rows == face_rows(explore_faces(3, chosen))
    assert float(rows[0][5]) == pytest.approx(90.0, abs=2.0)
    assert typical_sizes(explore_faces(3, chosen))[0][0] == "mount slips between the faces"
    bottles = bottle_rows(follow_bottles(2))
    assert {row[-1] for row in bottles} == {"1.00"}


@pytest.mark.slow
def test_documents_twice_the_same() -> None:
    def once() -> dict[str, bytes]:
        return documents(recover_objects(2), explore_faces(3, cases()[-3:]), follow_bottles(2))

    one, two = once(), once()
    assert one == two
    assert np.all([len(content) > 0 for content in one.values()])


@pytest.mark.slow
def test_the_shipped_documents_are_current(tmp_path) -> None:
    paper(tmp_path)
    for file in sorted(DOCS.iterdir()):
        assert (tmp_path / file.name).read_bytes() == file.read_bytes(), file.name
