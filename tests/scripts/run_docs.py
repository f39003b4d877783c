"""Runs every command and code block of the docs, in order, in a copy of the tree, and times each.

    python tests/scripts/run_docs.py [--only WORD] [--without WORD ...]

Each runs as it is written, but for what `SHRINKS` adds to make studies small, and the few that
`EXCUSED` names with the reason. What a page has made is there for the pages after it. One that ends
with another code than 0 is printed, and the end is 1.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))
from doc_blocks import ROOT, Block, blocks

SHIPPED = ROOT / "strategies/recognition/models.json"

EXCUSED = {
    r"make (test|check)": "runs these very tests",
    r"make studies-docs": "is every study that ships, whole: most of an hour",
    r"make models": "learns from more than a thousand episodes; `warpgrasp learn` itself is run",
    r"make validate": "installs from a package index; `warpgrasp validate` itself is run",
    r".*pip install '\.\[ray\]'.*": "installs from a package index; tests do not need Ray",
    r"pytest tests/sweeps/run/test_ray_engine.py": "wants Ray, and says so",
    r".*--engine ray.*": "wants Ray and a cluster that runs",
    r"sbatch .*": "wants SLURM; the script that it is handed is run",
    r"examples/newcomer\.sh": "is the commands around it, whole: a quarter of an hour",
    r"sweeps/bench/gpu\.sh": "wants a CUDA device",
}
"""What cannot run here, by a pattern of the whole command, and why."""

FEW = "--set episodes_per_cell=4"
SHRINKS = (
    (r"make pictures", r"make -o .venv/.installed pictures DEMO_EPISODES=5"),
    (r"make (?!demo|pictures)(.*)", r"make -o .venv/.installed \1"),  # installed already
    (r"make demo", r"make -o .venv/.installed demo DEMO_EPISODES=5"),
    (r"(.*)pip install (.*)", r"\1pip install --dry-run --no-index --no-build-isolation -q \2"),
    (r"(warpgrasp sweep (?:sweeps|mine)/.*)", r"\1 --set episodes_per_cell=1"),
    (r"(warpgrasp watch (?!.*--terminal).*)", r"\1 --terminal"),  # a page is served until Ctrl-C
    (r"(warpgrasp sweep .*) --until [\d.]+", r"\1 --until 100"),
    (r"(warpgrasp sweep .*) --set episodes_per_cell=\d+", rf"\1 {FEW}"),
    (r"(warpgrasp sweep .*)", rf"\1 {FEW}"),
    (r"(warpgrasp race .*)", r"\1 --budget-episodes 200"),
    (r"(warpgrasp sensitivity .*)", r"\1 --episodes 1"),
    (r"(warpgrasp learn .*)", r"\1 --strategy ring6 --episodes 4 --force"),
    (r"(.*recognition_reliability.py).*",
     r"\1 --episodes 1 --unlisted 1 --strategy ring6"),
    (r"(warpgrasp bench.*)", r"\1 --quick --only touches --only start"),
    (r"(warpgrasp validate --only closing)", r"\1 --poses 1"),
    # beside the whole table, of which pages take figures
    (r"(warpgrasp validate -o) docs/fidelity", r"\1 runs/validate --only puma"),
    (r"(warpgrasp validate.*)", r"\1 --only puma --only pads --only distances"),
    (r"(.*pytest .*)", r"\1 -q --collect-only"),  # the tests themselves run in their own time
    (r"(.*kill_study.py).*", r"\1 --kills 2 --units 6"),
    (r"(.*fuzz_(?:spec|files).py).*", r"\1 --count 20"),
    (r"(.*self_contact_table.py)", r"\1 --hands utah_mit --settings default --episodes 1"),
    (r"(.*paired_scores.py run \S+)", r"\1 --strategies ring6 --episodes 2"),
    (r"(.*chosen_bodies.py \S+).*",
     r"\1 --strategies ring6 --episodes 1 || test $? -eq 1"),  # a loss may not be excluded
    (r"(.*memory_study.py)", r"\1 --episodes 640 1280"),
    (r"(.*false_alarm.py)", r"\1 --studies 1 --episodes 1"),
    (r"(.*tests/scripts/touch_quality.py).*", r"\1 --worlds 4 --lockstep 16"),
)
"""What makes a command small: a pattern of the whole command, and what is run instead."""

PLACEHOLDERS = {"SPEC.toml": "study.toml", "DIR": "runs/study"}
VERDICT = r"warpgrasp validate.*"
"""Ends with 1 where a difference is beyond its bound or an engine is not installed: an answer."""

_HEAD = """schema = 1
name = "a fragment of a page"
seed = 1
episodes_per_cell = 1
"""
_STRATEGY = '[[strategy]]\nname = "ring6"\n'
_OBJECTS = 'objects = ["block"]\n'


def excuse(block: Block) -> str | None:
    """Why a command is not run; None where it is."""
    return next((why for pattern, why in EXCUSED.items()
                 if block.kind == "shell" and re.fullmatch(pattern, block.text)), None)


def is_name(block: Block) -> bool:
    """Whether the text within a sentence names a command that wants arguments, as `warpgrasp fit`.

    Its name is then right; anything else that is wrong with it raises.
    """
    from cyclopts import MissingArgumentError

    from sweeps.cli.main import app

    words = block.text.split()
    if not block.inline or words[0] != "warpgrasp" or len(words) != 2 or words[1][0] == "-":
        return False
    try:
        app.parse_args(words[1:], exit_on_error=False, print_error=False)
    except MissingArgumentError:
        return True
    return False


def shrunk(command: str) -> str:
    """The command as it is run: placeholders filled in, studies small."""
    for name, value in PLACEHOLDERS.items():
        command = re.sub(rf"\b{re.escape(name)}(?!\w)", value, command)
    for pattern, small in SHRINKS:
        if re.fullmatch(pattern, command):
            return re.sub(f"^{pattern}$", small, command)
    return command


def whole_spec(fragment: str) -> str:
    """A spec of which a page shows a part: with the rest of what a spec must have."""
    if re.search(r"^schema\b", fragment, re.MULTILINE):
        return fragment
    head = _HEAD + ("" if re.search(r"^objects\b", fragment, re.MULTILINE) else _OBJECTS)
    tail = "" if "[[strategy]]" in fragment else _STRATEGY
    return head + fragment + tail


def prepare(folder: Path) -> None:
    """The files that a reader brings: points, meshes and an arm of one's own, as the pages name
    them."""
    import trimesh

    from warpgrasp.export.robot_tree import arm_hand_tree
    from warpgrasp.export.urdf import urdf_text
    from warpgrasp.parameters import ArmTable, HandTable, PadTable

    rng = np.random.default_rng(1)
    angle, height = rng.uniform(-np.pi, np.pi, (3, 60)), rng.uniform(0.01, 0.12, (3, 60))
    points = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), height], -1)
    rows = [f"cup {n},{x:.5f},{y:.5f},{z:.5f}" for n, part in enumerate(points)
            for x, y, z in part]
    (folder / "points.csv").write_text("\n".join(["set,x_m,y_m,z_m", *rows]) + "\n")
    np.save(folder / "touches.npy", points)
    trimesh.creation.cylinder(4.0, 9.0).export(folder / "mug.stl")
    trimesh.creation.cylinder(3.0, 11.0).export(folder / "jug.stl")
    (folder / "mine.json").write_bytes(SHIPPED.read_bytes())
    (folder / "vase.csv").write_text("z_mm,r_mm\n0,30\n60,40\n110,25\n")
    shutil.copy(folder / "examples/mine/mine.py", folder)
    arm, _ = urdf_text(arm_hand_tree(ArmTable(kind="ur5e"), HandTable(), PadTable()), (),
                       name="arm", mesh_stem="none")
    (folder / "my_arm.urdf").write_text(arm.replace('"flange"', '"tool0"'))


def copy_tree(folder: Path) -> None:
    """What git knows or would: sources, without what was built or run. The environment is lent."""
    names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT,
                           capture_output=True, text=True, check=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    (folder / ".venv").symlink_to(ROOT / ".venv")


def environment(folder: Path) -> dict[str, str]:
    """A reader's shell: the environment activated, the copy's sources before all others."""
    return {**os.environ, "PATH": f"{folder}/.venv/bin:{os.environ['PATH']}", "NO_COLOR": "1",
            "PYTHONPATH": str(folder), "SCRATCH": str(folder / "runs"),
            "SLURM_ARRAY_TASK_ID": "1", "SLURM_ARRAY_TASK_COUNT": "1", "SLURM_CPUS_PER_TASK": "1"}


def steps() -> list[tuple[Block, str]]:
    """What is run: each distinct command once, each page's Python and each spec, in order."""
    found: list[tuple[Block, str]] = []
    done: set[str] = set()
    for number, block in enumerate(blocks()):
        if block.text in done or excuse(block) or is_name(block):
            continue
        done.add(block.text)
        if block.kind == "toml":
            found.append((block, f"warpgrasp check block-{number}.toml"))
        elif block.kind == "python":
            found.append((block, "python block.py"))
        elif block.kind == "script":
            found.append((block, "bash block.sh"))
        else:
            found.append((block, shrunk(block.text)))
    return found


