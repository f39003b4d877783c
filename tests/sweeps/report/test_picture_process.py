"""Figures drawn by a process of their own: the same bytes, errors as data, and none left behind."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from places import PYTHONPATH

from sweeps.figures.contacts import ContactsShown, draw_contacts
from sweeps.report import picture_process
from sweeps.report.picture_process import Drawn, PictureProcess, attempt
from warpgrasp.core.cores import core_count


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
        assert pictures._process is not None or core_count() < 2
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
def test_what_a_fork_did_not_draw_is_drawn_again() -> None:
    """In a fresh process, since this one has threads. The second figure ends the fork alone."""
    code = ("import os; from sweeps.report.picture_process import _draw; mine = os.getpid()\n"
            "def draw(what):\n"
            "    os.getpid() == mine or what != 2 or os._exit(1)\n"
            "    return b'%d, %d' % (what, os.getpid() == mine)\n"
            "print(_draw([(draw, 1), (draw, 2), (draw, 3)]))")
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": PYTHONPATH})
    assert done.stdout.strip() == "[b'1, 1', b'2, 1', b'3, 0']"


def test_what_is_not_drawn_leaves_no_process() -> None:
    with PictureProcess() as pictures:
        process = pictures._process
    assert process is None or process.returncode is not None


def test_an_attempt_brings_the_error() -> None:
    error = attempt(fail, "no")
    assert isinstance(error, ValueError)
    assert str(error) == "no"
