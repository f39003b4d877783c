"""Contacts placed on believed bodies of any form: stations along the links, and places there."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Bool, Float

from strategies.contacts.field_placing_kernel import (
    LINKS,
    field_placing_kernel,
    station_kernel,
    superquadric_field_kernel,
)
from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.placing_posterior import STATIONS, UNLIKELY
from warpgrasp.chain.chain_hand import chain_of_table
from warpgrasp.core.dtypes import mat33, real, transform, vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.mechanism.utah_mit_hand import hand_of

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


def can_be_placed(links: TouchedLinks) -> bool:
    """Whether the contacts of a hand can be placed on bodies of any form: of the Utah-MIT hand."""
    return chain_of_table(links.hand) is None


def link_stations(links: TouchedLinks, *, device: str = "cpu"
                  ) -> Float[np.ndarray, "world point station 3"]:
    """Places along the axes of each finger's links [m], link by link."""
    shape = links.finger.shape
    station = wp.empty((*shape, LINKS * STATIONS), dtype=vec3, device=device)
    launch(station_kernel, {"world": shape[0], "point": shape[1]}, {
        **dict.fromkeys(("hand_pose", "q", "finger"), "world point"),
        "station": f"world point {LINKS * STATIONS}"}, {
        "hand": hand_of(links.hand),
        "hand_pose": array_of(links.hand_pose, transform, device),
        "q": array_of(links.q_rad, vec4, device),
        "finger": array_of(links.finger, int, device), "station": station},
        device=device)
    return station.numpy()


def possible_stations(links: TouchedLinks) -> Bool[np.ndarray, "world point station"]:
    """Those of links that torques leave possible; no other is looked at."""
    return np.repeat(links.weight >= float(UNLIKELY), STATIONS, axis=-1)


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
    field = wp.empty((*asked.shape, LINKS * STATIONS), dtype=vec4, device=device)
    given = {**_links_given(links, asked, device),
             "link_weight": array_of(links.weight, vec3, device)}
    launch(superquadric_field_kernel, {"world": asked.shape[0], "point": asked.shape[1]}, {
        "shape": "world", "pose": "world", "field": f"world point {LINKS * STATIONS}",
        **dict.fromkeys(given, "world point")}, {
        "shape": shape, "pose": pose, "hand": hand_of(links.hand), **given, "field": field},
        device=device)
    return field


def places_on_field(
    links: TouchedLinks, asked: Bool[np.ndarray, "world point"], field: wp.array, *,
    lean_share: float, place_sigma_m: float, turn_sigma_rad: float, farthest_m: float,
    normal_sigma_m: float, device: str = "cpu",
) -> FieldPlaces:
    """The likeliest places of the contacts `asked`, by torques and by a body: its normals and
    distances at stations, `superquadric_field` or `sampled_field`.

    The numbers are those of `strategies.recovery.fit_contacts`. Raises ShapeError where shapes
    disagree.
    """
    found = {name: wp.empty(asked.shape, dtype=kind, device=device) for name, kind in (
        ("point", vec3), ("covariance", mat33), ("normal", vec3), ("chance", real),
        ("misfit", real))}
    given = _links_given(links, asked, device) | {
        name: array_of(values, kind, device) for name, values, kind in (
            ("torque", links.torque_Nm, vec4), ("torque_sigma", links.torque_sigma_Nm, vec4),
            ("link_weight", links.weight, vec3), ("lean", lean_share * links.friction, real))}
    launch(field_placing_kernel, {"world": asked.shape[0], "point": asked.shape[1]}, {
        "field": f"world point {LINKS * STATIONS}",
        **dict.fromkeys((*given, *found), "world point")}, {
        "field": field, "hand": hand_of(links.hand), "place_sigma": place_sigma_m,
        "turn_sigma": turn_sigma_rad, "farthest": farthest_m,
        "normal_variance": normal_sigma_m**2, **given, **found}, device=device)
    values = {name: array.numpy() for name, array in found.items()}
    return FieldPlaces(values["point"], values["covariance"], values["normal"], values["chance"],
                       values["misfit"])


def _links_given(
    links: TouchedLinks, asked: np.ndarray, device: str
) -> dict[str, wp.array]:
    """What both kernels take of fingers."""
    return {name: array_of(values, kind, device) for name, values, kind in (
        ("kept", asked, wp.bool), ("hand_pose", links.hand_pose, transform),
        ("q", links.q_rad, vec4), ("finger", links.finger, int))}
