"""Options and results of free-form fits: a Gaussian process over signed distance, and meshes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fit.option_checks import check_counts, check_numbers

Mean = Callable[[Float[np.ndarray, "row point 3"], Int[np.ndarray, " row"]],
                Float[np.ndarray, "row point"]]
"""Signed distances [m], negative inside, of the prior bodies of the fits of given numbers, each at
its own points [m]."""

FAR = 1e4
"""Distance from the origin, in extents of a mesh, from which single precision rounds its vertices
by a thousandth of it."""


@dataclass(frozen=True)
class ImplicitOptions:
    """Options of a fit; hashable, as they name the compiled program.

    Raises ValueError for a number out of its range.
    """

    outlier_share: float = 0.05
    """Prior probability that a touch is an outlier [est]; 0: none is."""
    outlier_m: float = 0.010
    """Standard deviation of an outlier's distance from the surface [m] [est]."""
    noise_m: float = 0.001
    """Prior median of the standard deviation that touches have beyond their covariance [m] [est].
    """
    normal_offset: float = 0.1
    """How far outwards along normals the distance is given too, as a share of the root mean square
    distance of the touches from their centre [est]."""
    normal_slope: float = 0.2
    """Standard deviation of that distance as a share of the offset [est]."""
    free_sigma_m: float = 0.0005
    """Standard deviation of the surface of a ball of free space [m] [est]."""
    free_rounds: int = 2
    """Times that violated balls of free space are looked for; 0 ignores free space."""
    start_iterations: int = 1
    """Iterations from each start of the hyperparameters; the best then goes on."""
    round_iterations: int = 3
    """Iterations between two estimates of the outliers."""
    least_rounds: int = 2
    rounds: int = 8
    """Rounds at most, each an estimate of the outliers and its iterations."""
    least_fall: float = 3e-3
    """A fit has converged when a round lowers its cost by less than this fraction."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.outlier_share < 0.5:
            raise ValueError(f"outlier_share: {self.outlier_share}, should be from 0 to 0.5")
        check_numbers(self, "outlier_m", "noise_m", "normal_offset", "normal_slope",
                      "free_sigma_m", high=1e3, above=True)
        check_numbers(self, "least_fall")
        check_counts(self, least_rounds=1, round_iterations=1, start_iterations=1, free_rounds=0)
        check_counts(self, rounds=self.least_rounds)


@dataclass(frozen=True)
class ImplicitFit:
    """Posterior processes over signed distance, one a row; every field is finite for any status.

    f(x) = m(x) + sum_i k(x, x_i) alpha_i, with m the prior mean, k the Matern 3/2 kernel and x_i
    the points of the row. A fit that failed has alpha 0: its body is that of the mean.
    """

    points_m: Float[np.ndarray, "fit row 3"]
    """Touches, points off the surface along normals, centres of balls of free space [m]."""
    alpha_per_m: Float[np.ndarray, "fit row"]
    """Coefficients of the kernel [1/m]; 0 for rows not used."""
    noise_m2: Float[np.ndarray, "fit row"]
    """Variance of each row's distance [m^2], outliers' included; -1 for rows not used."""
    weight: Float[np.ndarray, "fit point"]
    """Of each touch as given: 1 for one believed, near 0 for an outlier, 0 where masked."""
    length_m: Float[np.ndarray, " fit"]
    """Length scale of the kernel [m]."""
    amplitude_m: Float[np.ndarray, " fit"]
    """Standard deviation of the distance before any touch [m]."""
    noise_sigma_m: Float[np.ndarray, " fit"]
    """Standard deviation of touches beyond their covariance [m]."""
    centre_m: Float[np.ndarray, "fit 3"]
    """Centre of the sphere that is the mean where none is given [m]."""
    radius_m: Float[np.ndarray, " fit"]
    """Its radius [m]."""
    low_m: Float[np.ndarray, "fit 3"]
    """Lowest coordinates of the touches used [m]."""
    high_m: Float[np.ndarray, "fit 3"]
    table_z_m: Float[np.ndarray, " fit"]
    """Height of the table, below which nothing of the body is [m]; -1e12 where there is none."""
    cost: Float[np.ndarray, " fit"]
    """Negative logarithm of the marginal likelihood and the hyperparameters' prior, up to a
    constant of the touches."""
    rms_m: Float[np.ndarray, " fit"]
    """Root mean square distance of the touches to the surface, by their weights [m]."""
    iterations: Int[np.ndarray, " fit"]
    status: Int[np.ndarray, " fit"]
    n_points: Int[np.ndarray, " fit"]

    def __len__(self) -> int:
        return len(self.status)


@dataclass(frozen=True)
class TriangleMesh:
    """A closed surface of triangles, anticlockwise seen from outside; empty where there is none."""

    vertices_m: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    simple: bool = False
    """It is known not to cross itself, as a zero set does not: what a ray crosses tells the inside.
    """

    @property
    def corners_m(self) -> Float[np.ndarray, "face 3 3"]:
        """Corners of each triangle [m]."""
        return self.vertices_m[self.faces]

    @property
    def volume_m3(self) -> float:
        """Volume inside [m^3]: the sum of tetrahedra over the triangles."""
        if len(self.faces) == 0:
            return 0.0
        a, b, c = np.moveaxis(self.corners_m - self.vertices_m.mean(axis=0), 1, 0)
        return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)

    @property
    def area_m2(self) -> float:
        """Area of the surface [m^2]: the sum over the triangles."""
        a, b, c = np.moveaxis(self.corners_m, 1, 0)
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def as_ply(self) -> bytes:
        """This mesh as a binary PLY file, in metres; in double precision where it lies so far from
        the origin that single would deform it."""
        reach = np.abs(self.vertices_m).max(initial=0.0)
        middle = self.vertices_m.sum(axis=0) / max(len(self.vertices_m), 1)
        extent = np.abs(self.vertices_m - middle).max(initial=0.0)
        kind, word = ("<f8", "double") if reach > FAR * extent else ("<f4", "float")
        head = ("ply\nformat binary_little_endian 1.0\ncomment lengths in m\n"
                f"element vertex {len(self.vertices_m)}\n"
                f"property {word} x\nproperty {word} y\nproperty {word} z\n"
                f"element face {len(self.faces)}\nproperty list uchar int vertex_indices\n"
                "end_header\n")
        faces = np.empty(len(self.faces), [("count", "u1"), ("corner", "<i4", 3)])
        faces["count"], faces["corner"] = 3, self.faces
        return head.encode() + self.vertices_m.astype(kind).tobytes() + faces.tobytes()


@dataclass(frozen=True)
class FreeForms:
    """Free forms with their meshes, volumes and uncertainties, one a row; numbers of sets without a
    fit are NaN, their meshes empty."""

    mesh: np.ndarray
    """`TriangleMesh` of each, (fit,)."""
    volume_m3: Float[np.ndarray, " fit"]
    interval_m3: Float[np.ndarray, "fit 2"]
    """90 % interval of the volume."""
    std_m: Float[np.ndarray, " fit"]
    """Median standard deviation of the surface along its normal [m]."""
    gap_m: Float[np.ndarray, " fit"]
    """The farthest that a place of the surface is from all touches [m]; where the body stands on a
    table none are asked for."""
    spacing_m: Float[np.ndarray, " fit"]
    """Root of the area for each touch [m]: how far apart touches are that are spread evenly."""
    rms_m: Float[np.ndarray, " fit"]
    n_points: Int[np.ndarray, " fit"]
    status: Int[np.ndarray, " fit"]

    def __len__(self) -> int:
        return len(self.status)
