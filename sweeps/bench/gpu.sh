#!/bin/sh
# What to run on a machine with a CUDA GPU: the tests there, compiling, comparisons with the CPU, and
# rates beside it.
#
#   sweeps/bench/gpu.sh [DEVICE] [OUT]        cuda:0 and runs/gpu unless given
#
# Run from the repository's root, in the environment `make demo` makes.
set -eu
device=${1:-cuda:0}
out=${2:-runs/gpu}
bin=${BIN:-.venv/bin}
"$bin/python" -m pytest -q -m "not slow"
"$bin/warpgrasp" warmup --device "$device"
"$bin/python" -m sweeps.bench.device_agreement --device "$device"
"$bin/warpgrasp" bench --device "$device" -o "$out"
