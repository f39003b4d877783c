"""Outliers among touches: a contaminated normal distribution of their errors.

A touch is off by its noise, or with a small probability by much more. What all other touches
predict for it decides: the cavity of expectation propagation (Minka 2001; for processes Rasmussen
and Williams 2006, section 5.4.2 on deleted residuals). The residual of the full fit would not do,
since a process of dense rows passes through an outlier.
"""

import numpy as np
from jaxtyping import Float


def outlier_weights(
    deleted: Float[np.ndarray, "fit row"], deleted_variance: Float[np.ndarray, "fit row"],
    inlying: Float[np.ndarray, "fit row"], share: float, outlier: Float[np.ndarray, "fit 1"],
    *, at_first: bool = False,
) -> Float[np.ndarray, "fit row"]:
    """Share of its precision that each touch keeps, from above 0 to 1.

    Args:
        deleted: prediction by all other rows less the touch.
        deleted_variance: variance of that prediction.
        inlying: variance of a touch that is no outlier.
        share: prior probability of an outlier.
        outlier: standard deviation of an outlier beyond its noise.
        at_first: before the hyperparameters are known. Then the variance is averaged instead, so
            that doubtful touches do not decide how rough the surface is.

    The precision is the mean of 1/variance over the two cases, each by its probability.
    """
    wide = inlying + outlier**2
    inside, outside = deleted_variance + inlying, deleted_variance + wide
    square = deleted**2
    log_odds = (np.log(share / (1.0 - share)) + 0.5 * np.log(inside / outside)
                + 0.5 * square * (1.0 / inside - 1.0 / outside))
    # Odds beyond e^40 are certain to the last bit; their exponential would overflow.
    probability = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -40.0, 40.0)))
    if at_first:
        return inlying / (inlying + probability * outlier**2)
    return 1.0 - probability * (1.0 - inlying / wide)
