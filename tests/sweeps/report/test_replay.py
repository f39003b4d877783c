"""A replay: frames that agree with the robot's own kinematics, and a page that plays offline."""

import base64
import csv
import io
import pickle
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch
from urllib.request import urlopen

import browser as browser_module
import numpy as np
import pytest
from browser import FLAGS, asked_for, browser, needs_browser
from curved_episodes import wide_study, wide_text
from PIL import Image
from scipy.spatial.transform import Rotation

from strategies.poses.waypoints import Ring
from strategies.ready_made import STRATEGIES
from strategies.strategy import Strategy
from sweeps.episode.contact_rows import contacts_csv
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.figures.grasp import grasp_figure, hand_solids
from sweeps.figures.replay_frames import (
    Frame,
    HandShape,
    Replay,
    _reach,
    _so_far,
    arm_points,
    make_replay,
    replay_of,
)
from sweeps.figures.style import encode
from sweeps.report import replay
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError
from warpgrasp.arms.arm_file import SHIPPED_ARMS
from warpgrasp.hand_capsules import capsules_of_hand
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.mechanism.arm import arm_home
from warpgrasp.mechanism.puma560 import puma_forward_batch, puma_inverse_batch
from warpgrasp.parameters import FLOATING, PUMA560, ArmTable, HandTable
from warpgrasp.probe_status import ProbeStatus

CELL = Cell(Strategy("ring3", (Ring(count=3),), ("curl40", "base_then_curl")),
            {"name": "large_cylinder"}, "large_cylinder", seed=3)


@pytest.fixture(scope="module")
def played() -> tuple[Replay, EpisodeBlock]:
    block = run_block(CELL, np.arange(1), "cpu")
    return make_replay(CELL, block), block


def test_arm_points_end_at_the_flange() -> None:
    q = np.random.default_rng(1).uniform(-2, 2, (20, 6))
    for joints, flange in zip(q, puma_forward_batch(ArmTable(), q), strict=True):
        points, turn = arm_points(ArmTable(), joints, 0.0)
        assert np.allclose(points[-1], flange[:3], atol=1e-9)
        apart = Rotation.from_quat(turn).inv() * Rotation.from_quat(flange[3:])
        assert apart.magnitude() < 1e-7
    reach = np.linalg.norm(np.diff(arm_points(ArmTable(), q[0], 0.1)[0], axis=0), axis=1)
    assert reach == pytest.approx([0.67183, 0.4318, np.hypot(0.15005, 0.0203), 0.4318, 0.1])


def test_an_arm_is_drawn_within_its_limits_wherever_it_comes_from() -> None:
    """Though a branch beyond them be nearer, or the same joints a whole turn on."""
    arm, hand = ArmTable(), HandTable()
    cell: Any = SimpleNamespace(arm=arm, hand=hand)
    low, high = np.array(arm.limit_low_rad), np.array(arm.limit_high_rad)
    beyond = 0
    for q in np.random.default_rng(3).uniform(low, high, (12, 6)):
        points, turn = arm_points(arm, q, hand.mount_length_m)
        pose = np.array([*points[-1], *turn])
        flange = np.array([*arm_points(arm, q, 0.0)[0][-1], *turn])
        for near in puma_inverse_batch(arm, flange[None])[0]:
            if not np.isfinite(near).all():
                continue
            found = _reach(cell, pose, near)
            assert ((found >= low) & (found <= high)).all()
            np.testing.assert_allclose(arm_points(arm, found, hand.mount_length_m)[0][-1],
                                       points[-1], atol=1e-6)
            beyond += int(((near < low) | (near > high)).any())
    assert beyond > 0


def test_slots_are_filled_probe_by_probe() -> None:
    assert _so_far((3, 6)).tolist() == [[True] * n + [False] * (6 - n) for n in (2, 4, 6)]


