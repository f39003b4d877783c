"""Fits the factors of volume intervals on simulated episodes, and judges them on others.

    python tests/scripts/interval_factors.py collect FOLDER --seeds 21 22 --errors 1
    python tests/scripts/interval_factors.py fit FOLDER
    python tests/scripts/interval_factors.py judge OTHER_FOLDER

`collect` runs the episodes (a file a cell; those that are there are left out). `fit` prints the
factors of `strategies/contacts/volume_spread.py` that make the mean interval score least (Gneiting
and Raftery 2007, Strictly proper scoring rules, equation 43), each cell counting alike, and the
score when each object in turn is left out of the fit. `judge` prints in how many episodes of each
cell, and of each kind that is trusted or not, the intervals as they are hold.
"""

import argparse
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import interval_rows as tables
from interval_episodes import episode_columns, read_columns

from strategies.contacts.volume_spread import (
    FACTORS,
    MOST_EMPTY,
    MOST_MISSING,
    MOST_OF_GRASPS,
    MOST_OWN,
    MOST_UNFELT,
    Factors,
    FeltBy,
    VolumeSigns,
    interval_trusted,
    spread_of_volumes,
)

Z, LEVEL = 1.645, 0.9
WORST = 1.2
"""An episode whose volume is off by more than this factor's logarithm counts as this far off: a
body that has shrunk to nothing is a failure, which no width is to make up for."""
Rows = dict[str, np.ndarray]


def collect(given: argparse.Namespace) -> None:
    """Runs the cells, a file each."""
    given.folder.mkdir(parents=True, exist_ok=True)
    for seed in given.seeds:
        for factor in given.errors:
            for strategy in given.strategies:
                for name, table in tables.objects(given.scans, given.objects).items():
                    file = given.folder / f"{strategy}.{name}.{seed}.{factor:g}.npz"
                    if file.exists():
                        continue
                    cell = tables.cell_of(table, strategy, seed, tables.errors_times(factor))
                    np.savez_compressed(file, **episode_columns(cell, given.episodes))
                    print(file.name, flush=True)


