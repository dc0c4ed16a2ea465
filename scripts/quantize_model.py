#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the detector's 8-bit network of published NanoDet-Plus weights.

    quantize_model.py WEIGHTS --log DIR --out NETWORK.onnx [--float FLOAT.onnx] [--report REPORT.json]

WEIGHTS: an ncnn .param file (with the .bin of the same name beside it) or an ONNX file. --log: a log in TUM format, or a
folder of pictures. Ranges and biases are learned from --frames of its colour pictures (or half of what there is), spread evenly; the
report is made of as many others between them. NETWORK.toml, the manifest, is written beside the network, with the score threshold that finds
as much as --threshold does in float. The same input gives the same bytes on one kind of CPU. Needs python3-numpy,
python3-onnx, python3-opencv.
"""
import argparse
import hashlib
import json
import os
import sys
import tomllib
from pathlib import Path

import cv2

from network_compare import compare, input_blob
from network_import import ImportFailed, read_network
from network_quantize import quantize

MANIFEST = Path(__file__).resolve().parent.parent / "firmware-config/models/nanodet_plus_m.toml"


def fail(message):
    sys.exit(f"quantize_model.py: {message}")


def pictures_of(log):
    listed = log / "rgb.txt"
    if listed.is_file():
        lines = (line.split() for line in listed.read_text(encoding="utf-8").splitlines())
        return [log / words[1] for words in lines if len(words) == 2 and words[0] != "#"]
    return sorted(p for p in log.rglob("*") if p.suffix in (".png", ".jpg", ".jpeg"))


def read_blobs(files, width, height):
    blobs = []
    for file in files:
        picture = cv2.imread(str(file))
        if picture is None:
            fail(f"{file} is no picture; name a log whose pictures can be read")
        blobs.append(input_blob(picture, width, height))
    return blobs


def write_whole(path, data):
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(data)
        os.replace(part, path)
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}; name a file in a folder that you may write to")


def manifest_text(network, width, height, threshold):
    """The default network's manifest with this one's size, checksum and threshold; what makes an object sure goes with that."""
    text = MANIFEST.read_text(encoding="utf-8")
    default = tomllib.loads(text)["detector"]
    said = {"sha256": f'"{hashlib.sha256(network).hexdigest()}"', "input_width": width, "input_height": height, "score_threshold": threshold,
            "confirm_score": round(threshold * default["confirm_score"] / default["score_threshold"], 3)}
    return "\n".join(f"{key} = {said[key]}" if (key := line.split(" ")[0]) in said else line for line in text.splitlines()) + "\n"


def write_network(path, network, size, threshold):
    write_whole(path, network)
    write_whole(path.with_suffix(".toml"), manifest_text(network, *size, threshold).encode())


def print_report(report):
    boxes, layers = report["boxes"], report["layers"]
    print(f"boxes on {boxes['frames']} other frames: float {boxes['boxes_float']} over {boxes['threshold_float']}, "
          f"int8 {boxes['boxes_int8']} over {boxes['threshold_int8']}; found again: "
          f"{boxes['of_float_in_int8']} of float's, {boxes['of_int8_in_float']} of int8's; "
          f"score shift mean {boxes['score_shift_mean']}, worst {boxes['score_shift_worst']}")
    worst = sorted(layers, key=layers.get, reverse=True)[:5]
    print("layers, error over signal: median", sorted(layers.values())[len(layers) // 2], "worst", *(f"{name} {layers[name]}" for name in worst))
    for kind, times in report["latency_ms"].items():
        print(f"{kind}: {report['bytes'][kind]} bytes,", ", ".join(f"{ms} ms on {threads} thread(s)" for threads, ms in times.items()))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--log", type=Path, required=True, metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="NETWORK.onnx")
    parser.add_argument("--float", type=Path, dest="float_out", metavar="FLOAT.onnx", help="keep the float network, too, with a manifest")
    parser.add_argument("--report", type=Path, metavar="REPORT.json")
    parser.add_argument("--size", type=int, nargs=2, default=(320, 256), metavar=("WIDTH", "HEIGHT"), help="px of the input")
    parser.add_argument("--frames", type=int, default=16, metavar="N")
    parser.add_argument("--threshold", type=float, default=0.15, help="score of a box in the float network")
    args = parser.parse_args()
    files = pictures_of(args.log)
    frames = min(args.frames, len(files) // 2)
    if frames < 1:
        fail(f"{args.log} holds {len(files)} pictures, expected two or more; name a log in TUM format or a folder of pictures")
    if any(size <= 0 or size % 32 for size in args.size):
        fail(f"--size {args.size[0]} {args.size[1]}: expected multiples of 32")
    cv2.setNumThreads(1)
    spread = [files[i * len(files) // (2 * frames)] for i in range(2 * frames)]
    try:
        float_model = read_network(args.weights)
    except ImportFailed as error:
        fail(f"{error}; give NanoDet-Plus weights, ncnn's .param or ONNX")
    if args.float_out:
        write_network(args.float_out, float_model.SerializeToString(), args.size, args.threshold)
    int8_model, equal_model, parameters = quantize(float_model, read_blobs(spread[::2], *args.size))
    network = int8_model.SerializeToString()
    report = compare(equal_model, int8_model, parameters, read_blobs(spread[1::2], *args.size), args.threshold)
    write_network(args.out, network, args.size, report["boxes"]["threshold_int8"])
    print_report(report)
    if args.report:
        write_whole(args.report, (json.dumps(report, indent=2) + "\n").encode())


if __name__ == "__main__":
    main()
