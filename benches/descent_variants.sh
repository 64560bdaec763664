#!/usr/bin/env bash
# What settings of descent do to an object: refines it by surface-first, by descent, and by descent with one setting
# changed at a time, and prints a Markdown table of what the judge finds. A few minutes a centimetre of object.
# With a third argument, a regular expression, only variants whose name it matches.
# usage: benches/descent_variants.sh MODEL HEIGHT_MM [VARIANTS]
set -euo pipefail
cd "$(dirname "$0")/.."
model=$1 height=$2 wanted=${3:-}
cargo build --quiet --release --bin pellucid
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

variant() { # name, settings in JSON without braces, further arguments
    local name=$1 settings=$2
    shift 2
    [[ $name =~ $wanted ]] || return 0
    echo "{ \"judge_point_spp\": 64, \"proof_edge\": 64${settings:+, $settings} }" >"$work/settings.json"
    target/release/pellucid prepare "$model" --height-mm "$height" --settings "$work/settings.json" "$@" \
        --out "$work/out" --force >"$work/log" 2>&1
    # The terminal's summary: mean dE2000 per voxel, at 0.1 mm, sharpness, and the seconds of the refinement.
    local voxel fine sharp seconds
    voxel=$(sed -n 's/^colour error.* unrefined, \([0-9.]*\) refined.*/\1/p' "$work/log")
    fine=$(sed -n 's/^as seen.* unrefined, \([0-9.]*\) refined.*/\1/p' "$work/log")
    sharp=$(sed -n 's/.*sharpness [0-9.]* and \([0-9.]*\)$/\1/p' "$work/log")
    seconds=$(sed -n 's/^ *refine *\([0-9.]*\) s$/\1/p' "$work/log")
    echo "| $name | $voxel | $fine | $sharp | $seconds |"
}

printf '# Descent: what its settings do\n\n'
echo "- command: benches/descent_variants.sh $model $height${wanted:+ \"$wanted\"}"
echo "- version: commit $(git rev-parse --short HEAD) of $(git log -1 --format=%cs)"
echo "- machine: $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1), $(nproc) cores"
printf '\nOne seed. Mean dE2000 to the printable target, as the judge finds it with paths of its own.\n\n'
printf '| variant | voxel | 0.1 mm | sharpness | seconds |\n| --- | ---: | ---: | ---: | ---: |\n'
variant "surface-first" '' --strategy surface-first
variant "descent" ''
variant "descent, another seed" '' --seed 1
variant "20 iterations, not 34" '' --iterations 20
variant "40 iterations" '' --iterations 40
variant "2 paths a point in the prediction, not 4" '"spp": 2'
variant "8 paths a point in the prediction" '"spp": 8'
variant "1 path a point in the derivative, not 2" '"gradient_spp": 1.0'
variant "4 paths a point in the derivative" '"gradient_spp": 4.0'
variant "derivative by the network" '"gradient": "network"'
variant "prediction by averaged paths, the network between" '' --predictor rpnn
variant "prediction by averaged paths, another seed" '' --predictor rpnn --seed 1
variant "prediction by averaged paths, 8 of them" '"spp": 8' --predictor rpnn
variant "prediction by averaged paths, the newest at least 0.2" '"newest": 0.2' --predictor rpnn
variant "prediction by averaged paths, the newest at least 0.05" '"newest": 0.05' --predictor rpnn
variant "contrast 0, not 2" '"descent": { "contrast": 0.0 }'
variant "chroma 0, not 1" '"descent": { "chroma": 0.0 }'
variant "24 layers, not 12" '"refine": { "layers": 24 }'
variant "momentum 0.7, not 0.9" '"descent": { "momentum": 0.7 }'
variant "opened by no step of surface-first, not 5" '"descent": { "opening_steps": 0 }'
variant "forgiveness 1, not 0.5" '"descent": { "forgiveness": 1.0 }'
variant "forgiveness 0, not 0.5" '"descent": { "forgiveness": 0.0 }'
for seed in 0 1; do
    variant "steps by the bound, seed $seed" '"descent": { "rule": "bound" }' --seed $seed
    variant "steps by Barzilai and Borwein, seed $seed" '"descent": { "rule": "barzilai-borwein" }' --seed $seed
done
