"""Shows that a change of the code changes no result: run at two checkouts, then compare.

    python tests/scripts/same_results.py run OUT            # with the environment that is active
    python tests/scripts/same_results.py compare OUT OTHER  # 0 if every file has the same bytes

`run` uses the command line alone, so that it also runs at older checkouts (`PYTHONPATH=CHECKOUT`).
It runs ten strategies on ten objects with eight episodes each, a study that sweeps settings over a
mesh, a compound and a superquadric, every table, leaderboard and figure of both, single episodes,
fits to points in every form, and exports. Names given to `--ignore` are compared but only listed.
"""

import argparse
import fnmatch
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh

MAIN = """schema = 1
name = "same-results"
seed = 11
episodes_per_cell = 8
objects = ["block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel",
           "wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle"]
""" + "".join(f'[[strategy]]\nname = "{name}"\n' for name in (
    "ring6", "top2-ring6", "rim12-ring12", "coarse-to-fine", "contour-first", "planar", "random6",
    "even", "gaussian-process", "expected-error"))

SWEPT = """schema = 1
name = "same-results-swept"
seed = 12
episodes_per_cell = 4
objects = ["wedge", { name = "pebble", mesh = "pebble.stl", units = "mm" },
  { name = "mug", compound = [
    { shape = "cylinder", radius_mm = 40, height_mm = 90 },
    { shape = "cylinder", radius_mm = 36, height_mm = 90, at_mm = [0, 0, 6], join = "difference" },
  ] },
  { name = "pad", superquadric = { size_mm = [40, 30, 50], exponents = [0.6, 0.8] } }]
[[strategy]]
name = "tilted"
waypoints = { kind = "ring", count = 9, tilt_deg = 40 }
closings = ["curl40", "base_then_curl"]
order = ["containment", "decide"]
[[strategy]]
name = "contour-only"
[[strategy]]
name = "uncertain"
strategy = "most-uncertain"
budget = { touches = 48 }
[sweep.grid]
"sensors.tendon_threshold_N" = [4.0, 8.0]
"sensors.contact_estimator" = ["fingertip", "intrinsic"]
[sweep.sobol]
n = 2
"object.yaw_deg" = { low = -180, high = 180 }
"""

TABLES = {"pairs": [], "objects": [], "confusion": [], "curves": [], "reach": [], "pareto": [],
          "pairs-best": ["--against", "best"], "objects-iou": ["--metric", "iou"]}
TABLES_OF = {"main": {"same-time": ["--against", "ring6"]}, "swept": {"settings": []}}
FIGURES = ("forest", "curves-touches", "curves-time", "pareto", "confusion")
EPISODE_FIGURES = ("contacts", "faces", "contour", "taxels", "grasp")
EPISODES = (("block", "ring6"), ("wine_bottle", "coarse-to-fine"), ("wedge", "planar"),
            ("lightbulb", "contour-first"), ("funnel", "rim12-ring12"), ("block", "expected-error"),
            ("small_cylinder", "oracle"))
FITS = {"superquadric": [], "superquadric-taper": ["--taper"], "superquadric-bend": ["--bend"],
        "superquadric-all": ["--taper", "--bend", "--robust", "--table-z", "0"],
        "plane": [], "revolution": []}


def warpgrasp(*words: object, to: Path | None = None) -> None:
    """Runs one command; its exit code and what it prints on stdout are kept in `to`."""
    done = subprocess.run([sys.executable, "-m", "sweeps", *map(str, words)], capture_output=True,
                          check=False)
    if done.returncode not in (0, 1):
        print(f"warpgrasp {' '.join(map(str, words))}: exit {done.returncode}\n"
              f"{done.stderr.decode()[-800:]}", file=sys.stderr)
    if to is not None:
        to.write_bytes(f"exit {done.returncode}\n".encode() + done.stdout)


def points_csv() -> str:
    """Five sets of noisy points on ellipsoids, cylinders and planes."""
    random = np.random.default_rng(5)
    lines = ["set,x_m,y_m,z_m"]
    for group in range(5):
        ray = random.normal(size=(48, 3))
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        size = 0.03 + 0.03 * random.random(3)
        points = ray * size + [0.4, 0.1, size[2]] + random.normal(scale=5e-4, size=(48, 3))
        lines += [f"{group},{x:.6f},{y:.6f},{z:.6f}" for x, y, z in points]
    return "\n".join(lines) + "\n"


