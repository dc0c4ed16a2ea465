#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the promises of the runtime on exactly two cores, with a client on the stream; prints a table.

    bench.py [--log DIR] [--camera FILE] [--model FILE] [--seconds 60] [--runs 5]

Without a log, one is rendered, and the demo's network looks at it. A log is played forwards and backwards in turn for
--seconds, in realtime; ground truth beside it gives the accuracy. Close other programs first: what the table says of a
busy machine is the busy machine's.
"""
import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from stillmap_runs import ROOT, RunFailed, print_table, read_report
from stream_client import StreamClient

SPIN = "while True: pass"


class Bench:
    def __init__(self, args, log, camera, model, cores):
        self.args, self.log, self.camera, self.model, self.cores = args, log, camera, model, cores
        self.frames = sum(1 for line in (log / "rgb.txt").read_text().splitlines() if line and not line.startswith("#"))
        self.rows, self.notes = [], []

    def loops_for(self, seconds):
        return max(1, round(seconds * 30 / self.frames))

    def start(self, name, *arguments, listen="off"):
        out = self.args.out / name
        out.mkdir(parents=True, exist_ok=True)
        command = ["taskset", "-c", ",".join(map(str, self.cores)), self.args.bin / "stillmap", "run", "--source", f"tum:{self.log}",
                   "--config", self.camera, "--config", ROOT / "firmware-config/boards/two-core.toml", *self.model, "--listen", listen,
                   "--report", out / "report.json", *arguments]
        if (self.log / "groundtruth.txt").is_file():
            command += ["--groundtruth", self.log / "groundtruth.txt"]
        return subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True), out

    def finish(self, process, out):
        _, words = process.communicate()
        (out / "log.txt").write_text(words)
        if process.returncode != 0:
            raise RunFailed(f"{words.strip().splitlines()[-1]} (exit code {process.returncode})")
        return read_report(out / "report.json"), words

    def run(self, name, *arguments):
        return self.finish(*self.start(name, *arguments))[0]

    def row(self, what, value, bound, good):
        self.rows.append((what, value, bound, "yes" if good else "no"))

    def watched(self):
        """The long run: realtime with a client, resident memory sampled each second."""
        process, out = self.start("realtime", "--mode", "realtime", "--loop", self.loops_for(self.args.seconds), listen="127.0.0.1:0")
        client, url, samples, words = None, None, [], []
        while (line := process.stderr.readline()):
            words.append(line)
            if match := re.search(r"http://(127\.0\.0\.1):(\d+)", line):
                url = match[0]
                client = StreamClient(match[1], int(match[2]))
                client.start()
            if "tracking_started" in line:
                break
        begin, dropped_early = time.monotonic(), 0
        while process.poll() is None:
            time.sleep(1)
            samples.append((time.monotonic() - begin, rss_kb(process.pid)))
            if len(samples) == 2:  # /metrics is new once a second: this is the first second's count
                dropped_early = dropped_now(url)
        report, rest = self.finish(process, out)
        (out / "log.txt").write_text("".join(words) + rest)
        return report, dropped_early, [s for s in samples if s[1]], client

    def judge_realtime(self):
        r, dropped_early, samples, client = self.watched()
        offered, dropped = r["frames"]["offered"], sum(r["frames"]["dropped"].values())
        late = max(0, dropped - dropped_early)
        self.row("frames offered", f"{offered} in {r['wall_s']:.0f} s", "30 a second", offered / r["wall_s"] > 29)
        self.row("dropped after the first second", late, "0", late == 0)
        pose = r["latency_ms"]["capture_to_pose"]
        missed = late / offered
        self.row("capture to pose, p50", f"{pose['p50']:.1f} ms", "15 ms", pose["p50"] < 15)
        self.row("capture to pose, p99", "dropped" if missed > 0.01 else f"{pose['p99']:.1f} ms", "33 ms", missed <= 0.01 and pose["p99"] < 33)
        rate = r["detector"]["runs"] / r["wall_s"]
        self.row("detector", f"{rate:.1f} Hz, {r['detector']['latency_ms']['p50']:.0f} ms", "10 Hz", rate >= 10)
        cpu_ms = 1000 * (r["cpu_s"] - r["cpu_decode_s"]) / max(1, r["frames"]["processed"])
        self.row("CPU a frame, decoding apart", f"{cpu_ms:.1f} ms", "30 ms", cpu_ms < 30)
        heap = r["memory"]["heap_allocations_after_start"]
        taken = sum(heap[stage] for stage in ("capture", "track", "map"))
        self.row("heap allocations after the first pose", taken, "0", taken == 0)
        self.row("the same in the stream, for two connections", heap["stream"], "20", heap["stream"] <= 20)
        settled = [kb for at, kb in samples if at >= min(60, self.args.seconds / 2)]
        growth_kb = settled[-1] - settled[0] if settled else 0
        self.row(f"resident memory, growth over the last {len(settled)} s", f"{growth_kb} KB", "1000 KB", growth_kb < 1000)
        self.row("resident memory, peak", f"{r['memory']['rss_peak_kb'] / 1000:.1f} MB", "96 MB", r["memory"]["rss_peak_kb"] < 96_000)
        first = r["start_to_first_pose_ms"]
        self.row("start to first pose", f"{first} ms", "300 ms", first is not None and first < 300)
        self.row("stream client", f"{client.bytes / 1e6:.1f} MB, {r['stream']['messages_dropped']} messages missed", "attached", client.messages > 0)
        self.row("quality given up", f"{r['shedding']['steps']} steps", "0", r["shedding"]["steps"] == 0)

    def judge_accuracy(self):
        if not (self.log / "groundtruth.txt").is_file():
            return
        errors = {}
        for mode in ("lockstep", "realtime"):
            reports = [self.run(f"{mode}-{seed}", "--mode", mode, "--set", f"runtime.seed={seed}") for seed in range(1, self.args.runs + 1)]
            errors[mode] = [r["accuracy"]["ate_rmse_m"] for r in reports]
            coverage = min(r["accuracy"]["coverage"] for r in reports)
            self.row(f"ATE in {mode}, median / worst of {self.args.runs}",
                     f"{statistics.median(errors[mode]):.4f} / {max(errors[mode]):.4f} m", f"coverage {coverage:.3f}", coverage >= 0.99)
        for name, of in (("median", statistics.median), ("worst", max)):
            ratio = of(errors["realtime"]) / of(errors["lockstep"])
            self.row(f"ATE, realtime over lockstep, {name}", f"{ratio:.2f}", "1.3", ratio <= 1.3)

    def judge_busy(self):
        """A second busy process on one core for the middle third; each core in turn."""
        third = max(8, self.args.seconds / 6)
        for core, whose in zip(self.cores, ("tracking", "detector and map")):
            process, out = self.start(f"busy-{core}", "--mode", "realtime", "--loop", self.loops_for(3 * third))
            time.sleep(third)
            spin = subprocess.Popen(["taskset", "-c", str(core), sys.executable, "-c", SPIN])
            time.sleep(third)
            spin.kill()
            spin.wait()
            r, words = self.finish(process, out)
            steps = re.findall(r"quality_(lowered|raised) at frame \d+: to (.*), since", words)
            given_up = [name for kind, name in steps if kind == "lowered"]
            recovered = not steps or steps[-1][1] == "full quality"
            dropped = sum(r["frames"]["dropped"].values())
            self.row(f"busy core of {whose}", f"{dropped} of {r['frames']['offered']} dropped, {len(given_up)} steps given up", "recovers", recovered)
            self.notes += [f"busy core of {whose}: {kind} to: {name}" for kind, name in steps]

    def judge_fast(self):
        fps = self.run("fast", "--mode", "fast", "--loop", self.loops_for(20))["throughput_fps"]
        self.row("throughput in fast mode", f"{fps:.1f} frames/s", "60", fps >= 60)


def rss_kb(pid):
    try:
        return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())[1])
    except (OSError, TypeError):
        return 0


def dropped_now(url):
    with urllib.request.urlopen(url + "/metrics", timeout=5) as answer:
        return sum(int(n) for n in re.findall(r"^stillmap_frames_dropped_total\S* (\d+)$", answer.read().decode(), re.M))


def add_source_arguments(parser):
    parser.add_argument("--log", type=Path, metavar="DIR", help="in TUM format")
    parser.add_argument("--camera", type=Path, metavar="FILE", default=ROOT / "firmware-config/cameras/tum-fr1.toml", help="the log's camera")
    parser.add_argument("--model", metavar="FILE", help="ONNX network; default: the installed one")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/release/bin")


def source_of(args, way=("--people", "6", "--frames", "180")):
    """(log, camera profile, options of the network); a log, the `way` of stillmap-synth, and a network are made where no
    log is given."""
    if args.log:
        return args.log.resolve(), args.camera, ["--set", f"detector.model={args.model}"] if args.model else []
    log, model = args.out / "log", args.out / "demo.onnx"
    shutil.rmtree(log, ignore_errors=True)
    subprocess.run([args.bin / "stillmap-synth", "--out", log, "--seed", "3", *way], check=True)
    subprocess.run([ROOT / "scripts/make_demo_model.py", model], check=True)
    return log, ROOT / "firmware-config/cameras/synthetic.toml", ["--config", ROOT / "firmware-config/demo.toml", "--set", f"detector.model={model}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    add_source_arguments(parser)
    parser.add_argument("--seconds", type=float, default=60, help="of the long run")
    parser.add_argument("--runs", type=int, default=5, help="for the accuracy")
    parser.add_argument("--out", type=Path, default=ROOT / "build/bench")
    parser.add_argument("--only-parse", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only_parse:
        return
    cores = sorted(os.sched_getaffinity(0))[:2]
    if len(cores) < 2:
        sys.exit("bench.py: this process may use one core only; it measures on two")
    args.out.mkdir(parents=True, exist_ok=True)
    log, camera, model = source_of(args)
    bench = Bench(args, log, camera, model, cores)
    load = os.getloadavg()[0]
    try:
        bench.judge_realtime()
        bench.judge_fast()
        bench.judge_busy()
        bench.judge_accuracy()
    except (RunFailed, OSError) as error:
        sys.exit(f"bench.py: {error}")
    print_table(bench.rows, ("measure", "value", "bound", "met"))
    print("\n".join(bench.notes), end="\n" if bench.notes else "")
    (args.out / "table.json").write_text(json.dumps(bench.rows, indent=1))
    print(f"cores {cores[0]} and {cores[1]}; load average of the machine before: {load:.1f}")


if __name__ == "__main__":
    main()
