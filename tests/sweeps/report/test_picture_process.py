"""Figures drawn by a process of their own: the same bytes, errors as data, and none left behind."""

import os
import pickle
from typing import Any

import numpy as np
import pytest

from sweeps.figures.contacts import ContactsShown, draw_contacts
from sweeps.report import picture_process
from sweeps.report.picture_process import Drawn, PictureProcess, attempt


def a_box() -> ContactsShown:
    """A cube of 40 mm on the table, one contact on its top."""
    low = np.array([[0.0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]])
    sides = [low, low[::-1] + [0, 0, 1]]
    for axis in (0, 1):
        side = np.roll(low, axis + 1, axis=1)
        sides += [side, side[::-1] + np.eye(3)[axis]]
    faces = 40.0 * np.array(sides) - [20.0, 20.0, 0.0]
    return ContactsShown("box", "recovered body", False, faces, faces,
                         np.array([[0.0, 0.0, 40.0]]), np.array([True]))


def fail(what: str) -> bytes:
    raise ValueError(what)


def drawn_by_a_process(jobs: list[Any]) -> list[Drawn]:
    with PictureProcess() as pictures:
        assert pictures._process is not None or (os.cpu_count() or 1) < 2
        pictures.begin(jobs)
        return pictures.finish()


def test_a_process_draws_what_is_drawn_here_and_tells_what_it_could_not() -> None:
    here = draw_contacts(a_box())
    assert here.startswith(b"\x89PNG")
    first, wrong, last = drawn_by_a_process([
        (draw_contacts, a_box()), (draw_contacts, None), (draw_contacts, a_box())])
    assert first == last == here
    assert isinstance(wrong, AttributeError)


def test_figures_are_drawn_here_where_the_process_ends_early(
        monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*given: Any, **also: Any) -> None:
        raise OSError("no process")

    monkeypatch.setattr(picture_process.subprocess, "Popen", fails)
    with PictureProcess() as pictures:
        pictures.begin([(draw_contacts, a_box())])
        drawn, = pictures.finish()
    assert isinstance(drawn, bytes)
    monkeypatch.undo()
    with PictureProcess() as pictures:
        if pictures._process is not None:
            pictures._process.kill()
            pictures._process.wait()
        pictures.begin([(draw_contacts, a_box())])
        assert pictures.finish() == [drawn]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no forks")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # from Python 3.12 on
def test_a_fork_that_dies_leaves_its_figure_to_the_others() -> None:
    """Whoever draws it again may succeed: here the fork alone has no memory left for it."""
    asked: list[int] = []
    mine = os.getpid()

    def draw(shown: int) -> bytes:
        if os.getpid() != mine:
            os._exit(1)
        asked.append(shown)
        return pickle.dumps(shown)

    found = picture_process._draw([(draw, 1), (draw, 2)])
    assert found == [pickle.dumps(1), pickle.dumps(2)]
    assert asked == [1, 2]


def test_what_is_not_drawn_leaves_no_process() -> None:
    with PictureProcess() as pictures:
        process = pictures._process
    assert process is None or process.returncode is not None


def test_an_attempt_brings_the_error() -> None:
    error = attempt(fail, "no")
    assert isinstance(error, ValueError)
    assert str(error) == "no"
