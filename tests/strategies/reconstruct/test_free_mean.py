"""What a free form stands about: the body that was touched where it is one, or none."""

import pickle
from dataclasses import replace

import numpy as np
from felt_bodies import felt_on

from fit.superquadric.geometry import Superquadric, superquadric
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.free_form import reconstruct
from strategies.reconstruct.free_mean import FreeMean, likeliest_mean
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.evidence import Evidence
from strategies.recovery.free_contacts import BODY, LATER_SIGMA_M
from warpgrasp.parameters import FitTable

TABLE = FitTable()
PRIOR = BoundingCylinder(*(np.array([v]) for v in (0.45, 0.0, 0.06, 0.16)))
BAR = superquadric((0.02, 0.025, 0.07), (0.3, 0.6), (0.45, 0.0, 0.072))
ARCH = BAR._replace(bend=np.array([[7.0, 0.3]]))


def joined_slots(one: Evidence, other: Evidence) -> Evidence:
    """The contacts of both."""
    return replace(one, **{name: np.concatenate([getattr(one, name), getattr(other, name)], 1)
                           for name in ("points_m", "mask", "covariance_m2", "normals", "by_pad",
                                        "contradiction")})


def chosen_of(evidence: Evidence, model: Superquadric = BAR) -> FreeMean:
    recovered = Recovered(np.array([Shape.SUPERQUADRIC]), model)
    return likeliest_mean(evidence, np.full(evidence.mask.shape, LATER_SIGMA_M), recovered, PRIOR,
                          TABLE, BODY)


def test_a_bar_is_a_superquadric_and_an_arch_one_that_bends() -> None:
    straight, bent = chosen_of(felt_on(BAR, 80)), chosen_of(felt_on(ARCH, 80))
    assert straight.name == "implicit_about_tapered_superquadric"
    assert bent.name == "implicit_about_tapered_bent_superquadric"
    assert bent.superquadric is not None
    assert abs(bent.superquadric.bend[0, 0] - 7.0) < 1.0
    assert bent.process.amplitude_m < 0.002


def test_what_no_such_body_is_stands_about_none() -> None:
    """A bar with a ball at its side."""
    ball = superquadric((0.03, 0.03, 0.03), (1.0, 1.0), (0.48, 0.03, 0.11))
    one, other = felt_on(BAR, 50), felt_on(ball, 40)
    both = joined_slots(one, other)
    assert chosen_of(both).name == "implicit"


def test_few_contacts_tell_of_no_body_with_more_parameters() -> None:
    assert chosen_of(felt_on(ARCH, 24)).name != "implicit_about_tapered_bent_superquadric"


def test_a_free_form_about_the_body_knows_the_side_that_was_not_felt() -> None:
    """Contacts on the lower two thirds of a bar: about it the free form has its top."""
    felt = felt_on(BAR, 120)
    felt = replace(felt, mask=felt.mask & (felt.points_m[..., 2] < 0.1))
    recovered = Recovered(np.array([Shape.SUPERQUADRIC]), BAR)
    made = reconstruct("implicit", recovered, felt, PRIOR, TABLE)
    assert made is not None
    assert made.name_of(0) == "implicit_about_tapered_superquadric"
    assert 0.10 < made.meshes[0].vertices_m[:, 2].max() < 0.17
    volume = made.volume(0)
    assert volume is not None
    assert made.volume(0) is volume
    height, std = volume.surface_m[0, :, 2], volume.surface_std_m[0]
    assert std[height > height.max() - 0.003].mean() > 1.5 * std[height < 0.09].mean()
    again = pickle.loads(pickle.dumps(made))  # reports draw in other processes
    assert again.name_of(0) == made.name_of(0)
    at = made.meshes[0].vertices_m[None, :4]
    assert (again.forms[0].about.mean(at, np.zeros(1, int))
            == made.forms[0].about.mean(at, np.zeros(1, int))).all()
