"""Sets of touches of any sizes, one after the other; padded only where they are fitted."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class PointSets:
    """Sets of touches, those of each set together and in the order of `names`."""

    names: tuple[str, ...]
    """Name of each set, in order of first appearance."""
    touches_m: Float[np.ndarray, "touch 3"]
    count: Int[np.ndarray, " fit"]
    """Touches of each set."""
    normals: Float[np.ndarray, "touch 3"] | None = None
    """Outward normals of the touches, NaN where not given; None if the columns are missing."""
    left_out: tuple[int, ...] = ()
    """Touches of each set that are not here, since a coordinate is missing; empty: none."""

    @property
    def of_touch(self) -> Int[np.ndarray, " touch"]:
        """The set of each touch."""
        return np.repeat(np.arange(len(self.count)), self.count)

    def slots(self, index: int) -> slice:
        """Where the touches of a set are."""
        end = int(self.count[:index + 1].sum())
        return slice(end - int(self.count[index]), end)

    def bounds_m(self) -> tuple[Float[np.ndarray, "fit 3"], Float[np.ndarray, "fit 3"]]:
        """Lowest and highest coordinates of the finite touches of each set [m]; infinity and minus
        infinity without any."""
        low = np.full((len(self.count), 3), np.inf)
        high = -low
        good = np.isfinite(self.touches_m).all(1)
        np.minimum.at(low, self.of_touch[good], self.touches_m[good])
        np.maximum.at(high, self.of_touch[good], self.touches_m[good])
        return low, high

    def padded(self, index: Int[np.ndarray, " set"]) -> tuple[
            Float[np.ndarray, "set point 3"], Bool[np.ndarray, "set point"],
            Float[np.ndarray, "set point 3"] | None]:
        """Touches, which of them are there, and normals of the sets `index`, of one width."""
        count = self.count[index]
        mask = np.arange(count.max(initial=0)) < count[:, None]
        first = (np.cumsum(self.count) - self.count)[index]
        slots = (first[:, None] + np.arange(mask.shape[1]))[mask]
        points = np.zeros((*mask.shape, 3))
        points[mask] = self.touches_m[slots]
        if self.normals is None:
            return points, mask, None
        normals = np.full_like(points, np.nan)
        normals[mask] = self.normals[slots]
        return points, mask, normals
