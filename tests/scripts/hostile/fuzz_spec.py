"""Specs that nobody meant: valid ones with pieces replaced, and texts cut and spliced.

    python tests/scripts/hostile/fuzz_spec.py --count 10000 --seed 1

Each must be read or refused with a line and a reason, never with another exception, and within
five seconds of processor time. What once went wrong is kept in CORPUS.
"""

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec

LIMIT_S = 5.0
CORPUS: tuple[str, ...] = (
    "", "\x00", "[", "a = ", "[[strategy]]", "strategy = [[]]", "sweep = 3", "[sweep]\ngrid = 1",
    "objects = [[]]", "objects = [{}]", "schema = true", "seed = 1e400", "[sweep.grid]\nseed = [1]",
    "[sweep.sobol]\nn = {}", "[sweep.sobol.n]\nlow = 1", "[hand]\nlink_length_mm = [[1], 2, 3]",
    "schema = 1979-05-27", "sensors = []", "[[sensors]]", "[sweep.grid]\n'' = [1]",
    "objects = [{ mesh = \"\\u0000\", units = \"m\" }]", f"seed = {'9' * 4000}",
    "objects = [{ mesh = \"/dev/zero\", units = \"m\" }]",
    "objects = [{ mesh = \"../../etc/passwd\", units = \"m\" }]",
    "objects = [{ name = \"t\", compound = [{ shape = {} }] }]",
    "objects = [{ name = \"t\", compound = [{ shape = \"block\", size_mm = [9, "
    f"1{'0' * 400}, 9] }}] }}]",
    "[[strategy]]\nname = \"a\"\nwaypoints = { kind = \"csv\", file = \"\\u0000\" }",
    "[sweep.sobol]\nn = 1000000\n\"arm.guarded_step_s\" = { low = 0, high = 1 }",
    "episodes_per_cell = 1\nobjects = [\"block\"]\n[[strategy]]\nname = \"a\"\nstrategy = "
    "\"gaussian-process\"\noptions = { length_m = \"block\" }",
    f"[[strategy]]\nname = \"a\"\nbudget = {{ volume_ratio = 1{'0' * 400} }}",
    "[sweep.lhs]\nn = 4\n\"hand.link_length_mm\" = { low = [40, [1]], high = [nan, 1, 2] }",
    "[sweep.lhs]\nn = 4\n\"hand.link_length_mm\" = { low = [], high = [] }",
    "[sweep.lhs]\nn = 100000\n\"arm.guarded_step_s\" = { low = 0, high = 1 }",
)
VALID: dict[str, Any] = {
    "schema": 1, "name": "a", "seed": 7, "episodes_per_cell": 3,
    "objects": ["block", {"name": "egg", "superquadric": {
        "size_mm": [30, 30, 45], "exponents": [1.0, 1.0], "taper": [0.1, 0.0]}},
        {"name": "tee", "compound": [{"shape": "block", "size_mm": [20, 60, 80]},
                                     {"shape": "sphere", "radius_mm": 20, "at_mm": [0, 0, 9]}]}],
    "strategy": [{"name": "ring6"}, {"name": "b", "waypoints": [
        {"kind": "ring", "count": 4, "tilt_deg": 30}, {"kind": "csv", "file": "poses.csv"}],
        "closings": ["curl25"], "order": ["containment", "decide"], "refit_every": 2},
        {"name": "c", "strategy": "random", "budget": {"touches": 40, "volume_ratio": 1.5},
         "noise_stream": 1},
        {"name": "d", "strategy": "gaussian-process", "options": {"length_m": 0.02}}],
    "hand": {"link_length_mm": [43, 33, 28], "tendon_friction": 0.1},
    "sensors": {"tension_readings": 4, "contact_estimator": "intrinsic"},
    "fit": {"taper": True, "loss": "none"}, "object": {"yaw_deg": 20.0},
    "sweep": {"grid": {"sensors.tendon_threshold_N": [3.0, 6]},
              "zip": {"object.x_mm": [400, 500], "object.y_mm": [0.0, 1.0]},
              "sobol": {"n": 4, "arm.guarded_step_s": {"low": 0, "high": 1}},
              "lhs": {"n": 4, "strategy.aim": {"low": 0, "high": 1}}},
}
ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 10**6, 10**12, 2**63, 10**400, -0.0, 1e-300, 1e300, float("nan"),
    float("inf"), "", "block", "ring6", "ring", "\x00", "a\nb", "../../x", "\U0010ffff", "x" * 5000,
    [], [[]], {}, [1] * 50, {"low": 1}, {"low": 0, "high": 1}, {"kind": "top"}, ["curl25"],
    {"mesh": "no.stl", "units": "m"}, {"name": "c", "compound": []}, "sensors.tendon_threshold_N",
)


