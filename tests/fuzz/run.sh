#!/usr/bin/env bash
# Fuzzes every reader and prints the rows of the record in docs/results/reliability.md.
#
#   tests/fuzz/run.sh [SECONDS [TARGET...]]     1800 processor seconds a target by default, all targets
#   tests/fuzz/run.sh rows                      the rows again
#
# It may be stopped and run again: a target goes on from its corpus until it has had its seconds, all runs together. A crash
# ends its target and stays in work/crashes; mend it, keep its input in regressions/TARGET, remove it there and run again.
# A stable compiler does: RUSTC_BOOTSTRAP switches its unstable flags on.
set -euo pipefail
cd "$(dirname "$0")"
work=$PWD/work
rows_only=0
[[ ${1:-} == rows ]] && { rows_only=1; shift; }
seconds=${1:-1800}
shift || true
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || mapfile -t targets < <(ls seeds)
mkdir -p "$work/runs" "$work/crashes"

export RUSTC_BOOTSTRAP=1 RAYON_NUM_THREADS=1 ASAN_OPTIONS=detect_leaks=0
host=$(rustc -vV | sed -n 's/^host: //p')
built=${CARGO_TARGET_DIR:-$PWD/target}/$host/release
[[ -d /dev/shm ]] && export TMPDIR=/dev/shm

sum() { awk -v key="$2" '$1 == key { s += $2 } END { printf "%d", s }' "$work/runs/$1" 2>/dev/null || echo 0; }
last() { awk -v key="$2" '$1 == key { s = $2 } END { printf "%d", s }' "$work/runs/$1"; }

build() {
    # One lock for both workspaces: what only this one needs is added to a copy.
    cp ../../Cargo.lock .
    # As cargo-fuzz sets them.
    local arguments="-sanitizer-coverage-level=4 -sanitizer-coverage-inline-8bit-counters -sanitizer-coverage-pc-table \
-sanitizer-coverage-trace-compares -simplifycfg-branch-fold-threshold=0"
    RUSTFLAGS="-Cpasses=sancov-module $(printf -- '-Cllvm-args=%s ' $arguments)-Zsanitizer=address -Cdebug-assertions \
--cfg fuzzing" cargo build --quiet --release --target "$host"
}

# Reads inputs that took too long by the clock again, with time to spare: beside other work that alone says little.
# Fails where one takes its 20 s of the processor, or does not end.
again() {
    local target=$1 input seconds TIMEFORMAT='%U'
    for input in "$work/crashes/$target"/timeout-*; do
        [[ -e $input ]] || continue
        seconds=$({ time READER=$target "$built/reader" -timeout=600 "$input" >/dev/null 2>&1; } 2>&1) || return 1
        awk -v s="$seconds" 'BEGIN { exit !(s < 20) }' || return 1
        mv "$input" "$work/corpus/$target/"
    done
}

# Runs a target for some seconds of the clock and notes what came of it, with the seconds of the processor.
fuzz() {
    local target=$1 time=$2 log=$work/$1.log took=$work/$1.took status=0 TIMEFORMAT='%U %S'
    mkdir -p "$work/corpus/$target" "$work/crashes/$target"
    # The words of its seeds, to build inputs from.
    { grep -IhoE '[A-Za-z_][A-Za-z_0-9]{2,31}' -r "seeds/$target" || true; } | sort -u | sed 's/.*/"&"/' >"$work/$target.words"
    local words=()
    # An empty dictionary is refused.
    [[ ! -s $work/$target.words ]] || words=(-dict="$work/$target.words")
    { time READER=$target "$built/reader" -max_total_time="$time" -rss_limit_mb=2048 -malloc_limit_mb=512 -timeout=20 \
        -max_len=65536 "${words[@]}" -artifact_prefix="$work/crashes/$target/" -print_final_stats=1 \
        "$work/corpus/$target" "seeds/$target" >"$log" 2>&1; } 2>"$took" || status=$?
    {
        # At least one, so that it comes to an end beside whatever else runs.
        awk '{ printf "seconds %d\n", $1 + $2 + 1 }' "$took"
        sed -nE 's/^stat::number_of_executed_units: +/executions /p' "$log"
        { grep -E '^#[0-9]+.* cov: ' "$log" || true; } | tail -1 | sed -E 's/.* cov: ([0-9]+) ft: ([0-9]+).*/edges \1\nfeatures \2/'
    } >>"$work/runs/$target"
    # What libFuzzer ends with after an input that took too long.
    [[ $status != 70 ]] || ! again "$target" || status=0
    [[ $status == 0 ]] || { echo "$target: stopped with status $status, see $log" >&2; return 1; }
}

if [[ $rows_only == 0 ]]; then
    build
    for target in "${targets[@]}"; do
        while left=$((seconds - $(sum "$target" seconds))) && [[ $left -gt 0 ]]; do
            # In parts, so that little is lost where it is stopped.
            fuzz "$target" $((left < 300 ? left : 300)) || break
        done
    done
fi
echo "| target | seconds | executions | edges | inputs kept | open crashes |"
echo "| --- | --- | --- | --- | --- | --- |"
for target in "${targets[@]}"; do
    [[ -e $work/runs/$target ]] || continue
    kept=$(find "$work/corpus/$target" -type f | wc -l)
    crashes=$(find "$work/crashes/$target" -type f | wc -l)
    echo "| $target | $(sum "$target" seconds) | $(sum "$target" executions) | $(last "$target" edges) | $kept | $crashes |"
done
