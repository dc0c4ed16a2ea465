#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Prints reports of `stillmap run --report` side by side.

    report_table.py NAME=REPORT.json ...
"""
import sys

from stillmap_runs import RunFailed, print_table, read_report

NONE = "-"


def row(name, report):
    frames, accuracy, memory = report["frames"], report.get("accuracy"), report["memory"]
    return (name, report["mode"], f"{report['throughput_fps']:.1f}", f"{sum(frames['dropped'].values())} of {frames['offered']}",
            f"{1000 * report['cpu_s'] / max(1, frames['processed']):.0f} ms", f"{accuracy['ate_rmse_m']:.4f} m" if accuracy else NONE,
            report["map"]["voxels"], f"{memory['planned_bytes'] / 1e6:.0f} MB", f"{memory['rss_peak_kb'] / 1e3:.0f} MB")


def main():
    pairs = [word.split("=", 1) for word in sys.argv[1:]]
    if not pairs or any(len(pair) != 2 for pair in pairs):
        sys.exit("usage: report_table.py NAME=REPORT.json ...")
    try:
        rows = [row(name, read_report(path)) for name, path in pairs]
    except (RunFailed, KeyError) as error:
        sys.exit(f"report_table.py: {error!r}" if isinstance(error, KeyError) else f"report_table.py: {error}")
    print_table(rows, ("run", "mode", "frames/s", "dropped", "CPU a frame", "ATE (RMSE)", "voxels", "planned", "peak RSS"))


if __name__ == "__main__":
    main()
