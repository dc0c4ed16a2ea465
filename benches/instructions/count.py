#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Counts the instructions of each stage per frame, on processors that need not be there (QEMU's user emulation).

    count.py --source tum:DIR --config FILE [--set KEY=VALUE ...] [--duration S] x86_64|aarch64|a76|armhf ...

For each processor the program of its build (build/release, build/aarch64, build/armhf) replays the log in lockstep. Counts
are of what is executed and do not depend on how busy this machine is. The first frame, which finds an empty map, is counted
too.
"""
import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = HERE.parents[1] / "build"
# "max" has AVX2, which the runtime and OpenCV take where a processor has it.
PROCESSORS = {"x86_64": ("release", ["qemu-x86_64", "-cpu", "max"]),
              "aarch64": ("aarch64", ["qemu-aarch64", "-cpu", "cortex-a72", "-L", BUILD / "sysroot/aarch64"]),
              # As the Raspberry Pi 5 has it, with dot products.
              "a76": ("aarch64", ["qemu-aarch64", "-cpu", "cortex-a76", "-L", BUILD / "sysroot/aarch64"]),
              "armhf": ("armhf", ["qemu-arm", "-L", BUILD / "sysroot/armhf"])}
# What lockstep calls in turn; each counts until the next is called.
STAGES = {"stillmap::Capture::next(": "decode", "stillmap::detect_frame(": "detect", "stillmap::track_frame(": "track",
          "stillmap::adjust_map(": "adjust", "stillmap::MapStage::take_frame(": "map", "stillmap::MapStage::take_detected(": "map",
          "stillmap::answer_map_requests(": "rest", "stillmap::Health::tick(": "rest"}


def symbols(program):
    """NAME=SYMBOL of each stage's function in the program."""
    found = []
    mangled = subprocess.run(["nm", "--defined-only", program], check=True, capture_output=True, text=True).stdout
    for symbol in re.findall(r" T (\S+)$", mangled, re.M):
        plain = subprocess.run(["c++filt", symbol], check=True, capture_output=True, text=True).stdout if "stillmap" in symbol else ""
        found += [f"{name}={symbol}" for start, name in STAGES.items() if plain.startswith(start)]
    if len(found) != len(STAGES):
        sys.exit(f"count.py: {program} has {len(found)} of {len(STAGES)} stages; is it stripped?")
    return found


def count(processor, plugin, arguments):
    """Frames, millions of instructions per frame by stage, and millions before the first frame."""
    build, emulator = PROCESSORS[processor]
    program = BUILD / build / "bin/stillmap"
    result = subprocess.run([*emulator, "-plugin", ",".join([str(plugin), *symbols(program)]), program, "run", "--mode", "lockstep", "--listen", "off",
                             *arguments], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        sys.exit(f"count.py: {processor}: {result.stderr}")
    totals = {}
    for name, calls, instructions in re.findall(r"^stage (\w+) (\d+) (\d+)$", result.stderr, re.M):
        before = totals.get(name, (0, 0))
        totals[name] = (before[0] + int(calls), before[1] + int(instructions))
    frames = totals["track"][0]
    return frames, {name: total / frames / 1e6 for name, (_, total) in totals.items() if name != "other"}, totals["other"][1] / 1e6


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("processors", nargs="+", choices=PROCESSORS)
    parser.add_argument("--source", required=True)
    parser.add_argument("--config", action="append", default=[])
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--duration", default="0")
    options = parser.parse_args()
    arguments = ["--source", options.source, "--duration", options.duration]
    for name in ("config", "set"):
        arguments += [a for value in getattr(options, name) for a in ("--" + name, value)]
    with tempfile.TemporaryDirectory() as folder:
        plugin = Path(folder) / "libstage_counter.so"
        subprocess.run(["cc", "-std=c11", "-O2", "-shared", "-fPIC", "-o", plugin, HERE / "stage_counter.c"], check=True)
        print("| processor | frames | decode | detect | track | adjust | map | rest | start |\n|---|---|---|---|---|---|---|---|---|")
        for processor in options.processors:
            frames, stages, start = count(processor, plugin, arguments)
            cells = " | ".join(f"{stages.get(n, 0):.2f}" for n in ("decode", "detect", "track", "adjust", "map", "rest"))
            print(f"| {processor} | {frames} | {cells} | {start:.0f} |", flush=True)


if __name__ == "__main__":
    main()
