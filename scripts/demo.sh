#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Shows what Stillmap does, from nothing: builds it, renders a log of people walking through a room, and runs on it with
# and without rejection of what moves.
#
#   demo.sh [--frames 300] [--out demo-out]
#
# What is there already is used again; to start afresh, remove the output folder.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

fail() {
  echo "demo.sh: $*" >&2
  exit 1
}

frames=300
out=$root/demo-out
while [ $# -gt 0 ]; do
  case "$1 ${2:-}" in
    --frames\ [1-9]*) frames=$2 ;;
    --out\ ?*) out=$2 ;;
    *) fail "unknown argument $1 ${2:-}; usage: demo.sh [--frames 300] [--out demo-out]" ;;
  esac
  shift 2
done
mkdir -p "$out" || fail "cannot write $out; name a folder that you may write to with --out"
out=$(cd "$out" && pwd)

# logged WORDS COMMAND...: the words as a line on the screen, the command's own words in a file that is shown if it fails.
logged() {
  [ -z "$1" ] || echo "$1"
  shift
  "$@" >"$out/last-step.txt" 2>&1 || {
    tail -n 30 "$out/last-step.txt" >&2
    fail "failed: $*"
  }
}

"$root/scripts/setup.sh"
cd "$root"
logged "building (a few minutes the first time)" build release stillmap stillmap_synth

log=$out/log-$frames
if [ ! -d "$log" ]; then
  rm -rf "$log.part"
  logged "rendering $frames frames of a room with six people in safety vests" \
    build/release/bin/stillmap-synth --out "$log.part" --seed 3 --people 6 --frames "$frames"
  mv "$log.part" "$log"
fi
logged "making the demo's detection network" scripts/make_demo_model.py "$out/demo.onnx"

# play NAME OPTION...
play() {
  logged "running: $1" build/release/bin/stillmap run --config firmware-config/cameras/synthetic.toml \
    --config firmware-config/demo.toml --set "detector.model=$out/demo.onnx" --source "tum:$log" --listen off \
    --groundtruth "$log/groundtruth.txt" --trajectory "$out/$1.txt" --map "$out/$1.ply" --report "$out/$1.json" "${@:2}"
}
play with_rejection --mode lockstep
play without_rejection --mode lockstep --set track.dynamic_rule=off
play realtime --mode realtime

logged "drawing the maps and the trajectories" \
  scripts/plot_trajectory.py "$log/groundtruth.txt" "$out/with_rejection.txt" "$out/without_rejection.txt" "$out/realtime.txt" \
  --out "$out/trajectories.png"
for run in with_rejection without_rejection; do
  logged "" scripts/render_map.py "$out/$run.ply" "$out/$run.png" --trajectory "$out/$run.txt"
done
rm -f "$out/last-step.txt"

echo
scripts/report_table.py "with rejection=$out/with_rejection.json" "without rejection=$out/without_rejection.json" \
  "realtime, with=$out/realtime.json"
cat <<END

Realtime plays the log at 30 frames a second, as a camera would; lockstep takes each frame in turn on one core,
decoding included. ATE is the trajectory's error against the ground truth.

  maps          $out/with_rejection.ply, .png (top view; without_rejection beside it)
  trajectories  $out/with_rejection.txt, $out/trajectories.png

To watch it live, open http://127.0.0.1:8765 (or point Foxglove at ws://127.0.0.1:8765) during
  build/release/bin/stillmap run --config firmware-config/cameras/synthetic.toml --config firmware-config/demo.toml \\
    --set detector.model=$out/demo.onnx --source tum:$log --mode realtime
END
