#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/detector.md: what each network costs, finds, and does to the trajectory.

    detector_table.py --log DIR --float FLOAT.onnx NETWORK.onnx... [--seeds 3]

DIR: a log in TUM format with groundtruth.txt and mask/ (the people's true pixels, see stillmap-coverage). FLOAT.onnx is what
quantize_model.py --float writes, and gets a row, too; every network's manifest lies beside it. Times: OpenCV's own on one and
two threads (wall), and the runtime's, with its own int8 kernels, on one (processor time). Prints a table in Markdown, and
writes all figures to OUT/detector_table.json. Wants a machine with nothing else to do.
"""
import argparse
import json
import statistics
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import onnx

from evaluate import camera_of, positive
from network_compare import compare_boxes, time_ms
from quantize_model import pictures_of, read_blobs
from stillmap_runs import ROOT, RunFailed, run_stillmap

FRAMES = 32  # of the log, for the agreement with float
HEAD = ("network", "input", "OpenCV, 1 / 2 threads", "runtime, CPU", "float's boxes found", "its boxes in float", "views in boxes", "in carried boxes",
        "in the mask", "background in the mask", "ATE lockstep", "ATE realtime")


def fail(message):
    sys.exit(f"detector_table.py: {message}")


def read_manifest(network):
    path = network.with_suffix(".toml")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))["detector"]
    except (OSError, KeyError, tomllib.TOMLDecodeError) as error:
        return fail(f"{path} is no manifest ({error!r}); quantize_model.py writes one beside each network")


def coverage(network, args):
    command = [args.bin / "stillmap-coverage", args.log, "--config", args.camera, "--set", f"detector.model={network}"]
    result = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise RunFailed(f"{result.stderr.strip()} (exit code {result.returncode} of: {' '.join(map(str, command))})")
    return json.loads(result.stdout)


def trajectory(network, mode, args):
    """ATE in m of each seed, and the least coverage."""
    errors, least = [], 1.0
    for seed in range(1, args.seeds + 1):
        report = run_stillmap(args.bin / "stillmap", args.log, [args.camera], args.out / f"{network.stem}-{mode}-{seed}", "--mode", mode,
                              "--set", f"detector.model={network}", "--set", f"runtime.seed={seed}")
        if "accuracy" not in report:
            raise RunFailed(f"{network}, {mode}, seed {seed}: too few poses for an accuracy")
        errors.append(report["accuracy"]["ate_rmse_m"])
        least = min(least, report["accuracy"]["coverage"])
    return {"ate_m": errors, "coverage": least}


def measure(network, args):
    manifest, float_manifest = read_manifest(network), read_manifest(args.float_network)
    size = manifest["input_width"], manifest["input_height"]
    files = pictures_of(args.log)
    blobs = read_blobs(files[::max(1, len(files) // FRAMES)], *size)
    row = {"input": f"{size[0]}x{size[1]}", "opencv_ms": {str(n): time_ms(network.read_bytes(), blobs[0], n, 50) for n in (1, 2)}}
    if network != args.float_network:
        model, other = onnx.load(args.float_network), onnx.load(network)
        row["boxes"] = compare_boxes((model, other), [o.name for o in model.graph.output], blobs, float_manifest.get("score_threshold", 0.25))
    row["coverage"] = coverage(network, args)
    for mode in ("lockstep", "realtime"):
        row[mode] = trajectory(network, mode, args)
    return row


def percent(value):
    return "-" if value is None else f"{100 * value:.1f} %"


def ate(runs):
    text = f"{statistics.median(runs['ate_m']):.4f} / {max(runs['ate_m']):.4f} m"
    return text if runs["coverage"] >= 0.99 else f"{text} on {100 * runs['coverage']:.0f} %"


def cells(network, row):
    boxes, found = row.get("boxes", {}), row["coverage"]
    return (network.stem, row["input"], " / ".join(f"{row['opencv_ms'][n]:.1f}" for n in ("1", "2")) + " ms", f"{found['cpu_ms_median']:.1f} ms",
            percent(boxes.get("of_float_in_int8")), percent(boxes.get("of_int8_in_float")), percent(found["covered_by_boxes"]),
            percent(found["covered_by_carried"]), percent(found["covered_by_mask"]), percent(found["background_in_mask"]),
            ate(row["lockstep"]), ate(row["realtime"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="+", type=Path, metavar="NETWORK.onnx")
    parser.add_argument("--float", type=Path, required=True, dest="float_network", metavar="FLOAT.onnx")
    parser.add_argument("--log", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seeds", type=positive, default=3, metavar="N")
    parser.add_argument("--camera", type=Path, metavar="FILE", help="camera profile; by default it goes by the log's name")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/release/bin", help="folder of stillmap and stillmap-coverage")
    parser.add_argument("--out", type=Path, default=ROOT / "evaluate-out/detector")
    args = parser.parse_args()
    for needed in ("groundtruth.txt", "mask"):
        if not (args.log / needed).exists():
            fail(f"{args.log} holds no {needed}; name a log with the people's true pixels")
    args.camera = camera_of(args.log, args.camera)
    cv2.setNumThreads(1)
    networks = [args.float_network, *args.networks]
    try:
        rows = [measure(network, args) for network in networks]
    except RunFailed as error:
        fail(error)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "detector_table.json").write_text(json.dumps(dict(zip((n.stem for n in networks), rows)), indent=2) + "\n", encoding="utf-8")
    for line in (HEAD, ["---"] * len(HEAD), *map(cells, networks, rows)):
        print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
    main()
