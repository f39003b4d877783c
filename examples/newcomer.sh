#!/usr/bin/env bash
# A newcomer's path, timed: demo, report, replay, a strategy of one's own, its place on a leaderboard.
# From a fresh clone: examples/newcomer.sh [DIRECTORY]
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-runs/newcomer}
began=$SECONDS
say() { printf '%4d s  %s\n' "$((SECONDS - began))" "$1"; }

make demo DEMO_DIR="$out/demo"
say "installed, and the demo's leaderboard is there"
.venv/bin/warpgrasp report "$out/demo" -o "$out/report.html" --workers 2
say "$out/report.html: open it in a browser"
.venv/bin/warpgrasp show "$out/demo" --episode 3 -o "$out/replay.html"
say "$out/replay.html: an episode played again"
cp examples/least_touched_side.py "$out/mine.py"
cat > "$out/mine.toml" <<'SPEC'
schema = 1
name = "mine"
seed = 1990
episodes_per_cell = 16
objects = ["block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "mine"
strategy = "mine.py:LeastTouchedSide"
budget = { touches = 48 }
SPEC
.venv/bin/warpgrasp sweep "$out/mine.toml" -o "$out/mine" --workers 2
say "a strategy of one's own is on the leaderboard"