def run_step(block: Block, command: str, folder: Path, before: str) -> tuple[int, str]:
    """Runs one in the copy; its exit code, and what it said where that is not what it should be."""
    if block.kind == "toml":
        (folder / command.split()[-1]).write_text(whole_spec(block.text))
    elif block.kind == "python":
        guarded = "\n".join(f"    {line}" for line in (before + block.text).splitlines())
        (folder / "block.py").write_text(f'if __name__ == "__main__":\n{guarded}\n')
    elif block.kind == "script":
        lines = re.sub(r"(warpgrasp sweep (?:.*\\\n)*.*)", rf"\1 {FEW}", block.text)
        (folder / "block.sh").write_text(lines)
    done = subprocess.run(["bash", "-euc", command], cwd=folder, env=environment(folder),
                          capture_output=True, text=True, stdin=subprocess.DEVNULL)
    right = (0, 1) if re.fullmatch(VERDICT, block.text) else (0,)
    return done.returncode, "" if done.returncode in right else (done.stdout + done.stderr)[-2000:]


def main() -> int:
    """Runs them all; 1 where one did not end well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="those whose page or text has this word")
    parser.add_argument("--without", default=[], nargs="+",
                        help="leave out those whose text has one of these words")
    asked = parser.parse_args()
    chosen = [(block, command) for block, command in steps()
              if (asked.only in block.place or asked.only in block.text)
              and not any(word in block.text for word in asked.without)]
    failed = 0
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "warpgrasp"
        copy_tree(folder)
        prepare(folder)
        earlier: dict[str, str] = {}  # Python that a page has shown so far
        for number, (block, command) in enumerate(chosen, 1):
            start = time.monotonic()
            code, said = run_step(block, command, folder, earlier.get(block.page, ""))
            if block.kind == "python" and not said:
                earlier[block.page] = earlier.get(block.page, "") + block.text
            failed += bool(said)
            shown = command if block.kind == "shell" else f"{command} ({block.kind})"
            print(f"{number:3d}/{len(chosen)} {time.monotonic() - start:7.1f} s  "
                  f"{'FAILED' if said else 'ok':6s} {code:3d}  {block.place}  {shown}", flush=True)
            if said:
                print(said, flush=True)
    for block in {b.text: b for b in blocks() if excuse(b)}.values():
        print(f"not run: {block.place}  {block.text}: {excuse(block)}")
    print(f"{len(chosen)} run, {failed} failed, {time.monotonic() - began:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