def features(rows: Rows) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What each factor of the shift, and of the standard deviation, multiplies."""
    felt_by, own = rows["felt_by"], np.minimum(rows["own_std"], MOST_OWN)
    grasped = felt_by == FeltBy.GRASPS
    empty = np.minimum(rows["empty"], MOST_EMPTY) ** 2
    shift = {"missing_shift": grasped * np.minimum(rows["missing"], MOST_MISSING),
             "empty_shift": grasped * empty, "pads_shift": own * (felt_by == FeltBy.PADS)}
    std = {"unfelt": grasped * np.minimum(rows["unfelt"], MOST_UNFELT),
           "contradicted": grasped * rows["contradicted"], "empty": grasped * empty,
           "own_of_pads": own * (felt_by == FeltBy.PADS),
           "own_of_contours": own * (felt_by == FeltBy.CONTOUR)}
    return shift, std


def fitted(rows: Rows) -> Factors:
    """Factors of least mean interval score."""
    shift, std = features(rows)
    a, b = np.stack(list(shift.values()), 1), np.stack(list(std.values()), 1) ** 2
    held = np.where(
        rows["felt_by"] == FeltBy.GRASPS, (
            FACTORS.own_of_grasps * np.minimum(rows["own_std"], MOST_OF_GRASPS)) ** 2 + 1e-6,
        np.where(rows["felt_by"] == FeltBy.CONTOUR, FACTORS.contours**2, 1e-6))
    off = np.clip(rows["log_ratio"], -WORST, WORST)
    weight, n = cell_weights(rows), len(shift)

    def score(factors: np.ndarray, soft: float) -> tuple[float, np.ndarray]:
        """The hinges of the score rounded over `soft`, and the gradient."""
        away, width = off - a @ factors[:n], np.sqrt(b @ factors[n:] ** 2 + held)
        beyond = (np.abs(away) - Z * width) / soft
        miss = 2 / (1 - LEVEL) * weight
        by_width = 2 * Z * weight - Z * miss * expit(beyond)
        return float(np.sum(2 * Z * weight * width + miss * soft * np.logaddexp(0, beyond))), (
            np.concatenate([-(miss * expit(beyond) * np.sign(away)) @ a,
                            (by_width / width) @ b * factors[n:]]))

    found = np.concatenate([np.zeros(n), np.full(len(std), 0.2)])
    for soft in (0.1, 0.03, 0.01, 0.004):
        found = minimize(score, found, (soft,), jac=True, method="L-BFGS-B").x
    found[n:] = np.abs(found[n:])
    return replace(FACTORS, **dict(zip([*shift, *std], found.tolist(), strict=True)))


def cell_weights(rows: Rows) -> np.ndarray:
    """Each strategy, object and size of errors counts alike."""
    names = [f"{s} {o} {e}" for s, o, e in zip(rows["strategy"], rows["object"], rows["errors"],
                                               strict=True)]
    _, which, count = np.unique(names, return_inverse=True, return_counts=True)
    return 1.0 / count[which] / len(count)


def signs_of(rows: Rows) -> VolumeSigns:
    """The signs that the rows hold."""
    return VolumeSigns(**{f.name: rows[f.name] for f in fields(VolumeSigns)})


def mean_score(rows: Rows, shift: np.ndarray, std: np.ndarray) -> float:
    """The interval score, each cell counting alike."""
    away = np.abs(np.clip(rows["log_ratio"], -WORST, WORST) - shift)
    return float(np.sum(cell_weights(rows) * 2 * (
        Z * std + np.maximum(away - Z * std, 0.0) / (1 - LEVEL))))


def fit(given: argparse.Namespace) -> None:
    """Prints the factors, and the score with each object left out."""
    rows = read_columns(sorted(given.folder.glob("*.npz")))
    factors = fitted(rows)
    for name, value in asdict(factors).items():
        print(f"{name:16} {value:7.3f}   (now {getattr(FACTORS, name)})")
    shift, std = np.zeros((2, len(rows["log_ratio"])))
    for name in np.unique(rows["object"]):
        left = rows["object"] == name
        others = fitted({key: values[~left] for key, values in rows.items()})
        shift[left], std[left] = (each[left] for each in spread_of_volumes(signs_of(rows), others))
    signs = signs_of(rows)
    print(f"mean score {mean_score(rows, *spread_of_volumes(signs, factors)):.3f}, as they are "
          f"{mean_score(rows, *spread_of_volumes(signs)):.3f}, objects left out "
          f"{mean_score(rows, shift, std):.3f}")
    held = np.abs(rows["log_ratio"] - shift) < Z * std
    print("held with the object left out: " + ", ".join(
        f"{name} {held[rows['object'] == name].mean():.2f}" for name in np.unique(rows["object"])))


def judge(given: argparse.Namespace) -> None:
    """Prints how often the intervals hold."""
    rows = read_columns(sorted(given.folder.glob("*.npz")))
    shift, std = spread_of_volumes(signs_of(rows))
    held = np.abs(rows["log_ratio"] - shift) < Z * std
    trusted = interval_trusted(signs_of(rows), rows["rms_m"])
    shares = []
    for factor in np.unique(rows["errors"]):
        for strategy in np.unique(rows["strategy"]):
            for name in np.unique(rows["object"]):
                cell = ((rows["errors"] == factor) & (rows["strategy"] == strategy)
                        & (rows["object"] == name))
                if cell.any():
                    shares.append(held[cell].mean())
                    print(f"x{factor:g} {strategy:14} {name:18} {cell.sum():4} held "
                          f"{shares[-1]:.2f}, trusted {trusted[cell].mean():.2f} held "
                          f"{held[cell & trusted].mean():.2f}, half width "
                          f"{Z * np.median(std[cell]):.2f}")
    inside = sum(0.85 <= share <= 0.95 for share in shares)
    print(f"{len(held)} intervals: {held.mean():.3f} hold; {inside} of {len(shares)} cells 85 to "
          f"95 %, least {min(shares):.2f}")
    for name, kind in (("trusted", trusted), ("not trusted", ~trusted),
                       *((f"felt by {kind.name.lower()}", rows["felt_by"] == kind)
                         for kind in FeltBy)):
        if kind.any():
            print(f"{name}: {kind.sum()}, of which {held[kind].mean():.3f} hold")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("collect", "fit", "judge"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scans", type=Path, help="folder of scanned meshes [m]")
    parser.add_argument("--objects", nargs="*", help="by default the catalogue; also mug-3")
    parser.add_argument("--episodes", type=int, default=32)
    parser.add_argument("--seeds", type=int, nargs="*", default=[21])
    parser.add_argument("--errors", type=float, nargs="*", default=[1.0])
    parser.add_argument("--strategies", nargs="*",
                        default=["ring18", "rim12-ring12", "coarse-to-fine"])
    options = parser.parse_args()
    {"collect": collect, "fit": fit, "judge": judge}[options.what](options)
