"""Contacts of hands that are chains placed on bodies of any form: where stations are, and as on the
superquadric that a field is of; the Utah-MIT hand as its own kernels have it."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.contacts import field_placing
from strategies.contacts.field_placing import (
    FieldPlaces,
    link_stations,
    places_on_field,
    possible_stations,
    sampled_field,
)
from strategies.contacts.finger_touch import TouchedLinks, no_links
from strategies.ready_made import STRATEGIES
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.fit_contacts import (
    FARTHEST_LINK_M,
    NORMAL_SIGMA_M,
    PLACE_SIGMA_M,
    TURN_SIGMA_RAD,
    contacts_placed,
)
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.spec.cell import Cell
from warpgrasp.chain.chain_hand import capsule_ends, chain_of, hand_of_kind
from warpgrasp.parameters import HandTable

HANDS = ("allegro", "leap", "barrett")
AS_CHAIN = HandTable(kind=str(files("warpgrasp.hands") / "data" / "utah_mit.toml"))
SHARES = np.array([*((np.arange(12) + 0.5) / 12), 1.0])


@lru_cache
def explored(hand: HandTable) -> EpisodeBlock:
    """Grasps of a block."""
    return run_block(Cell(STRATEGIES["ring6"], {"name": "block"}, "block", seed=5, hand=hand),
                     np.arange(3), "cpu")


@pytest.fixture(scope="module", params=HANDS)
def block(request: pytest.FixtureRequest) -> EpisodeBlock:
    return explored(HandTable(kind=request.param))


def placed(links: TouchedLinks, asked: np.ndarray, distance: np.ndarray, normal: np.ndarray
           ) -> FieldPlaces:
    return places_on_field(
        links, asked, sampled_field(distance, normal),
        place_sigma_m=PLACE_SIGMA_M, turn_sigma_rad=TURN_SIGMA_RAD, farthest_m=FARTHEST_LINK_M,
        normal_sigma_m=NORMAL_SIGMA_M)


def body_at_stations(block: EpisodeBlock, links: TouchedLinks) -> tuple[np.ndarray, np.ndarray]:
    """Distances and normals of the recovered superquadrics."""
    stations = link_stations(links)
    flat = stations.reshape(len(stations), -1, 3)
    distance, normal = surface_distances(block.recovered.superquadric, flat,
                                         np.ones(flat.shape[:2], bool))
    return distance.reshape(stations.shape[:3]), normal.reshape(stations.shape)


@pytest.mark.parametrize("kind", HANDS)
def test_stations_lie_on_the_axes_of_capsules(kind: str) -> None:
    """By kinematics in NumPy, which agree with other readers of the same URDF."""
    rng, hand = np.random.default_rng(2), chain_of(hand_of_kind(kind))
    shape = (2, hand.fingers)
    turn = Rotation.random(2 * hand.fingers, rng=rng)
    place = rng.normal(size=(2 * hand.fingers, 3))
    q = rng.uniform(-1.0, 1.0, (*shape, hand.width))
    for f, drives in enumerate(hand.drives):
        q[:, f, len(drives):] = 0.0
    links = replace(
        no_links(*shape, HandTable(kind=kind)), q_rad=q,
        finger=np.tile(np.arange(hand.fingers), (2, 1)),
        hand_pose=np.concatenate([place, turn.as_quat()], axis=1).reshape(*shape, 7))
    stations = link_stations(links).reshape(*shape, -1, 13, 3)
    possible = possible_stations(replace(links, weight=np.ones_like(links.weight)))
    for world, f in np.ndindex(shape):
        number = world * hand.fingers + f
        ends = turn[number].apply(capsule_ends(hand, f, q[world, f]).reshape(-1, 3)) + place[number]
        start, end = ends.reshape(-1, 2, 3).swapaxes(0, 1)
        expected = start[:, None] + SHARES[:, None] * (end - start)[:, None]
        assert np.allclose(stations[world, f, :len(start)], expected, atol=1e-9)
        assert possible[world, f].reshape(-1, 13).all(1).sum() == len(start)


@pytest.mark.parametrize("kind", HANDS)
def test_stations_are_possible_where_their_joint_is(kind: str) -> None:
    hand = chain_of(hand_of_kind(kind))
    links = replace(no_links(1, hand.fingers, HandTable(kind=kind)),
                    finger=np.arange(hand.fingers)[None])
    for joint in range(hand.links):
        weight = np.zeros_like(links.weight)
        weight[..., joint] = 1.0
        possible = possible_stations(replace(links, weight=weight))[0].reshape(
            hand.fingers, -1, 13)
        for f, borne in enumerate(hand.capsule_joint):
            assert (possible[f, :len(borne)].all(1) == (np.array(borne) == joint)).all()
            assert not possible[f, len(borne):].any()


def test_they_are_those_of_the_superquadric(block: EpisodeBlock) -> None:
    felt, links = block.exploration.felt, block.exploration.belief.links
    found = placed(links, felt.mask, *body_at_stations(block, links))
    expected = contacts_placed(felt, links, block.recovered.superquadric)
    at = felt.mask & (found.chance > 0.0)
    assert at.sum() > 12
    assert np.allclose(found.point_m[at], expected.points_m[at], atol=1e-9)
    assert np.allclose(found.normal[at], expected.normals[at], atol=1e-7)
    assert np.allclose(found.covariance_m2[at], expected.covariance_m2[at], atol=1e-12)


def test_stations_of_links_that_torques_exclude_do_not_count(block: EpisodeBlock) -> None:
    felt, links = block.exploration.felt, block.exploration.belief.links
    possible = possible_stations(links)
    assert 0.05 < possible[felt.mask].mean() < 0.8
    normal = np.zeros((*possible.shape, 3))
    normal[..., 2] = 1.0
    one = placed(links, felt.mask, np.full(possible.shape, 0.008), normal)
    two = placed(links, felt.mask, np.where(possible, 0.008, 5.0), normal)
    assert (one.point_m == two.point_m).all()


def test_the_utah_mit_hand_as_chains_is_placed_as_by_its_own_kernels() -> None:
    block = explored(HandTable())
    felt, own = block.exploration.felt, block.exploration.belief.links
    # Its first joint, of abduction, bears no capsule.
    chains = replace(own, hand=AS_CHAIN, weight=np.pad(own.weight, [(0, 0), (0, 0), (1, 0)]))
    assert np.allclose(link_stations(chains), link_stations(own), atol=1e-9)
    assert (possible_stations(chains) == possible_stations(own)).all()
    field = body_at_stations(block, own)
    one, two = (placed(links, felt.mask, *field) for links in (own, chains))
    assert (one.chance[felt.mask] > 0.0).sum() > 20
    for field in fields(one):
        assert np.allclose(getattr(one, field.name), getattr(two, field.name), atol=1e-8)


@pytest.mark.parametrize("kind", ["utah_mit", *HANDS])
def test_directions_are_summed_up_side_by_side_as_one_by_one(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a tip that are level with its rim among them."""
    block = explored(HandTable(kind=kind))
    felt, links = block.exploration.felt, block.exploration.belief.links
    body = body_at_stations(block, links)
    one = placed(links, felt.mask, *body)
    monkeypatch.setattr(field_placing, "has_lanes", lambda device: False)
    two = placed(links, felt.mask, *body)
    assert (one.chance[felt.mask] > 0.0).sum() > 12
    for field in fields(one):
        assert np.allclose(getattr(one, field.name), getattr(two, field.name), atol=1e-9)


