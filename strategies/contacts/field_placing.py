"""Contacts placed on believed bodies of any form: stations along the links, and places there."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Bool, Float

from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.placing_hands import placing_hand
from strategies.contacts.placing_posterior import STATIONS, UNLIKELY, WIDEST, Tried
from strategies.contacts.placing_sums import AROUND, CAP
from warpgrasp.core.dtypes import mat33, real, vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.lanes import has_lanes

LEAST_SLOPE, STEEPEST = 0.5, 1.5
"""Slopes of a process that its values are divided by to be distances [est]."""


@dataclass(frozen=True)
class FieldPlaces:
    """Contacts at their likeliest places. Shapes start with (world, point)."""

    point_m: Float[np.ndarray, "world point 3"]
    covariance_m2: Float[np.ndarray, "world point 3 3"]
    normal: Float[np.ndarray, "world point 3"]
    """Outward normals of the body."""
    chance: Float[np.ndarray, "world point"]
    """Probability of the link that bears each; 0 where none can."""
    misfit: Float[np.ndarray, "world point"]
    """Chi-square of torques and body there."""


def directions_tried(turn_sigma_rad: float) -> np.ndarray:
    """`placing_posterior.Tried.direction`, (direction, 3)."""
    around = turn_sigma_rad * np.linspace(-WIDEST, WIDEST, AROUND)
    cap = turn_sigma_rad * np.linspace(-WIDEST, WIDEST, CAP)
    about = np.stack(np.broadcast_arrays(1.0, cap[:, None], cap), -1).reshape(-1, 3)
    return np.concatenate([
        np.stack([np.cos(around), np.sin(around), np.zeros(AROUND)], 1),
        about / np.linalg.norm(about, axis=1, keepdims=True)])


def link_stations(links: TouchedLinks, *, device: str = "cpu"
                  ) -> Float[np.ndarray, "world point station 3"]:
    """Places along the axes of each finger's links [m], link by link; of a chain's, capsule by
    capsule. Zeros where a finger has fewer than another."""
    hand = placing_hand(links.hand, device)
    worlds, points = links.finger.shape
    each = f"world point {hand.links * STATIONS}"
    station = wp.zeros((worlds, points, hand.links * STATIONS), dtype=vec3, device=device)
    given = hand.stood(links, device)
    launch(hand.station, {"world": worlds, "point": points}, {
        **hand.shapes, **dict.fromkeys(given, "world point"), "station": each}, {
        "hand": hand.hand, **given, "station": station}, device=device)
    return station.numpy()


def possible_stations(links: TouchedLinks) -> Bool[np.ndarray, "world point station"]:
    """Those of links that torques leave possible; no other is looked at."""
    joint = placing_hand(links.hand, "cpu").joint_of[links.finger]
    weight = np.take_along_axis(links.weight, joint, axis=-1)
    return np.repeat((joint >= 0) & (weight >= float(UNLIKELY)), STATIONS, axis=-1)


def field_of_process(value_m: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] (k,) and unit normals (k, 3) of a process whose values are `value_m` (k,) and
    gradients `slope` (k, 3): it rises less or more steeply than a distance where little was felt.
    """
    size = np.linalg.norm(slope, axis=-1)
    known = np.isfinite(size) & (size > 0.0)
    normal = np.where(known[:, None], slope / np.where(known, size, 1.0)[:, None], 0.0)
    return value_m / np.clip(size, LEAST_SLOPE, STEEPEST), normal


def sampled_field(
    distance_m: Float[np.ndarray, "world point station"],
    normal: Float[np.ndarray, "world point station 3"], *, device: str = "cpu",
) -> wp.array:
    """Bodies as `places_on_field` takes them, of which signed distance and outward normal at
    `link_stations` are given."""
    return array_of(np.concatenate([normal, distance_m[..., None]], -1), vec4, device)


def superquadric_field(
    links: TouchedLinks, asked: Bool[np.ndarray, "world point"], shape: wp.array, pose: wp.array,
    *, device: str = "cpu",
) -> wp.array:
    """Superquadrics as `places_on_field` takes them, at the `possible_stations` of contacts that
    are `asked` for; `shape` and `pose` (world,) are the kernels' arrays. Raises ShapeError where
    shapes disagree."""
    hand = placing_hand(links.hand, device)
    field = wp.empty((*asked.shape, hand.links * STATIONS), dtype=vec4, device=device)
    given = {"kept": array_of(asked, wp.bool, device), **hand.stood(links, device),
             **hand.weights(links, device)}
    launch(hand.superquadric_field, {"world": asked.shape[0], "point": asked.shape[1]}, {
        **hand.shapes, "shape": "world", "pose": "world",
        "field": f"world point {hand.links * STATIONS}", **dict.fromkeys(given, "world point")}, {
        "has_lanes": has_lanes(device), "shape": shape, "pose": pose, "hand": hand.hand,
        **given, "field": field}, device=device)
    return field


def places_on_field(
    links: TouchedLinks, asked: Bool[np.ndarray, "world point"], field: wp.array, *,
    place_sigma_m: float, turn_sigma_rad: float, farthest_m: float,
    normal_sigma_m: float, device: str = "cpu",
) -> FieldPlaces:
    """The likeliest places of the contacts `asked`, by torques and by a body: its normals and
    distances at stations, `superquadric_field` or `sampled_field`.

    The numbers are those of `strategies.recovery.fit_contacts`. Raises ShapeError where shapes
    disagree.
    """
    hand = placing_hand(links.hand, device)
    found = {name: wp.empty(asked.shape, dtype=kind, device=device) for name, kind in (
        ("point", vec3), ("covariance", mat33), ("normal", vec3), ("chance", real),
        ("misfit", real))}
    given = {"kept": array_of(asked, wp.bool, device), **hand.stood(links, device),
             **hand.torques(links, device), **hand.weights(links, device),
             "friction": array_of(links.friction, real, device)}
    tried = Tried()
    tried.direction = array_of(directions_tried(turn_sigma_rad), vec3, device)
    tried.turn_sigma = turn_sigma_rad
    tried.has_lanes = wp.bool(has_lanes(device))
    launch(hand.placing, {"world": asked.shape[0], "point": asked.shape[1]}, {
        **hand.shapes, "field": f"world point {hand.links * STATIONS}",
        **dict.fromkeys((*given, *found), "world point")}, {
        "field": field, "hand": hand.hand, "tried": tried,
        "place_sigma": place_sigma_m, "farthest": farthest_m,
        "normal_variance": normal_sigma_m**2, **given, **found}, device=device, heavy=True)
    return FieldPlaces(*(values.numpy() for values in found.values()))
