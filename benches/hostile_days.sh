#!/usr/bin/env bash
# What the command makes of hostile days: a full disk, no rights, signals, kills, rivals, damage. Each case says what must
# come of it; the slices of what goes on must be those of an undisturbed run.
#
#   benches/hostile_days.sh [MODEL [HEIGHT_MM]]     prints its part of docs/results/reliability.md; status 1 if a case fails
#
# PELLUCID names a program that is built already. The clock is set back by Debian's faketime, where it is there.
# Full and read-only disks need root, for mounting; without it those cases are left out and say so.
set -euo pipefail
cd "$(dirname "$0")/.."
model=$(realpath "${1:-datasets/models/octostar.glb}")
height=${2:-3}
[[ -n ${PELLUCID:-} ]] || cargo build --release --quiet --locked -p pellucid-cli
pellucid=$(realpath "${PELLUCID:-${CARGO_TARGET_DIR:-$PWD/target}/release/pellucid}")
work=$(mktemp -d)
trap 'umount "$work"/disk-* 2>/dev/null || true; rm -rf "$work"' EXIT
log=$work/log
failed=0
settings=$work/settings.json
echo '{ "judge_point_spp": 64, "proof_edge": 64 }' >"$settings"
job=(prepare "$model" --height-mm "$height" --settings "$settings" --strategy surface-first --iterations 6 --spp 8)

# Slices and manifest as one number.
digest() { (cd "$1" && find slices manifest.json -type f | sort | xargs sha256sum | sha256sum); }
# Nothing of a print, whole or half.
nothing() { ! compgen -G "$1*" >/dev/null; }

row() { # case, what must be, what was, 0 if that is so
    local verdict=holds
    [[ $4 == 0 ]] || { verdict=FAILS; failed=1; cp "$log" "/tmp/hostile-$(tr -c 'a-z\n' - <<<"$1").log"; }
    printf '| %s | %s | %s | %s |\n' "$1" "$2" "$3" "$verdict"
}

# Runs a job to its end; its status is the function's.
run() { "$pellucid" "${job[@]}" "$@" >"$log" 2>&1; }

calm() { ! grep -q panicked "$log"; }

start() {
    "$pellucid" "${job[@]}" "$@" >"$log" 2>&1 &
    child=$!
}

# Waits until a job claimed its folder, or kept its first checkpoint.
await() {
    local file=$1
    while [[ ! -e $file ]]; do
        kill -0 "$child" 2>/dev/null || return 1
        sleep 0.02
    done
}

status=0
begin=$(date +%s%N)
run --out "$work/calm"
took=$((($(date +%s%N) - begin) / 1000000))
wanted=$(digest "$work/calm")

cat <<EOF
## Hostile days

