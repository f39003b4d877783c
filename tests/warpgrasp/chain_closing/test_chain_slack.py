"""How near pairs of capsules come on their way: a bound for every robot, at any two steps."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from chain_closings import ALONE, QUIET, TABLE

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import capsule_ends, chain_of, hand_of_kind
from warpgrasp.chain.chain_kernel import JOINTS
from warpgrasp.chain_closing.chain_closing import close_chains
from warpgrasp.chain_closing.chain_meeting import CLOSE_M, pairs_on_device
from warpgrasp.chain_closing.chain_path import come_bounds
from warpgrasp.chain_closing.chain_slack import pair_slack, path_gaps
from warpgrasp.core.dtypes import real
from warpgrasp.geometry.body import scene_of
from warpgrasp.mechanism.calibration import draw_calibration
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ErrorTable


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances of segments (..., 2, 3), from above: by samples of one, projected on the other."""
    share = np.linspace(0.0, 1.0, 21)[:, None]
    points = a[..., None, 0, :] + share * (a[..., 1, :] - a[..., 0, :])[..., None, :]
    start, along = b[..., 0, :], b[..., 1, :] - b[..., 0, :]
    t = np.einsum("...si,...i->...s", points - start[..., None, :], along)
    t = np.clip(t / (along**2).sum(-1)[..., None], 0.0, 1.0)
    foot = start[..., None, :] + t[..., None] * along[..., None, :]
    return np.asarray(np.linalg.norm(points - foot, axis=-1).min(-1))


@pytest.mark.parametrize("kind", [
    "barrett", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("allegro", "leap"))])
def test_no_robot_brings_capsules_nearer_than_their_slack(kind: str) -> None:
    """Fingers that touch nothing, by joint sensors off their zeros and by what links weigh, with
    the hand turned any way."""
    hand = chain_of(hand_of_kind(kind))
    contact = replace(ALONE, weight=True)
    commands = chain_commands(hand, "base_then_curl")[None]
    steps = np.linspace(1, commands.shape[2], 9).astype(int)
    key = np.arange(3, dtype=np.uint64)
    errors = draw_calibration(
        replace(ErrorTable.none(), joint_offset_rad=np.radians(0.5)), key, fingers=hand.fingers,
        joints=JOINTS, links=JOINTS)
    palm, _, pairs = pairs_on_device(hand, CLOSE_M, "cpu")
    come = wp.array(come_bounds(hand, TABLE, contact, errors, commands), dtype=real, device="cpu")
    gaps = path_gaps(hand, commands, come, palm, pairs, "cpu")
    order, slack = pair_slack(hand, TABLE, contact, errors, commands, gaps, pairs, "cpu")
    turns = np.random.default_rng(0).normal(size=(3, 4, 4))
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    poses = np.concatenate([np.tile([1.0, 1.0, 2.0], (3, 4, 1)), turns], -1)
    q = np.array([close_chains(
        scene_of([body_from_name("block")], "cpu"), np.zeros(1, int),
        np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1)), hand, TABLE,
        replace(QUIET, torque_threshold_Nm=10.0), key, np.ones((3, 4, 1), int), poses,
        commands[:, :, :step], np.array([step]), contact=contact, errors=errors)[1].q_rad[:, :, 0]
        for step in steps])  # (step, world, probe, finger, width)
    ends = [capsule_ends(hand, f, q[..., f, :]) for f in range(hand.fingers)]
    bars, rows = palm.numpy(), pairs.numpy()
    nearest = np.empty((3, len(rows)))
    for k, row in enumerate(rows):
        one = ends[row["one"]][..., row["capsule"], :, :]
        other = bars[None, None, None, None, row["other"]] if row["two"] < 0 else (
            ends[row["two"]][None, ..., row["other"], :, :])
        nearest[:, k] = (apart(one[:, None], other) - row["both"]).min((0, 1, 3))
    bound = np.empty_like(nearest)
    np.put_along_axis(bound, order.numpy()[:, 0], slack.numpy()[:, 0], -1)
    assert (np.diff(slack.numpy(), axis=-1) >= 0.0).all()
    assert (bound <= nearest + 1e-9).all()
    # Nor are they told to be much nearer than they come on the way that is believed.
    believed = [capsule_ends(hand, f, commands[0, f, ::2]) for f in range(hand.fingers)]
    for k, row in enumerate(rows):
        one = believed[row["one"]][:, None, row["capsule"]]
        other = bars[None, None, row["other"]] if row["two"] < 0 else (
            believed[row["two"]][None, :, row["other"]])
        least = (apart(one, other) - row["both"]).min()
        assert least - 4e-3 < gaps[0, k] < least + 1e-9 or (least > 0.09 and gaps[0, k] < least)
