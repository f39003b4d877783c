#!/bin/sh
# The tests on a machine with a CUDA GPU, and agreement with the CPU. The bench has no device option yet.
#
#   sweeps/bench/gpu.sh [DEVICE]        DEVICE is cuda:0 unless given
#
# Run from the repository's root, in the environment `make demo` makes. Not run on a GPU so far.
set -eu
device=${1:-cuda:0}
bin=${BIN:-.venv/bin}
"$bin/python" -m pytest -q -m "not slow"
"$bin/warpgrasp" warmup --device "$device"
"$bin/python" -m sweeps.bench.device_agreement --device "$device"
