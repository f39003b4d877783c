"""`warpgrasp show`: a replay of an episode, as one HTML file or live on this machine alone.

It needs viser, an optional dependency. Arm and hand are capsules.
"""

import io
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from sweeps.analysis.rerun_episode import cell_of, choose_episode, in_a_worker
from sweeps.figures.replay_frames import Replay, replay_of, segment_pose
from sweeps.output import extra_hint
from sweeps.result_file import check_result, write_result
from sweeps.run.store import open_study
from sweeps.spec.errors import StoreError

PER_SECOND = 12
LOCAL = "127.0.0.1"
_ARM, _LINK, _FELT = (120, 126, 134), (86, 110, 150), (213, 94, 0)
_TRUE, _ESTIMATE, _CONTACT, _TABLE = (150, 150, 150), (0, 114, 178), (213, 94, 0), (226, 222, 214)
_ARM_RADII_M = 0.07, 0.018
"""Of an arm's first segment and of its last."""


def show(folders: Sequence[Path], out: Path | None, *, strategy: str | None, body: str | None,
         episode: int, live: bool, port: int, device: str) -> int:
    """Runs an episode of a study again and replays it, in a file or live until Ctrl-C."""
    check_viser()
    check_result(out)
    plan, stores = open_study(folders)
    chosen = choose_episode(plan, stores, strategy, body, episode)
    replay = in_a_worker(replay_of, (cell_of(plan, chosen), chosen.episode, device))
    if out is not None:
        write_replay(replay, out)
        print(out)
    if live:
        _play(replay, port)
    return 0


def check_viser() -> None:
    """Raises StoreError, with the command that installs it, where viser is missing."""
    try:
        import viser  # noqa: F401
    except ImportError:
        raise StoreError(f"a replay needs viser: {extra_hint('show')}") from None


def write_replay(replay: Replay, out: Path) -> None:
    """Writes one HTML file that loads nothing; StoreError where it cannot be written."""
    server = _server(0)
    try:
        drawn = _Scene(server, replay)
        serializer = server.get_scene_serializer()
        for frame in range(len(replay.frames)):
            drawn.show(frame)
            serializer.insert_sleep(1.0 / PER_SECOND)
        content = serializer.as_html(dark_mode=False)
    finally:
        _silently(server.stop)
    title = f"<title>{escape(replay.title)}</title>"
    write_result(out, content.replace("<title>Viser</title>", title, 1).encode())


def _play(replay: Replay, port: int) -> None:
    server = _server(port)
    try:
        drawn = _Scene(server, replay)
        with server.gui.add_folder(replay.title):
            slider = server.gui.add_slider("frame", 0, len(replay.frames) - 1, 1, 0)
            playing = server.gui.add_checkbox("play", True)
        slider.on_update(lambda _: drawn.show(int(slider.value)))
        print(f"http://{LOCAL}:{server.get_port()} (Ctrl-C ends it)", flush=True)
        while True:
            time.sleep(1.0 / PER_SECOND)
            if playing.value:
                slider.value = (int(slider.value) + 1) % len(replay.frames)
    finally:
        _silently(server.stop)


def _server(port: int) -> Any:
    import viser

    return _silently(lambda: viser.ViserServer(host=LOCAL, port=port, verbose=False))


def _silently(call: Callable[[], Any]) -> Any:
    """Calls without viser's greeting on stdout, which is for results."""
    with redirect_stdout(io.StringIO()):
        return call()


