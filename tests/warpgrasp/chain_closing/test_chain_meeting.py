"""Fingers of a hand of chains that meet: balance of all torques, overlap, what is left alone."""

from dataclasses import replace

import numpy as np
import pytest
from chain_closings import ALONE, QUIET, TABLE, close, poses_above
from reference_chain import ReferenceChain

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, chain_of, hand_of_kind
from warpgrasp.chain.chain_kernel import CAPSULES
from warpgrasp.chain_closing import chain_closing
from warpgrasp.chain_closing.chain_meeting import palm_of
from warpgrasp.chain_closing.chain_self_contact import chain_self_contacts
from warpgrasp.geometry.body import distance_to_bodies, scene_of
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ErrorTable

MEET = replace(ALONE, self_contact=True)
FAR = np.array([[0.4, 0.3, 0.5, 1.0, 0.0, 0.0, 0.0], [0.4, 0.3, 0.5, 0.8, 0.6, 0.0, 0.0]])
"""Two hands with nothing near."""


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances (pair,) of segments (pair, 2, 3), by alternating projections from many starts."""
    def project(points: np.ndarray, segment: np.ndarray) -> np.ndarray:
        along = segment[:, 1] - segment[:, 0]
        share = np.einsum("psi,pi->ps", points - segment[:, None, 0], along)
        share = np.clip(share / (along**2).sum(1)[:, None], 0.0, 1.0)
        return segment[:, None, 0] + share[..., None] * along[:, None]

    x = a[:, None, 0] + np.linspace(0, 1, 9)[:, None] * (a[:, 1] - a[:, 0])[:, None]
    for _ in range(200):
        y = project(x, b)
        x = project(y, a)
    return np.asarray(np.linalg.norm(x - y, axis=2).min(1))


def depths_between(hand: ChainHand, q: np.ndarray) -> np.ndarray:
    """How deep pairs of capsules of the hand press into one another at drives (finger, width)."""
    palm, palm_radius, barred = palm_of(hand)
    ends = [capsule_ends(hand, f, q[f]) for f in range(hand.fingers)]
    whole = hand.fingers * CAPSULES
    pairs, reach = [], []
    for one in range(hand.fingers):
        for c, capsule in enumerate(hand.capsules[one]):
            row = one * CAPSULES + c
            others = [(palm[n], palm_radius[n], whole + n) for n in range(len(palm))]
            others += [(ends[two][d], other.radius, two * CAPSULES + d)
                       for two in range(one + 1, hand.fingers)
                       for d, other in enumerate(hand.capsules[two])]
            for segment, radius, column in others:
                both = capsule.radius + radius
                middles = np.linalg.norm((ends[one][c] - segment).mean(0))
                long = (np.linalg.norm(np.diff(ends[one][c], axis=0))
                        + np.linalg.norm(np.diff(segment, axis=0))) / 2
                if not barred[row, column] and middles < both + long + 1e-3:
                    pairs.append((ends[one][c], segment))
                    reach.append(both)
    if not pairs:
        return np.zeros(0)
    a, b = np.array(pairs).swapaxes(0, 1)
    return np.array(reach) - between(a, b)


@pytest.mark.parametrize("kind", ["allegro", pytest.param("leap", marks=pytest.mark.slow)])
def test_all_torques_of_a_hand_that_meets_are_in_balance(kind: str) -> None:
    hand = chain_of(hand_of_kind(kind))
    commands = chain_commands(hand, "together")
    felt, truth = close(hand, "block", FAR[1:], commands, contact=MEET)
    met = truth.self_contact[:, 0, 0].any(1)
    assert met.any()
    for i in np.flatnonzero(met):
        q, step = truth.rest_rad[i, 0, 0], felt.step[i, 0, 0]
        pose = matrix_of(tuple(FAR[1 + i]))
        fingers = [ReferenceChain(body_from_name("block"), hand, TABLE, pose, f, ALONE)
                   for f in range(hand.fingers)]

        def energy(q: np.ndarray, fingers=fingers, step=step) -> float:
            own = sum(e.energy(q[f, :len(hand.drives[f])],
                               commands[f, step[f], :len(hand.drives[f])])
                      for f, e in enumerate(fingers))
            depth = np.maximum(depths_between(hand, q), 0.0)
            return own + 0.25 * TABLE.skin_stiffness_N_m * float((depth**2).sum())

        assert depths_between(hand, q).max() < 5e-4
        for f in range(hand.fingers):
            for d in range(len(hand.drives[f])):
                turn = np.zeros_like(q)
                turn[f, d] = 1e-6
                slope = (energy(q + turn) - energy(q - turn)) / 2e-6
                assert slope == pytest.approx(0.0, abs=3e-4)


def test_a_robot_tells_its_own_fingers_by_their_angles() -> None:
    hand = chain_of(hand_of_kind("leap"))
    commands = chain_commands(hand, "together")
    felt, truth = close(hand, "block", FAR, commands, contact=MEET)
    poses = FAR[:, None]
    own = chain_self_contacts(felt, poses, commands[None], hand, TABLE, QUIET, ErrorTable.none())
    with pytest.raises(ValueError, match=r"closing.step .*: wants -1 to"):
        chain_self_contacts(felt, poses, commands[None, :, :5], hand, TABLE, QUIET,
                            ErrorTable.none())
    stopped = felt.status == 1
    assert stopped.any()
    assert (own[stopped] == truth.self_contact[stopped]).all()
    short = commands[:, :40]
    felt, _ = close(hand, "block", FAR, short, contact=MEET)
    assert not chain_self_contacts(felt, poses, short[None], hand, TABLE, QUIET,
                                   ErrorTable.none()).any()


@pytest.mark.parametrize("kind", ["allegro", "leap"])
def test_no_step_before_its_stop_stops_a_finger_that_meets_another(kind: str) -> None:
    """Steps are left out where readings are far from the threshold: a path cut short at the stop
    ends at the step before, and there that finger still goes on."""
    hand = chain_of(hand_of_kind(kind))
    commands = chain_commands(hand, "together")
    felt, truth = close(hand, "block", FAR, commands, contact=MEET)
    met = truth.self_contact & (felt.status == 1)
    assert met.any()
    for step in np.unique(felt.step[met]):
        before, _ = close(hand, "block", FAR, commands[:, :step], contact=MEET)
        stopped = met & (felt.step == step)
        assert (before.status[stopped] == 2).all()


def test_fingers_that_do_not_meet_close_as_alone() -> None:
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "curl40")[:, :60]
    alone = close(hand, "block", FAR, commands, contact=ALONE)
    both = close(hand, "block", FAR, commands, contact=MEET)
    assert not both[1].self_contact.any()
    for one, other in zip(alone, both, strict=True):
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_meeting_is_not_simulated_where_it_is_switched_off() -> None:
    hand = chain_of(hand_of_kind("allegro"))
    commands = chain_commands(hand, "together")
    felt, truth = close(hand, "block", FAR, commands, QUIET, ALONE)
    assert (felt.status == 2).all()
    assert depths_between(hand, truth.rest_rad[0, 0, 0]).max() > 1e-3


@pytest.mark.parametrize(("share", "other"), [(1.9, False), (2.1, True)])
def test_a_stop_is_at_another_finger_if_two_skins_give_more_than_twice_what_one_does(
    share: float, other: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Links of fingers at a block, by forward kinematics and sampling, were they also pressed by
    another finger so many times as deep."""
    hand, poses = chain_of(hand_of_kind("allegro")), poses_above(12)
    commands = chain_commands(hand, "curl40")
    felt, alone = close(hand, "block", poses, commands)
    scene, along = scene_of([body_from_name("block")], "cpu"), np.linspace(0, 1, 1001)[:, None]
    deep = np.zeros(alone.link.shape)
    for i, _, _, f in np.argwhere(alone.link >= 0):
        pose = matrix_of(tuple(poses[i]))
        for capsule, (a, b) in zip(hand.capsules[f], capsule_ends(hand, f, alone.q_rad[i, 0, 0, f]),
                                   strict=True):
            places = (a + (b - a) * along) @ pose[:3, :3].T + pose[:3, 3]
            gap = np.minimum(distance_to_bodies(scene, np.zeros(1, int), places[None])[0][0],
                             places[:, 2])
            deep[i, 0, 0, f] = max(deep[i, 0, 0, f], capsule.radius - gap.min())

    def pressed(hand: ChainHand, status: np.ndarray, slack: object, gaps: object, given: dict,
                *others: object) -> None:
        given["truth"].numpy()["self_depth"][...] = share * deep

    monkeypatch.setattr(chain_closing, "resolve_meetings", pressed)
    _, truth = close(hand, "block", poses, commands, contact=MEET)
    stopped = (deep > 5e-5) & (felt.status == 1)
    assert stopped.sum() > 10
    assert (truth.self_contact[stopped] == other).all()
    assert ((truth.link[stopped] < 0) == other).all()