@pytest.mark.slow
def test_frames_are_what_the_robot_read(played: tuple[Replay, EpisodeBlock]) -> None:
    made, block = played
    (grasps,) = block.grasps
    status = grasps.closing.status[0]
    assert len(made.contacts_m) == (status == ProbeStatus.CONTACT).sum() > 0
    counts = [frame.contacts for frame in made.frames]
    assert counts == sorted(counts)
    assert counts[-1] == len(made.contacts_m)
    believed = [frame.estimate for frame in made.frames]
    assert believed == sorted(believed)
    assert believed[-1] == len(made.estimates_m) - 1
    poses = grasps.moves.believed_pose[0]
    for number in range(3):
        label = f"containment, pose {number + 1} of 3"
        there = [f for f in made.frames if f.label == label]
        if not there:
            assert [f.label for f in made.frames if f.label.startswith(label)] in (
                [f"{label}: collision"], [f"{label}: unreachable"])
            continue
        assert np.allclose(there[-1].arm_m[-1], poses[number, :3], atol=1e-3)
    last_tip = np.array([f.links_m[:, -1, 1] for f in made.frames])
    jumps = np.linalg.norm(np.diff(last_tip, axis=0), axis=2)
    assert jumps.max() < 0.8  # from home to the first pose in four frames
    for frame in made.frames:
        ends = frame.links_m
        assert np.allclose(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2),
                           HandTable().link_length_m)
        assert np.allclose(ends[:, 1:, 0], ends[:, :-1, 1])


