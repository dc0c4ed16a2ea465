#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""What each part of the tracker is worth: accuracy and time on recorded logs with each part left out in turn.

    ablation.py LOG=CAMERA... --model FILE [--seeds 3]

LOG is a folder in TUM format with ground truth, CAMERA its profile. Every log is replayed in lockstep, with the detector
as live and five frames late and every third frame only. Prints, as Markdown, median ATE in mm, frames
lost, and the tracker's median and 99th percentile in ms; times mean something on a machine that does nothing else.
"""
import argparse
import statistics
import sys
import tempfile
from pathlib import Path

from stillmap_runs import ROOT, RunFailed, run_stillmap

PARTS = ("", "carried_boxes", "motion_check", "point_trust", "alignment", "sampling", "adjustment", "loops")
TIMINGS = {"": [], " late": ["--detector-delay", "5", "--detector-every", "3"]}


def measure(arguments, log, camera, part, timing, out):
    reports = []
    for seed in range(1, arguments.seeds + 1):
        configs = [ROOT / "firmware-config/boards/two-core.toml", camera]
        settings = ["--set", f"detector.model={arguments.model}", "--set", f"runtime.seed={seed}"]
        if part:
            settings += ["--set", f'track.without=["{part}"]']
        reports.append(run_stillmap(arguments.binary, log, configs, out, "--mode", "lockstep", *settings, *timing))
    ate = statistics.median(1000 * r["accuracy"]["ate_rmse_m"] for r in reports)
    lost = statistics.mean(r["tracking"]["lost"] for r in reports)
    p50, p99 = (statistics.median(r["latency_ms"]["track"][p] for r in reports) for p in ("p50", "p99"))
    return f"{ate:.1f}, {lost:.1f}, {p50:.0f}/{p99:.0f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", metavar="LOG=CAMERA")
    parser.add_argument("--model", required=True, help="the network's ONNX file, or none")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--binary", default=ROOT / "build/release/bin/stillmap")
    arguments = parser.parse_args()
    columns = []
    for pair in arguments.logs:
        log, _, camera = pair.partition("=")
        if not (Path(log) / "groundtruth.txt").is_file() or not Path(camera).is_file():
            sys.exit(f"ablation.py: {pair}: expected LOG=CAMERA, a folder with groundtruth.txt and a camera's profile")
        columns += [(Path(log).name + name, log, camera, timing) for name, timing in TIMINGS.items()]
    print("| without | " + " | ".join(f"{name}: ATE mm, lost, ms" for name, *_ in columns) + " |")
    print("|---" * (len(columns) + 1) + "|", flush=True)
    with tempfile.TemporaryDirectory() as out:
        for part in PARTS:
            try:
                cells = [measure(arguments, log, camera, part, timing, Path(out)) for _, log, camera, timing in columns]
            except RunFailed as error:
                sys.exit(f"ablation.py: {error}")
            print(f"| {part or '(nothing)'} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
