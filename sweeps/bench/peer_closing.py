"""One closing for every peer: the hand straight above the small cylinder, pointing down.

The base joints close from -10 to 60 degrees in half degrees, without noise. Middle finger and thumb
meet the cylinder's side, the outer fingers pass beside it.
"""

from collections.abc import Callable

import numpy as np

from warpgrasp.parameters import ContactTable, HandTable, SensorTable

HAND = HandTable()
QUIET = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0)
RADIUS_M, HEIGHT_M = 0.020, 0.090
THRESHOLD_N = QUIET.tendon_threshold_N
HAND_POSE = np.array([0.0, 0.0, HEIGHT_M + 0.060 + HAND.abduction_offset_m, 1.0, 0.0, 0.0, 0.0])
COUNT = 141
COMMANDS_RAD = np.zeros((1, 4, COUNT, 4))
COMMANDS_RAD[..., 1] = np.radians(np.linspace(-10.0, 60.0, COUNT))


def _close(worlds: int, count: int, sensors: SensorTable):
    from warpgrasp.closing.closing import close_fingers
    from warpgrasp.geometry.body import scene_of
    from warpgrasp.objects.catalogue import body_from_name

    scene = scene_of([body_from_name("small_cylinder")], "cpu")
    stands = np.tile([0, 0, 0, 0, 0, 0, 1.0], (worlds, 1))
    pose = np.tile(HAND_POSE, (worlds, 1, 1))
    made = np.ones((worlds, 1, 1), int)
    key = np.arange(worlds, dtype=np.uint64)
    return lambda: close_fingers(scene, np.zeros(1, int), stands, HAND, sensors, key, made, pose,
                                 COMMANDS_RAD[:, :, :count], np.array([count]),
                                 contact=ContactTable.none())


def ours(batch: int) -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """Our kernel on `batch` hands: a call that closes them, and the steps of one's stops, (4,)."""
    close = _close(batch, COUNT, QUIET)

    def call() -> int:
        return close()[0].status.size

    return call, lambda: close()[0].step[0, 0, 0]


def rest_tips() -> tuple[int, np.ndarray]:
    """A step at which fingers press, and the fingertips' centres at rest there [m], (4, 3)."""
    from warpgrasp.mechanism.utah_mit_hand import hand_links

    stop = int(_close(1, COUNT, QUIET)()[0].step[0, 0, 0].min())
    _, truth = _close(1, stop + 1, SensorTable(tension_noise_N=0.0, tendon_threshold_N=1e3))()
    points, _ = hand_links(HAND, HAND_POSE[None], truth.q_rad[0, 0])
    return stop, points[0, :, 4]
