"""The command `export`: files by their ending, errors that name what would be right."""

import xml.etree.ElementTree as ET

import pytest

from sweeps.cli.main import run


@pytest.mark.parametrize("name", ["hand.xml", "hand.urdf"])
def test_hand_and_object(tmp_path, capsys, name: str) -> None:
    assert run(["export", str(tmp_path / name), "--object", "wedge"]) == 0
    assert str(tmp_path / name) in capsys.readouterr().out
    root = ET.parse(tmp_path / name).getroot()
    assert root.tag == {"hand.xml": "mujoco", "hand.urdf": "robot"}[name]
    assert (tmp_path / "hand_object_0.obj").exists() == (name == "hand.urdf")


def test_files_of_the_user_are_kept_unless_forced(tmp_path, capsys) -> None:
    for name in ("mine.urdf", "wine_object_0.obj"):  # the second is a mesh beside wine.urdf
        (tmp_path / name).write_text("mine")
    for file, at in (("mine.urdf", "mine.urdf"), ("wine.urdf", "wine_object_0.obj")):
        said = f"{tmp_path / at}: exists already; choose another name, or use --force"
        words = ["export", str(tmp_path / file), "--object", "wedge"]
        assert run(words) == 2
        assert said in capsys.readouterr().err
        assert (tmp_path / at).read_text() == "mine"
        assert (tmp_path / file).exists() == (file == at)
        assert run([*words, "--force"]) == 0
        assert (tmp_path / at).read_text() != "mine"


def test_a_member_of_a_family(tmp_path) -> None:
    assert run(["export", str(tmp_path / "hand.xml"), "--object", "hammer-1"]) == 0
    assert "object" in (tmp_path / "hand.xml").read_text()


def test_the_whole_robot(tmp_path) -> None:
    assert run(["export", str(tmp_path / "robot.xml"), "--arm"]) == 0
    joints = list(ET.parse(tmp_path / "robot.xml").getroot().iter("joint"))
    assert len(joints) == 22


@pytest.mark.parametrize(("arguments", "said"), [
    (["robot.sdf"], r"\.xml"), (["hand.xml", "--object", "blok"], "block")])
def test_what_is_wrong_is_said(tmp_path, capsys, arguments: list[str], said: str) -> None:
    assert run(["export", str(tmp_path / arguments[0]), *arguments[1:]]) == 2
    import re

    assert re.search(said, capsys.readouterr().err)
