#!/bin/sh
# Points a second and error of the network on a GPU, beside the processor's own kernels.
#
#   benches/device/measure.sh [cuda|metal|cpu] [build|run]
#
# `build` compiles (minutes; CUDA needs nvcc and the crates' sources), `run` measures in under 5 minutes
# and needs no compiler; without the second word it does both. Writes what it prints to
# device_rate.json in $OUT, or in the current folder. Not run yet: no GPU was at hand.
set -eu
device=${1:-cuda}
step=${2:-both}
feature=$device
[ "$device" = cpu ] && feature=candle
cd "$(dirname "$0")/../.."
program=${CARGO_TARGET_DIR:-target}/release/examples/device_rate
if [ "$step" != run ]; then
    cargo build --release -p pellucid-benches --features "$feature" --example device_rate
fi
if [ "$step" != build ]; then
    timeout 290 "$program" "$device" | tee "${OUT:-.}/device_rate.json"
fi