def run_study(text: str, folder: Path) -> None:
    """Runs a study and everything that is made from its units."""
    folder.mkdir(parents=True)
    pebble = trimesh.creation.icosphere(subdivisions=3, radius=35.0)
    pebble.apply_scale([1.0, 0.8, 1.3])
    pebble.export(folder / "pebble.stl")
    (folder / "spec.toml").write_text(text)
    study = folder / "study"
    warpgrasp("check", folder / "spec.toml", "--json", to=folder / "check.json")
    warpgrasp("sweep", folder / "spec.toml", "-o", study, "--workers", 2, to=folder / "sweep.txt")
    warpgrasp("leaderboard", study, to=folder / "leaderboard.txt")
    for name, by in (("by-strategy", "strategy"), ("by-object", "strategy,object")):
        warpgrasp("leaderboard", study, "--by", by, "-o", folder / f"{name}.csv", "--json",
                  to=folder / f"{name}.json")
    for name, options in (TABLES | TABLES_OF[folder.name]).items():
        kind = name if name == "same-time" else name.split("-")[0]
        warpgrasp("table", study, kind, *options, "-o", folder / f"table-{name}.csv", "--json",
                  to=folder / f"table-{name}.json")
    for kind in (*FIGURES, *(("settings",) if text is SWEPT else ())):
        warpgrasp("figure", study, kind, "-o", folder / f"{kind}.svg")
    if text is MAIN:
        for kind in EPISODE_FIGURES:
            strategy = "planar" if kind == "faces" else "contour-first"
            warpgrasp("figure", study, kind, "--strategy", strategy, "--object", "wine_bottle"
                      if kind == "contour" else "block", "-o", folder / f"{kind}.svg")


def run(out: Path) -> None:
    """Runs everything into `out` and writes `digests.json` there."""
    run_study(MAIN, out / "main")
    run_study(SWEPT, out / "swept")
    run_singles(out)
    write_digests(out)


def run_singles(out: Path) -> None:
    """Runs single episodes, fits and exports."""
    for seed, (body, strategy) in enumerate(EPISODES):
        warpgrasp("explore", body, "--strategy", strategy, "--seed", seed, "-o",
                  out / "explore" / f"{strategy}-{body}")
    (out / "fit").mkdir()
    (out / "fit" / "points.csv").write_text(points_csv())
    for name, options in FITS.items():
        warpgrasp("fit", name.split("-")[0], out / "fit" / "points.csv", *options, "-o",
                  out / "fit" / f"{name}.csv")
    (out / "export").mkdir()
    for file, options in {"hand.xml": [], "hand.urdf": [], "robot.xml": ["--arm"],
                          "robot.urdf": ["--arm"], "scene.xml": ["--object", "wedge"],
                          "scene.urdf": ["--arm", "--object", "wine_bottle"]}.items():
        warpgrasp("export", out / "export" / file, *options)
    for listing in ("objects", "strategies"):
        warpgrasp(listing, "--json", to=out / f"{listing}.json")


def write_digests(out: Path) -> None:
    """Writes the digest of every file that holds results, by its path."""
    kept = [file for file in sorted(out.rglob("*")) if file.is_file()
            and "logs" not in file.parts and not file.name.startswith(".lock")
            and file.name not in ("environment.json", "digests.json")]
    digests = {str(file.relative_to(out)): hashlib.sha256(file.read_bytes()).hexdigest()
               for file in kept}
    (out / "digests.json").write_text(json.dumps(digests, indent=1) + "\n")
    print(f"{len(digests)} files")


def compare(one: Path, other: Path, ignored: list[str]) -> int:
    """Prints what differs; 1 if anything does that is not ignored."""
    here, there = (json.loads((folder / "digests.json").read_text()) for folder in (one, other))
    different = [name for name in sorted({*here, *there}) if here.get(name) != there.get(name)]
    listed = [name for name in different if any(fnmatch.fnmatch(name, p) for p in ignored)]
    wrong = [name for name in different if name not in listed]
    units = sum("units/" in name for name in here)
    print(f"{len(here)} files ({units} units): {len(here) - len(different)} the same, "
          f"{len(wrong)} differ, {len(listed)} differ and are ignored")
    for name in wrong:
        print(f"  differs: {name}")
    for name in listed:
        print(f"  ignored: {name}")
    return int(bool(wrong))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run")
    runs.add_argument("out", type=Path)
    compares = commands.add_parser("compare")
    compares.add_argument("one", type=Path)
    compares.add_argument("other", type=Path)
    compares.add_argument("--ignore", nargs="*", default=[])
    given = parser.parse_args()
    if given.command == "run":
        run(given.out)
        return 0
    return compare(given.one, given.other, given.ignore)


if __name__ == "__main__":
    sys.exit(main())