def mutated(chance: random.Random) -> str:
    """A spec with one to four things wrong with it, perhaps."""
    value = _copy(VALID)
    if chance.random() < 0.9:
        del value["objects"][1:]  # bodies take most of the time
    for _ in range(chance.randint(1, 4)):
        _spoil(value, chance)
    text = "\n".join(f"{_string(k)} = {write(v)}" for k, v in value.items())
    if chance.random() < 0.3:
        for _ in range(chance.randint(1, 5)):
            at = chance.randrange(len(text) + 1)
            cut = chance.randrange(12)
            text = text[:at] + chance.choice(("", '"', "[", "]", "{", "}", "=", ".", "\n", "\\",
                                              "'''", "#", "nan", "\x7f", text[at:at + 30])
                                             ) + text[at + cut:]
    return text


def _spoil(value: Any, chance: random.Random) -> None:
    """Replaces, removes, renames or adds something at a random place."""
    while True:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        if not keys:
            break
        key = chance.choice(keys)
        if isinstance(value[key], dict | list) and chance.random() < 0.75:
            value = value[key]
            continue
        action = chance.random()
        if action < 0.6:
            value[key] = _copy(chance.choice(ODD))
        elif action < 0.75:
            del value[key]
        elif isinstance(value, dict):
            value[str(key)[:-1] if action < 0.9 else str(key) + "x"] = value[key]
        else:
            value.append(_copy(chance.choice(ODD)))
        return


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copy(v) for k, v in value.items()}
    return [_copy(v) for v in value] if isinstance(value, list) else value


def write(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_string(k)} = {write(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(write, value))}]"
    if isinstance(value, str):
        return _string(value)
    if value is None:
        return "1979-05-27T07:32:00Z"
    return str(value).lower()


def _string(text: str) -> str:
    return '"' + "".join(c if (c.isascii() and c.isalnum()) or c in "._-/" else f"\\U{ord(c):08x}"
                         for c in text) + '"'


def outcome(folder: Path, text: str) -> str:
    """`read`, `refused`, or what went wrong."""
    file = folder / "spec.toml"
    file.write_text(text, encoding="utf-8", errors="surrogatepass")
    began = time.process_time()
    try:
        read_spec(file)
        found = "read"
    except SpecError as error:
        found = "refused"
        for problem in error.problems:
            if not (problem.where.startswith(f"{file}:") and problem.what):
                found = f"a problem without its place or reason: {problem}"
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
    seconds = time.process_time() - began
    return found if seconds < LIMIT_S else f"took {seconds:.1f} s"


def fuzz(folder: Path, count: int, seed: int) -> tuple[dict[str, int], list[tuple[str, str]]]:
    """How often each outcome came, and the specs that something went wrong with."""
    (folder / "poses.csv").write_text("x_m,y_m,z_m,qx,qy,qz,qw\n0.4,0,0.3,1,0,0,0\n")
    counts: dict[str, int] = {}
    wrong: list[tuple[str, str]] = []
    for n in range(count):
        text = CORPUS[n] if n < len(CORPUS) else mutated(random.Random(f"{seed} {n}"))
        found = outcome(folder, text)
        if found not in ("read", "refused"):
            wrong.append((found, text))
            found = "wrong"
        counts[found] = counts.get(found, 0) + 1
    return counts, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        counts, wrong = fuzz(Path(folder), given.count, given.seed)
    for found, text in wrong[:10]:
        print(f"--- {found[:500]}\n{text[:3000]}")
    print(counts)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
