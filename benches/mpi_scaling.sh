#!/usr/bin/env bash
# How one print scales over processes of one thread each, and a model of it: a table and its figures in Markdown.
#   benches/mpi_scaling.sh MODEL [options of pellucid prepare ...] >docs/results/mpi.md
# `pellucid-mpi` and its example `probe` must be on PATH (cargo build --release --bins --examples in crates/pellucid-mpi).
# Work is processor time outside messages, so that other work on the machine does not count.
set -euo pipefail
model=$(realpath "$1")
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export RAYON_NUM_THREADS=1 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
export OMPI_MCA_btl_vader_single_copy_mechanism=none
run() { mpirun --oversubscribe --bind-to none -n "$@"; }
run 2 probe | grep '^probe:' >"$work/log"
load=$(cut -d' ' -f1-3 /proc/loadavg)
for ranks in 1 2 4; do
    start=$(date +%s.%N)
    run "$ranks" pellucid-mpi --traffic prepare "$model" --out "$work/$ranks" "$@" 2>&1 >/dev/null | grep '^traffic:' >>"$work/log"
    echo "wall: $ranks $(python3 -c "import time; print(time.time() - $start)")" >>"$work/log"
    diff -rq "$work/1/slices" "$work/$ranks/slices" >&2
done
python3 - "$work/log" "$(basename "$model") $*" "$load" "$(nproc)" <<'PYTHON'
import re, sys
log, job, load, cores = sys.argv[1:]
number = lambda text: float(text.replace(",", ""))
work, meetings, size, wall = {}, {}, {}, {}
for line in open(log):
    if found := re.match(r"traffic: rank \d+ of (\d+): (\d+) meetings, (\d+) bytes, \S+ s in them; (\S+) s", line):
        ranks = int(found[1])
        work.setdefault(ranks, []).append(number(found[4]))
        meetings[ranks], size[ranks] = int(found[2]), int(found[3])
    elif found := re.match(r"wall: (\d+) (\S+)", line):
        wall[int(found[1])] = number(found[2])
    elif found := re.match(r"probe: 2 ranks, (\S+) s a meeting, (\S+) bytes/s added up, (\S+) bytes/s gathered", line):
        latency, added, gathered = map(number, found.groups())
most = {n: max(w) for n, w in work.items()}
shared = 2 * (most[1] - most[2])
serial = most[1] - shared
def model(n, latency, rate):
    # Sums and gathers in turn over a ring: each process sends what it has nearly twice.
    sent = 0 if n == 1 else meetings[2] * latency * (n - 1).bit_length() + size[2] * 2 * (n - 1) / n / rate
    return serial + shared / n + sent
print(f"""# One print on many machines

`benches/mpi_scaling.sh {job}` on {cores} cores shared with other work (load {load} at the start), a thread a process.
Work is the processor time of the busiest process outside messages; the slices are the same for every number.

| processes | work, of that of one | by the model | spread over processes | meetings | bytes in them | wall time, of that of one |
| --- | --- | --- | --- | --- | --- | --- |""")
for n in sorted(work):
    expected = (serial + shared / n) / most[1]
    spread = max(work[n]) / min(work[n])
    print(f"| {n} | {most[n] / most[1]:.3f} | {expected:.3f} | {spread:.3f} | {meetings[n]:,} | {size[n]:,} | {wall[n] / wall[1]:.2f} |")
print(f"""
The model is T(n) = S + P / n + m a log2 n + 2 b (n - 1) / (n r): of the work of one process S = {serial / most[1]:.3f} is done by
everyone, P = {shared / most[1]:.3f} is shared out (both from 1 and 2 processes; 4 check them), m meetings take a each, and the b bytes
in them pass at r. Between two processes here a = {latency * 1e6:.1f} us, r = {added / 1e9:.2f} GB/s added up and {gathered / 1e9:.2f} GB/s gathered.

What the model says of machines with as fast a core as this one, a process each, against one process:

| processes | messages cost nothing | 10 Gbit/s, 50 us | 100 Gbit/s, 2 us |
| --- | --- | --- | --- |""")
for n in (2, 4, 8, 16, 32):
    times = [most[1] / model(n, a, r) for a, r in ((0, 1e30), (50e-6, 1.25e9), (2e-6, 12.5e9))]
    print(f"| {n} | " + " | ".join(f"{t:.2f} times" for t in times) + " |")
PYTHON
