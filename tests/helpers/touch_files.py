"""Files that `warpgrasp fit` reads and writes."""

import csv
from pathlib import Path

import numpy as np


def write(path: Path, sets: dict[str, np.ndarray]) -> Path:
    """A file of sets of touches [m], (touch, 3) each."""
    lines = [f"{name},{x},{y},{z}" for name, points in sets.items() for x, y, z in points.tolist()]
    path.write_text("\n".join(["set,x_m,y_m,z_m", *lines]) + "\n")
    return path


def read(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Header and rows of what was fitted."""
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return list(rows[0]), rows
