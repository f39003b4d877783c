"""Hands as capsules: two descriptions of one hand agree, and balls fill what they stand for."""

from importlib.resources import files

import numpy as np
import pytest

from warpgrasp.hand_capsules import balls_within, capsules_of_hand
from warpgrasp.parameters import HandTable

AS_CHAIN = HandTable(kind=str(files("warpgrasp.hands") / "data" / "utah_mit.toml"))
RNG = np.random.default_rng(8)


def test_the_utah_mit_hand_is_the_same_by_its_numbers_and_as_chains() -> None:
    own, chain = capsules_of_hand(HandTable()), capsules_of_hand(AS_CHAIN)
    low, high = np.radians([-25, -20, -10, -10]), np.radians([25, 95, 100, 100])  # beyond stops too
    q = low + (high - low) * RNG.uniform(size=(4, 50, 4))
    np.testing.assert_allclose(chain.places(q), own.places(q), atol=1e-9)
    np.testing.assert_allclose(chain.radius_m, own.radius_m)
    np.testing.assert_allclose(chain.bars_m, own.bars_m, atol=1e-12)
    np.testing.assert_allclose(chain.bar_radius_m, own.bar_radius_m)
    for name in ("count", "outer", "feels", "meets"):
        np.testing.assert_array_equal(getattr(chain, name), getattr(own, name))
    # The proximal link passes the palm at 1.5 mm: of it either may be said.
    np.testing.assert_array_equal(chain.meets_palm[:, 1:, :3], own.meets_palm[:, 1:, :3])


@pytest.mark.parametrize("hand", [HandTable(), AS_CHAIN, HandTable(kind="leap")])
def test_fingers_own_frames_stand_where_the_hand_has_them(hand: HandTable) -> None:
    capsules = capsules_of_hand(hand)
    q = capsules.low_rad[:, None] + RNG.uniform(size=(capsules.fingers, 7, 1)) * (
        capsules.high_rad - capsules.low_rad)[:, None]
    from_base = capsules.places_from_base(q)
    for f, (x, y, z, *turn) in enumerate(capsules.base):
        sign = np.array([-1.0, -1.0, 1.0]) if turn == [0.0, 0.0, 1.0, 0.0] else np.ones(3)
        np.testing.assert_allclose(sign * from_base[f] + [x, y, z], capsules.places(q)[f],
                                   atol=1e-12)


@pytest.mark.parametrize(("radius", "ball"), [(0.008, 0.008), (0.018, 0.009), (0.040, 0.009),
                                              (0.012, 0.008), (0.002, 0.009)])
def test_balls_reach_the_surface_of_their_capsule_and_hardly_farther(
    radius: float, ball: float
) -> None:
    ends = RNG.normal(0.0, 0.04, (5, 2, 3))
    found = balls_within(ends, radius, ball, start=True)
    for (a, b), balls in zip(ends, found, strict=True):
        way = b - a
        share = np.clip((balls - a) @ way / (way @ way), 0.0, 1.0)
        off = np.linalg.norm(balls - a - share[:, None] * way, axis=1)
        assert (off <= max(radius - ball, 0.0) + 1e-12).all()
        side = np.cross(way / np.linalg.norm(way), RNG.normal(size=(200, 3)))
        side *= radius / np.linalg.norm(side, axis=1, keepdims=True)
        skin = a + RNG.uniform(size=(200, 1)) * way + side
        gap = np.linalg.norm(skin[:, None] - balls, axis=-1).min(1) - ball
        assert gap.max() < 0.6 * ball


def test_links_that_cannot_feel_are_told_apart(tmp_path) -> None:
    text = (files("warpgrasp.hands") / "data" / "leap.toml").read_text()
    for word, felt in (("tip_switches", 7), ("nothing", 0)):
        path = tmp_path / f"{word}.toml"
        path.write_text(text.replace('senses = "joint_torques"', f'senses = "{word}"'))
        feels = capsules_of_hand(HandTable(kind=str(path))).feels
        assert feels.sum() == felt
