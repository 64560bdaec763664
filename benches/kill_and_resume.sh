#!/usr/bin/env bash
# Kills a job at random moments and resumes it; slices, manifest and errors must be those of a job that was left alone.
#   benches/kill_and_resume.sh MODEL TIMES [options of pellucid prepare ...]
# `pellucid` must be on PATH. Prints a line for each kill and exits with 1 at the first difference.
set -euo pipefail
model=$1 times=$2
shift 2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
errors() { python3 -c 'import json,sys; r=json.load(open(sys.argv[1])); print(json.dumps([r["evaluation"], [[i[k] for k in ("target","printable_target","smoothed")] for i in r["refinement"]["iterations"]]], sort_keys=True))' "$1"; }
start=$(date +%s.%N)
pellucid prepare "$model" --out "$work/whole" "$@" >/dev/null 2>&1
whole=$(python3 -c "import time; print(time.time() - $start)")
printf 'uninterrupted: %.1f s\n' "$whole"
errors "$work/whole/report.json" >"$work/expected"
for ((i = 1; i <= times; i++)); do
    rm -rf "$work/killed" "$work/killed.job"
    moment=$(python3 -c "import random; print(random.Random($i).uniform(0.02, 0.98) * $whole)")
    pellucid prepare "$model" --out "$work/killed" "$@" >/dev/null 2>&1 &
    job=$!
    sleep "$moment"
    kill -9 "$job" 2>/dev/null || true
    wait "$job" 2>/dev/null || true
    if [ -d "$work/killed" ]; then
        state="had ended"
    else
        state=$([ -d "$work/killed.job" ] && ls "$work/killed.job" | tr '\n' ' ' || echo "no checkpoint yet")
        pellucid prepare "$model" --out "$work/killed" --resume "$@" >/dev/null 2>"$work/stderr" ||
            { cat "$work/stderr" >&2; exit 1; }
    fi
    diff -rq "$work/whole/slices" "$work/killed/slices"
    cmp "$work/whole/manifest.json" "$work/killed/manifest.json"
    errors "$work/killed/report.json" | cmp - "$work/expected"
    printf 'kill %2d after %6.1f s (%s): same slices, manifest, errors\n' "$i" "$moment" "$state"
    rm -rf "$work"/.killed.partial*
done
