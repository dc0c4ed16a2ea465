#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Runs for minutes or hours and judges that nothing grows, nothing drifts and nothing is lost beyond policy; prints a table.

    soak.py [--minutes 60] [--log DIR] [--camera FILE] [--model FILE] [--small]

Without a log, one is rendered, and the demo's network looks at it. The log is played forwards and backwards in turn in
realtime, while clients of the stream come and go, and /metrics is read every few seconds. A machine that is busy with
something else drops frames, which the table then says. With --small the map and the tracker hold a part of the way only, a
lap around a rendered room where no log is given, so that blocks, points and keyframes are evicted all the time.
"""
import argparse
import re
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from bench import add_source_arguments, source_of
from stillmap_runs import ROOT, RunFailed, print_table, read_report
from stream_client import StreamClient

SAMPLE_S, CLIENT_S = 5, 20
SMALL = ["map.capacity_voxels=102400", "track.keyframes=12", "track.points=2000"]
A_LAP = ["--people", "2", "--path", "walk", "--frames", "640"]
NOT_LATE = {"tracker_behind", "driver_dropped"}  # what a live source may lose where the machine is short of time


def read_metrics(url):
    with urllib.request.urlopen(url, timeout=20) as answer:
        return {name: float(value) for name, value in re.findall(r"^(\w+(?:\{.*\})?) (\S+)$", answer.read().decode(), re.M)}


def watch(process, log, minutes):
    """[(seconds since tracking began, the metrics)]"""
    while "tracking_started" not in (said := log.read_text()):
        if process.poll() is not None:
            raise RunFailed(said.strip().splitlines()[-1] if said else "the program said nothing")
        time.sleep(0.1)
    match = re.search(r"http://(127\.0\.0\.1):(\d+)", said)
    url, address = match[0] + "/metrics", (match[1], int(match[2]))
    begin, samples, client, clients = time.monotonic(), [], None, 0
    while (at := time.monotonic() - begin) < 60 * minutes and process.poll() is None:
        if client is None or at > CLIENT_S * clients:
            if client is not None:
                client.socket.close()
            client = StreamClient(*address)
            client.start()
            clients += 1
        time.sleep(SAMPLE_S)
        samples.append((time.monotonic() - begin, read_metrics(url)))
    return samples, clients


def frames_a_second(log):
    """As the log's own stamps have it."""
    lines = (log / "rgb.txt").read_text(encoding="utf-8").splitlines()
    stamps = [float(line.split()[0]) for line in lines if line and not line.startswith("#")]
    return (len(stamps) - 1) / (stamps[-1] - stamps[0])


def judge_evictions(report):
    """Rows as judge() has them: more came than there is room for."""
    pools, blocks = report["memory"]["pools"], report["map"]["blocks_evicted"]
    keyframes, points = pools["keyframes"]["refused"], pools["points"]
    return [("blocks evicted", blocks, "> 0", "yes" if blocks > 0 else "no"),
            ("keyframes evicted", keyframes, "> 0", "yes" if keyframes > 0 else "no"),
            ("points at most", points["high_water"], points["capacity"], "yes" if points["high_water"] == points["capacity"] else "no")]


def judge(samples, report, clients, due):
    """Rows of what, value, bound, whether it is good."""
    rows = []

    def row(what, value, bound, good):
        rows.append((what, value, bound, "yes" if good else "no"))

    (first_s, first), (last_s, last) = samples[0], samples[-1]
    frames = report["frames"]
    dropped = sum(frames["dropped"].values())
    row("watched", f"{last_s / 60:.1f} min, {len(samples)} samples, {clients} clients", "-", True)
    row("offered less processed less dropped", frames["offered"] - frames["processed"] - dropped, "0", frames["offered"] == frames["processed"] + dropped)
    row("dropped", f"{dropped} of {frames['offered']}", "0.5 %", dropped <= 0.005 * frames["offered"])
    other = {reason: n for reason, n in frames["dropped"].items() if n and reason not in NOT_LATE}
    row("dropped for other reasons than time", sum(other.values()), "0", not other)
    rate = (last["stillmap_frames_offered_total"] - first["stillmap_frames_offered_total"]) / (last_s - first_s)
    late = 2 * due / (last_s - first_s)  # what the first and the last sample may be late, a second each
    row("frames offered a second", f"{rate:.3f}", f"{due:.3f} +- {0.1 + late:.3f}", abs(rate - due) < 0.1 + late)
    fallen = {name for (_, a), (_, b) in zip(samples, samples[1:]) for name in a if "_total" in name and b.get(name, -1) < a[name]}
    row("counters that fell or went", len(fallen), "0", not fallen)
    settled = [m["stillmap_resident_bytes"] for at, m in samples if at >= min(60, last_s / 2)]
    growth = (settled[-1] - settled[0]) / 1e6
    row("resident memory, growth after the first minute", f"{growth:.2f} MB of {settled[-1] / 1e6:.1f}", "1 MB", growth < 1)
    heap = report["memory"]["heap_allocations_after_start"]
    taken = sum(heap[stage] for stage in ("capture", "track", "map"))
    row("heap allocations in capture, track, map", taken, "0", taken == 0)
    full = [name for name, pool in report["memory"]["pools"].items() if pool["high_water"] > pool["capacity"]]
    row("pools beyond their capacity", len(full), "0", not full)
    row("quality given up", f"{report['shedding']['steps']} steps", "-", True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    add_source_arguments(parser)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--small", action="store_true", help="hold a part of the way only")
    parser.add_argument("--out", type=Path, default=ROOT / "build/soak")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    try:
        log, camera, options = source_of(args, A_LAP) if args.small else source_of(args)
        for setting in SMALL if args.small else []:
            options += ["--set", setting]
        report = args.out / "report.json"
        command = [args.bin / "stillmap", "run", "--source", f"tum:{log}", "--mode", "realtime", "--loop", "100000", "--config", camera,
                   "--config", ROOT / "firmware-config/boards/two-core.toml", *options, "--listen", "127.0.0.1:0", "--report", report]
        words = args.out / "log.txt"
        with open(words, "w") as file:
            process = subprocess.Popen([str(word) for word in command], stderr=file)
        try:
            samples, clients = watch(process, words, args.minutes)
        finally:
            process.terminate()
            process.wait()
        if process.returncode != 0:
            raise RunFailed(f"exit code {process.returncode}, see {words}")
        if len(samples) < 2:
            raise RunFailed(f"--minutes {args.minutes} is too short: expected two samples or more, one in {SAMPLE_S} s")
        rows = judge(samples, read_report(report), clients, frames_a_second(log))
        if args.small:
            rows += judge_evictions(read_report(report))
    except (RunFailed, OSError) as error:
        print(f"soak.py: {error}", file=sys.stderr)
        return 1
    print_table(rows, ("what", "value", "bound", "good"))
    bad = sum(row[3] == "no" for row in rows)
    print(f"{len(rows) - bad} passed, {bad} failed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
