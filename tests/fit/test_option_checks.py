"""Options out of their range are refused with what would be right, not fitted with."""

import re
from typing import Any

import numpy as np
import pytest

from fit.implicit.fit import fit_implicit
from fit.implicit.record import ImplicitOptions
from fit.revolution.fit import fit_revolution
from fit.revolution.record import RevolutionOptions
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricOptions

NAN, INF = float("nan"), float("inf")
POSITIVE = ("least_fall", "plane_weight")
WRONG = [
    *((kind, name, value) for kind in (SuperquadricOptions, RevolutionOptions)
      for name in POSITIVE for value in (-1.0, NAN, INF, "1", None)),
    *((kind, "round_iterations", value)
      for kind in (SuperquadricOptions, RevolutionOptions, ImplicitOptions)
      for value in (0, 2.5, True)),
    *((kind, name, -1) for kind in (SuperquadricOptions, RevolutionOptions)
      for name in ("iterations", "screen_iterations")),
    *((SuperquadricOptions, name, value) for name in (
        "sigma_floor_m", "free_weight", "normal_weight", "normal_std_rad", "prior")
      for value in (-1.0, NAN, INF)),
    *((SuperquadricOptions, "upright_std_rad", value) for value in (0.0, -0.01, 1e-300, NAN)),
    *((SuperquadricOptions, "mean_exponent", value) for value in (0.1, 0.0, -1.0, NAN, INF)),
    (SuperquadricOptions, "plane_weight", 1e200), (SuperquadricOptions, "settle_iterations", -1),
    (RevolutionOptions, "plane_weight", 1e9), (RevolutionOptions, "nodes", 2.5),
    (RevolutionOptions, "nodes", 129), (RevolutionOptions, "upright", "no"),
    *((SuperquadricOptions, name, "no") for name in ("taper", "bend", "upright_starts")),
    *((RevolutionOptions, "smoothing", value) for value in (-1.0, 1e9, NAN)),
    *((RevolutionOptions, "tilt_std_rad", value) for value in (0.0, 1e-300, NAN)),
    *((ImplicitOptions, name, value) for name in ("noise_m", "normal_offset")
      for value in (0.0, -1.0, NAN, INF)),
    (ImplicitOptions, "rounds", 1), (ImplicitOptions, "free_rounds", -1),
]


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("kind", "name", "value"), WRONG)
def test_an_option_out_of_range_is_named_with_what_is_right(
    kind: Any, name: str, value: Any,
) -> None:
    with pytest.raises(ValueError, match=re.escape(f"{name}: {value!r}, should be ")):
        kind(**{name: value})


@pytest.mark.usefixtures("unchecked")
def test_options_at_their_bounds_and_of_numpy_are_taken() -> None:
    SuperquadricOptions(iterations=0, screen_iterations=0, settle_iterations=0, round_iterations=1,
                        least_fall=0.0, sigma_floor_m=0.0, plane_weight=0.0, prior=0.0,
                        upright_std_rad=None, mean_exponent=None)
    RevolutionOptions(nodes=2, iterations=0, smoothing=0.0, tilt_std_rad=None)
    ImplicitOptions(outlier_share=0.0, free_rounds=0, least_rounds=1, rounds=1)
    two: Any = np.int64(2)
    RevolutionOptions(nodes=two, smoothing=np.float64(0.1))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("fit", [fit_superquadric, fit_revolution, fit_implicit])
def test_options_of_another_kind_are_refused(fit: Any) -> None:
    with pytest.raises(ValueError, match=r"options: \{'taper': True\}, should be a \w+Options"):
        fit(np.zeros((1, 9, 3)), options={"taper": True})