def test_a_hand_of_chains_is_drawn_as_it_is_with_contacts_where_the_body_has_them() -> None:
    """Contacts as `contacts.csv` has them; links as they lie when fingers have closed."""
    hand = HandTable(kind="barrett")
    cell = replace(CELL, hand=hand, arm=ArmTable(kind=FLOATING))
    block = run_block(cell, np.arange(1), "cpu")
    made = make_replay(cell, block)
    rows = list(csv.DictReader(io.StringIO(contacts_csv(block.exploration, block.truth))))
    places = [[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows
              if row["status"] == "contact"]
    assert np.allclose(made.contacts_m, places, atol=1e-6)
    assert (block.exploration.placed.mask[0]).sum() > 3
    grasps, = block.grasps
    assert not np.allclose(made.contacts_m, grasps.estimate.point_m[0][
        grasps.closing.status[0] == ProbeStatus.CONTACT], atol=1e-3)
    capsules = capsules_of_hand(hand)
    assert [len(radii) for radii in made.hand.link_radius_m] == capsules.count.tolist()
    assert len(set(made.hand.link_radius_m[0])) > 1
    for frame in made.frames:
        assert np.isfinite(frame.links_m).all()
        assert np.linalg.norm(frame.links_m - frame.arm_m[-1], axis=-1).max() < 0.35
    drawn = hand_solids(made, made.frames[-1])[len(made.hand.bar_radius_m):]
    segments = [segment for finger, radii in zip(made.frames[-1].links_m, made.hand.link_radius_m,
                                                 strict=True) for segment in finger[:len(radii)]]
    radii = [radius for finger in made.hand.link_radius_m for radius in finger]
    for (faces, _), (start, end), radius in zip(drawn, segments, radii, strict=True):
        along = np.clip((faces - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
        away = np.linalg.norm(faces - start - along[..., None] * (end - start), axis=-1)
        assert np.allclose(away, radius, atol=1e-9)


@pytest.mark.slow
def test_the_last_estimate_is_what_was_recovered(
        played: tuple[Replay, EpisodeBlock]) -> None:
    made, block = played
    assert block.status[0] == "ok"
    centre = block.recovered.superquadric.position_m[0]
    box = made.estimates_m[-1].reshape(-1, 3)
    assert np.allclose((box.min(0) + box.max(0)) / 2, centre, atol=0.02)


@pytest.mark.slow
def test_a_file_that_loads_nothing(played: tuple[Replay, EpisodeBlock], tmp_path: Path) -> None:
    pytest.importorskip("viser")
    out = tmp_path / "replay.html"
    replay.write_replay(played[0], out)
    content = out.read_bytes()
    assert len(content) <= 2e6
    assert content.lstrip()[:9].lower() == b"<!doctype"


@pytest.mark.parametrize("name", [PUMA560, FLOATING, *SHIPPED_ARMS])
def test_every_arm_is_drawn(name: str, tmp_path: Path) -> None:
    """Arms differ in their number of joints; a segment is not thicker than the one before it."""
    pytest.importorskip("viser")
    arm = ArmTable(kind=name)
    places, turn = arm_points(arm, arm_home(arm), 0.1)
    frame = Frame(places, turn, np.zeros((1, 1, 2, 3)), np.zeros(1), 0, -1, "home")
    body = np.array([[0.4, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0.1], [0.4, 0.1, 0.1]])
    made = Replay("an arm", (frame, frame), np.zeros((0, 3)), (), body, np.array([[0, 1, 2, 3]]),
                  HandShape(((0.01,),), np.zeros((1, 2, 3)), np.array([0.02])))
    with patch.object(replay, "_capsule", wraps=replay._capsule) as drawn:
        replay.write_replay(made, tmp_path / "replay.html")
    radii = [call.args[3] for call in drawn.call_args_list if call.args[1].startswith("/arm/")]
    assert len(radii) == len(places) - 1
    assert radii == sorted(radii, reverse=True)


def test_a_frame_shows_the_contacts_and_the_estimate_made_so_far() -> None:
    places, turn = arm_points(ArmTable(), arm_home(ArmTable()), 0.1)
    frames = tuple(Frame(places, turn, np.zeros((1, 1, 2, 3)), np.zeros(1), contacts, estimate, "f")
                   for contacts, estimate in ((0, -1), (2, 0), (3, 1)))
    body = np.array([[0.4, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0.1], [0.4, 0.1, 0.1]])
    made = Replay("it", frames, np.zeros((3, 3)), (body.reshape(2, 2, 3),) * 2, body,
                  np.array([[0, 1, 2, 3]]),
                  HandShape(((0.01,),), np.zeros((1, 2, 3)), np.array([0.02])))
    server = MagicMock()  # every handle is another object
    for add in (server.scene.add_icosphere, server.scene.add_mesh_simple):
        add.side_effect = lambda *given, **named: SimpleNamespace()
    drawn = replay._Scene(server, made)
    for number in (2, 0, 1):
        drawn.show(number)
        assert sum(handle.visible for handle in drawn.contacts) == frames[number].contacts
        assert [handle.visible for handle in drawn.estimates] == [
            n == frames[number].estimate for n in range(2)]


def test_a_page_is_named_and_its_object_hides_no_estimate(tmp_path: Path) -> None:
    """The browser may draw the object before an estimate inside it: its back alone is drawn."""
    viser = pytest.importorskip("viser")
    arm = ArmTable(kind=FLOATING)
    places, turn = arm_points(arm, arm_home(arm), 0.1)
    frame = Frame(places, turn, np.zeros((1, 1, 2, 3)), np.zeros(1), 0, 0, "home")
    body = np.array([[0.4, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0.1], [0.4, 0.1, 0.1]])
    made = Replay("<b> & an arm", (frame, frame), np.zeros((0, 3)), (body.reshape(2, 2, 3),), body,
                  np.array([[0, 1, 2, 3]]),
                  HandShape(((0.01,),), np.zeros((1, 2, 3)), np.array([0.02])))
    add = viser.SceneApi.add_mesh_simple
    with patch.object(viser.SceneApi, "add_mesh_simple", autospec=True, side_effect=add) as drawn:
        replay.write_replay(made, tmp_path / "replay.html")
    sides = {call.args[1]: call.kwargs.get("side") for call in drawn.call_args_list}
    assert (sides["/object"], sides["/estimate/0"]) == ("back", "double")
    text = (tmp_path / "replay.html").read_text()
    assert text.count("<title>") == 1
    assert "<title>&lt;b&gt; &amp; an arm</title>" in text


def test_an_episode_without_motion_is_said(tmp_path: Path) -> None:
    """And one whose robot cannot be run."""
    hand = replace(hand_named("barrett"), opposed=None)
    own = tmp_path / "hand.toml"
    own.write_text(hand_text(replace(hand, fingers=tuple(
        replace(finger, pads=(), pad_places=()) for finger in hand.fingers), extended=None)))
    cell = replace(CELL, strategy=STRATEGIES["contour-only"], hand=HandTable(kind=str(own)),
                   arm=ArmTable(kind=FLOATING))
    with pytest.raises(StoreError, match="nothing to replay: the episode ended not_possible"):
        replay_of((cell, 0, "cpu"))
    with (patch("sweeps.figures.replay_frames.run_block", side_effect=ValueError("it sags")),
          pytest.raises(StoreError, match="nothing to replay: the episode fails: it sags")):
        replay_of((cell, 0, "cpu"))


LIVE = """
import pickle, signal, sys
from pathlib import Path
from sweeps.cli import main as cli; from sweeps.report import replay
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
replay.in_a_worker = lambda function, task: pickle.loads(Path(sys.argv[1]).read_bytes())
cli.main(["show", sys.argv[2], "--live", "--port", sys.argv[3]])
"""  # the episode itself is not run again: that is tested elsewhere, and takes its time


@pytest.mark.slow
def test_live_on_this_machine_alone(played: tuple[Replay, EpisodeBlock], tmp_path: Path) -> None:
    """Serves its page on 127.0.0.1, is not there on any other address, and ends by Ctrl-C."""
    pytest.importorskip("viser")
    _, store = wide_study(tmp_path / "study", wide_text(1, 1, 2))
    (tmp_path / "replay").write_bytes(pickle.dumps(played[0]))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-c", LIVE, str(tmp_path / "replay"), str(store.folder), str(port)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout
        assert process.stdout.readline() == f"http://127.0.0.1:{port} (Ctrl-C ends it)\n"
        with urlopen(f"http://127.0.0.1:{port}", timeout=30) as page:
            assert page.read(15).lower() == b"<!doctype html>"
        listening = [line.split()[1] for name in ("tcp", "tcp6")
                     for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]
                     if line.split()[3] == "0A" and line.split()[1].endswith(f":{port:04X}")]
        assert listening == [f"0100007F:{port:04X}"]
        for address in own_addresses():
            with pytest.raises(ConnectionRefusedError), socket.create_connection(
                    (address, port), timeout=10):
                pass
        time.sleep(1.0)  # it plays
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert out == ""
    assert err == "interrupted; what was finished is kept\n"


def own_addresses() -> list[str]:
    """This machine's addresses other than 127.0.0.1; the loopback's others are its own too."""
    try:
        found = {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None)}
    except OSError:
        found = set()
    return sorted(found - {"127.0.0.1", "::1"} | {"127.0.0.2"})


@pytest.mark.slow
def test_a_figure_of_the_hand_on_the_object(played: tuple[Replay, EpisodeBlock]) -> None:
    first, second = (encode(grasp_figure(played[0], "large_cylinder"), "png") for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        r, g, b = np.moveaxis(np.asarray(image.convert("RGB")).astype(int), -1, 0)
    assert ((b - r > 30) & (b > 80)).mean() > 0.02  # the hand
    assert ((r - b > 100) & (r > g + 60)).mean() > 0.002  # tips that feel
    numb = replace(played[0], frames=tuple(replace(f, felt=np.zeros(4)) for f in played[0].frames))
    with pytest.raises(StoreError, match="no finger felt"):
        grasp_figure(numb, "large_cylinder")


@needs_browser
@pytest.mark.slow
def test_in_a_browser(played: tuple[Replay, EpisodeBlock], tmp_path: Path,
                      monkeypatch: pytest.MonkeyPatch) -> None:
    """Plays without a network: the body, the estimate and contacts are on the screen."""
    pytest.importorskip("viser")
    from selenium.common.exceptions import TimeoutException

    flags = [flag for flag in FLAGS if flag != "--disable-gpu"]
    monkeypatch.setattr(browser_module, "FLAGS", (
        *flags, "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"))
    out = tmp_path / "replay.html"
    replay.write_replay(played[0], out)
    with browser() as driver:
        driver.set_window_size(640, 480)
        driver.get(out.as_uri())
        seen: set[str] = set()
        deadline = time.monotonic() + 240
        while seen < {"blue", "orange"} and time.monotonic() < deadline:
            time.sleep(2)
            file = tmp_path / "shot.png"
            try:
                file.write_bytes(base64.b64decode(driver.get_screenshot_as_base64()))
            except TimeoutException:  # WebGL in software, on a busy machine
                continue
            with Image.open(file) as image:
                shown = np.asarray(image.convert("RGB")).astype(int)[:, 200:]
            r, g, b = np.moveaxis(shown, -1, 0)
            seen |= {"blue"} if ((b - r > 40) & (b > 90)).sum() > 60 else set()
            seen |= {"orange"} if ((r - b > 60) & (r > g + 25)).sum() > 4 else set()
        assert seen == {"blue", "orange"}
        asked = [a for a in asked_for(driver) if not a.startswith(("data:", "blob:"))]
        assert asked == [out.as_uri()]