def test_a_switch_tells_no_more_than_that_the_last_link_touched() -> None:
    """Where torques are zero the body alone places a contact; where along the link is as unsure as
    the link is long."""
    hand = chain_of(hand_of_kind("allegro"))
    links = no_links(1, 1, HandTable(kind="allegro"))
    weight = np.zeros_like(links.weight)
    weight[..., hand.links - 1] = 1.0
    links = replace(links, linked=np.ones((1, 1), bool), weight=weight,
                    friction=np.full((1, 1), 0.5), torque_sigma_Nm=1e-3 * links.torque_sigma_Nm,
                    hand_pose=np.array([[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]]))
    start, end = capsule_ends(hand, 0, links.q_rad[0, 0])[-1]
    along = (end - start) / np.linalg.norm(end - start)
    beside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    normal = beside / np.linalg.norm(beside)
    # A plane beside the link, in touch with all of its side.
    radius = hand.capsules[0][-1].radius
    stations = link_stations(links)
    distance = (stations - start) @ normal + radius
    found = placed(links, links.linked, distance, np.broadcast_to(normal, stations.shape).copy())
    assert found.chance[0, 0] == 1.0
    assert np.allclose(found.normal[0, 0], normal, atol=0.1)
    middle = (start + end) / 2.0
    assert abs((found.point_m[0, 0] - middle) @ along) < 0.3 * np.linalg.norm(end - start)
    spread = along @ found.covariance_m2[0, 0] @ along - NORMAL_SIGMA_M**2
    assert spread == pytest.approx(np.sum((end - start)**2) / 12.0, rel=0.5)


