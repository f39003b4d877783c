#!/usr/bin/env bash
# A newcomer's path, timed: the README's commands from a fresh clone, one after the other.
set -euo pipefail
cd "$(dirname "$0")/.."
began=$SECONDS
step() {
  local start=$SECONDS
  printf '\n$ %s\n' "$*"
  "$@"
  printf '== %d s, %d s since the start\n' "$((SECONDS - start))" "$((SECONDS - began))"
}

step make demo
step source .venv/bin/activate
step warpgrasp report runs/demo -o runs/demo/report.html
step warpgrasp show runs/demo --strategy ring6 --object wedge --episode 3 -o runs/demo/replay.html
step cp -r examples/mine .
step warpgrasp explore block --strategy mine/mine.py:LeastTouchedSide -o runs/try
step warpgrasp sweep mine/mine.toml -o runs/mine --workers 2
times