class _Scene:
    """The objects of a replay in viser; from frame to frame only changed properties are sent."""

    def __init__(self, server: Any, replay: Replay) -> None:
        self.replay, scene = replay, server.scene
        self.sent: dict[tuple[int, str], Any] = {}
        middle = replay.body_m.mean(axis=0)
        farther = max(1.0, float(np.ptp(replay.body_m[:, 2])) / 0.16)
        server.initial_camera.position = tuple(middle + farther * np.array([0.36, 0.26, 0.20]))
        server.initial_camera.fov = 0.8
        server.initial_camera.look_at = tuple(middle)
        server.initial_camera.up = (0.0, 0.0, 1.0)
        scene.set_up_direction("+z")
        scene.add_box("/table", color=_TABLE, dimensions=(0.9, 0.9, 0.02),
                      position=(0.45, 0.0, -0.0101))
        # Its front, though transparent, could hide the estimate: which of two transparent meshes is
        # drawn first the browser decides.
        scene.add_mesh_simple("/object", replay.body_m.astype(np.float32),
                              _triangles(replay.body_faces), color=_TRUE, opacity=0.45,
                              side="back")
        first = replay.frames[0]
        lengths = _lengths(np.stack([first.arm_m[:-1], first.arm_m[1:]], 1))
        self.arm = [_capsule(scene, f"/arm/{n}", length, radius, _ARM) for n, (length, radius)
                    in enumerate(zip(lengths, np.linspace(*_ARM_RADII_M, len(lengths)),
                                     strict=True))]
        self.palm = [_capsule(scene, f"/palm/{n}", length, radius, _LINK)
                     for n, (length, radius) in enumerate(zip(
                         _lengths(replay.hand.bars_m), replay.hand.bar_radius_m, strict=True))]
        self.fingers = [[_capsule(scene, f"/finger/{f}/{n}", length, radius, _LINK)
                         for n, (length, radius) in enumerate(zip(
                             _lengths(links), radii, strict=False))]
                        for f, (links, radii) in enumerate(zip(
                            first.links_m, replay.hand.link_radius_m, strict=True))]
        self.contacts = [scene.add_icosphere(f"/contact/{n}", radius=0.0035, color=_CONTACT,
                                             subdivisions=1, position=tuple(at), visible=False)
                         for n, at in enumerate(replay.contacts_m)]
        self.estimates = [scene.add_mesh_simple(
            f"/estimate/{n}", grid.reshape(-1, 3).astype(np.float32), _grid_triangles(grid),
            color=_ESTIMATE, opacity=0.55, side="double", visible=False)
            for n, grid in enumerate(replay.estimates_m)]
        top = tuple(middle + [0.0, 0.0, -0.55 * np.ptp(replay.body_m[:, 2]) - 0.05])
        self.labels = {text: scene.add_label(f"/label/{n}", text, position=top, visible=False)
                       for n, text in enumerate(dict.fromkeys(f.label for f in replay.frames))}
        self.show(0)

    def show(self, number: int) -> None:
        """Moves all objects to a frame."""
        frame = self.replay.frames[number]
        for handle, (a, b) in zip(self.arm, pairwise(frame.arm_m), strict=True):
            self._place(handle, a, b)
        for handle, (a, b) in zip(self.palm, frame.in_base(self.replay.hand.bars_m), strict=True):
            self._place(handle, a, b)
        for handles, links, felt in zip(self.fingers, frame.links_m, frame.felt, strict=True):
            for handle, (a, b) in zip(handles, links, strict=False):  # others have more links
                self._place(handle, a, b)
            self._set(handles[-1], color=_tip_colour(float(felt)))
        for n, handle in enumerate(self.contacts):
            self._set(handle, visible=n < frame.contacts)
        for n, handle in enumerate(self.estimates):
            self._set(handle, visible=n == frame.estimate)
        for text, handle in self.labels.items():
            self._set(handle, visible=text == frame.label)

    def _place(self, handle: Any, a: np.ndarray, b: np.ndarray) -> None:
        middle, turn = segment_pose(a, b)
        self._set(handle, position=tuple(np.round(middle, 5)), wxyz=_wxyz(turn))

    def _set(self, handle: Any, **values: Any) -> None:
        for name, value in values.items():
            key = (id(handle), name)
            if key not in self.sent or self.sent[key] != value:
                self.sent[key] = value
                setattr(handle, name, value)


def _tip_colour(level: float) -> tuple[int, ...]:
    """From the link's colour without contact to that of a full contact at level 1."""
    share = 0.0 if level <= 0.0 else 0.35 + 0.65 * min(level, 1.0)
    return tuple(round(a + share * (b - a)) for a, b in zip(_LINK, _FELT, strict=True))


def _capsule(scene: Any, name: str, length: float, radius: float, colour: tuple) -> Any:
    mesh = trimesh.creation.capsule(length, radius, count=(8, 12))
    return scene.add_mesh_simple(name, mesh.vertices.astype(np.float32),
                                 mesh.faces.astype(np.uint32), color=colour)


def _lengths(ends_m: np.ndarray) -> np.ndarray:
    """Of segments (n, 2, 3)."""
    return np.linalg.norm(ends_m[:, 1] - ends_m[:, 0], axis=1)


def _triangles(quads: np.ndarray) -> np.ndarray:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32)


def _grid_triangles(grid: np.ndarray) -> np.ndarray:
    rows, columns = grid.shape[:2]
    n = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return _triangles(np.stack([n, n + columns, n + columns + 1, n + 1], axis=1))


def _wxyz(turn: Rotation) -> tuple[float, ...]:
    x, y, z, w = np.round(turn.as_quat(), 5)
    return (w, x, y, z)