@pytest.mark.parametrize("joint", [2, 3])
def test_a_ball_is_touched_from_all_sides(joint: int, tmp_path: Path) -> None:
    """By a plane at its skin, whichever way the ball's axis, which has no length, is taken to be.
    """
    text = Path(AS_CHAIN.kind).read_text()
    for length in ("28.0", "33.0"):
        text = text.replace(f"[[0.0, 0.0, 0.0], [0.0, 0.0, {length}]]",
                            f"[[0.0, 0.0, {length}], [0.0, 0.0, {length}]]")
    (tmp_path / "balls.toml").write_text(text)
    normal = np.random.default_rng(3).normal(size=(1, 40, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    links = no_links(1, 40, HandTable(kind=str(tmp_path / "balls.toml")))
    weight = np.zeros_like(links.weight)
    weight[..., joint] = 1.0
    links = replace(links, linked=np.ones((1, 40), bool), weight=weight,
                    hand_pose=np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, 40, 1)))
    stations = link_stations(links)
    centre = stations[:, :, 13 * (joint - 1)]
    distance = np.einsum("wpsi,wpi->wps", stations - centre[:, :, None], normal) + 0.008
    everywhere = np.repeat(normal[:, :, None], stations.shape[2], 2)
    found = placed(links, links.linked, distance, everywhere)
    assert (found.chance == 1.0).all()
    assert np.allclose(found.normal, normal, atol=1e-2)
    assert np.allclose(found.point_m, centre - 0.008 * normal, atol=1e-4)


@dataclass(frozen=True)
class SideBySide:
    """The LEAP hand's last link, whose capsules lie side by side."""

    links: TouchedLinks
    start_m: np.ndarray
    """Of both axes, (capsule 2, 3)."""
    along: np.ndarray
    across: np.ndarray
    """Unit vectors along them and from the second to the first."""
    radius_m: float

    def before(self, normal: np.ndarray) -> FieldPlaces:
        """The contact, if the body is a plane that the first capsule touches."""
        stations = link_stations(self.links)
        distance = (stations - self.start_m[0]) @ normal + self.radius_m
        return placed(self.links, self.links.linked, distance,
                      np.broadcast_to(normal, stations.shape).copy())


@pytest.fixture(scope="module")
def side_by_side() -> SideBySide:
    hand = chain_of(hand_of_kind("leap"))
    last = [k for k, joint in enumerate(hand.capsule_joint[0]) if joint == hand.links - 1]
    links = no_links(1, 1, HandTable(kind="leap"))
    weight = np.zeros_like(links.weight)
    weight[..., hand.links - 1] = 1.0
    links = replace(links, linked=np.ones((1, 1), bool), weight=weight,
                    hand_pose=np.array([[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]]))
    start, end = capsule_ends(hand, 0, links.q_rad[0, 0])[[last[0], last[-1]]].swapaxes(0, 1)
    along = (end - start)[0] / np.linalg.norm((end - start)[0])
    across = (start + end)[0] - (start + end)[1]
    across -= (across @ along) * along
    return SideBySide(links, start, along, across / np.linalg.norm(across),
                      hand.capsules[0][last[0]].radius)


def test_of_capsules_side_by_side_the_one_in_front_is_touched(side_by_side: SideBySide) -> None:
    """By a body that is believed so far in the hand that the one behind is at its skin."""
    hand, normal = side_by_side, side_by_side.across
    assert np.ptp(hand.start_m @ normal) > 0.004
    found = hand.before(normal)
    assert found.chance[0, 0] == pytest.approx(1.0)
    front = hand.start_m[1] - hand.radius_m * normal
    assert abs((found.point_m[0, 0] - front) @ normal) < 1e-3
    assert normal @ found.covariance_m2[0, 0] @ normal < 2.0 * NORMAL_SIGMA_M**2


def test_of_capsules_side_by_side_either_may_be_touched(side_by_side: SideBySide) -> None:
    """By a body that is as near to both; then the contact's variance across them says so."""
    hand = side_by_side
    found = hand.before(np.cross(hand.along, hand.across))
    apart = np.ptp(hand.start_m @ hand.across)
    variance = hand.across @ found.covariance_m2[0, 0] @ hand.across
    assert variance - NORMAL_SIGMA_M**2 == pytest.approx(0.5 * apart**2, rel=0.2)
    assert found.chance[0, 0] == pytest.approx(1.0)