\`benches/hostile_days.sh $(basename "$model") $height\`, commit $(git log -1 --format='%h of %cs'): jobs of $((took / 1000)) s.
"Same" is slices and manifest, byte for byte those of an undisturbed run.

| case | must | was | verdict |
| --- | --- | --- | --- |
EOF

same() { [[ -d $1 && $(digest "$1") == "$wanted" ]]; }

signals() { # name of the case, folder, signals
    local out=$work/$2 name=$1
    shift 2
    start --out "$out"
    await "$out.job/refinement.bin" || true
    for signal in "$@"; do kill "$signal" "$child" 2>/dev/null || true; done
    status=0
    wait "$child" || status=$?
    local half=0
    nothing "$out/" || half=1
    local first=$status
    run --out "$out" --resume || true
    if [[ $first == 130 && $half == 0 ]] && same "$out" && calm; then ok=0; else ok=1; fi
    row "$name" "status 130, no half print; resumed: same" "status $first" "$ok"
}
signals "Ctrl-C" int -INT
signals "Ctrl-C twice" int-twice -INT -INT
signals "termination" term -TERM
signals "terminal closed" hup -HUP

equal=0
moments=10
for i in $(seq $moments); do
    out=$work/kill-$i
    start --out "$out"
    sleep "$(awk "BEGIN { print $took / 1000 * ($i - 0.5) / $moments }")"
    kill -KILL "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || true
    # A kill after the end finds a whole print.
    [[ -d $out ]] || run --out "$out" --resume || true
    if same "$out" && calm; then equal=$((equal + 1)); fi
    rm -rf "$out" "$out".*
done
row "killed at $moments moments from start to end" "resumed: same, each time" "$equal of $moments" $((moments - equal))

out=$work/rival
start --out "$out"
await "$out.job/lock" || true
first=$child
status=0
"$pellucid" "${job[@]}" --out "$out" --force >"$log.rival" 2>&1 || status=$?
told=$(grep -c "another process is at work" "$log.rival" || true)
wait "$first" || true
if [[ $status == 1 && $told -ge 1 ]] && same "$out"; then ok=0; else ok=1; fi
row "two jobs into one folder" "second: status 1, told; first: same" "status $status" "$ok"

for kept in record.json refinement.bin judged.bin; do
    out=$work/damaged-$kept
    start --out "$out"
    await "$out.job/$kept" || true
    kill -KILL "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || true
    if [[ -f $out.job/$kept ]]; then truncate -s -100 "$out.job/$kept"; fi
    status=0
    run --out "$out" --resume || status=$?
    if calm && { [[ $status == 1 && ! -d $out ]] || same "$out"; }; then ok=0; else ok=1; fi
    row "$kept cut short" "refused, or same" "status $status" "$ok"
done

out=$work/robbed
start --out "$out"
await "$out.job/refinement.bin" || true
rm -rf "$out.job"
status=0
wait "$child" || status=$?
if calm && { [[ $status == 1 && ! -d $out ]] || same "$out"; }; then ok=0; else ok=1; fi
row "checkpoints removed while it works" "same, or status 1 and no print" "status $status" "$ok"

for handles in 4 8 16; do
    out=$work/handles-$handles
    status=0
    (ulimit -n $handles && run --out "$out" --force) || status=$?
    if calm && { [[ $status == 1 && ! -d $out ]] || same "$out"; }; then ok=0; else ok=1; fi
    row "$handles file handles" "status 1 and no print, or same" "status $status" "$ok"
done

status=0
"$pellucid" "${job[@]}" --out "$work/deaf" >/dev/full 2>/dev/full || status=$?
if [[ $status == 1 ]] && same "$work/deaf"; then ok=0; else ok=1; fi
row "nobody listens (output device full)" "status 1; the print is kept, same" "status $status" "$ok"

out=$work/taken
mkdir "$out" && echo mine >"$out/notes.txt"
status=0
run --out "$out" --force || status=$?
if [[ $status == 1 && $(cat "$out/notes.txt") == mine ]] && calm; then ok=0; else ok=1; fi
row "a folder with somebody's files, --force" "status 1, files kept" "status $status" "$ok"

if [[ $(id -u) == 0 ]] && mkdir "$work/disk-full" && mount -t tmpfs -o size=100k tmpfs "$work/disk-full" 2>/dev/null; then
    status=0
    run --out "$work/disk-full/print" || status=$?
    if [[ $status == 1 ]] && nothing "$work/disk-full/print/" && calm; then ok=0; else ok=1; fi
    row "disk full" "status 1, no half print" "status $status: $(tail -1 "$log" | cut -c1-90 | tr '|' '/' | sed "s#$work/##g")" "$ok"
    mkdir "$work/disk-read" && mount -t tmpfs -o ro tmpfs "$work/disk-read"
    begin=$(date +%s%N)
    status=0
    run --out "$work/disk-read/print" || status=$?
    spent=$((($(date +%s%N) - begin) / 1000000))
    if [[ $status == 1 && $spent -lt $took ]] && calm; then ok=0; else ok=1; fi
    row "read-only disk" "status 1, before the work" "status $status after $spent ms" "$ok"
else
    echo "| disk full, read-only disk | | not run: no right to mount | |"
fi

if command -v faketime >/dev/null; then
    out=$work/clock
    start --out "$out"
    await "$out.job/refinement.bin" || true
    kill -KILL "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || true
    status=0
    faketime '2001-01-01' "$pellucid" "${job[@]}" --out "$out" --resume >"$log" 2>&1 || status=$?
    if [[ $status == 0 ]] && same "$out" && calm; then ok=0; else ok=1; fi
    row "clock set back by decades, then resumed" "same" "status $status" "$ok"
else
    echo "| clock set back | | not run: no faketime | |"
fi
exit $failed
