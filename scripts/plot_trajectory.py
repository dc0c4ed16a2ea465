#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Draws estimated trajectories over the ground truth, and their error over time.

    plot_trajectory.py GROUNDTRUTH ESTIMATE... --out OUT.png

All files are in TUM format. Each estimate is aligned to the ground truth by the rotation and translation that fit best
(no scale), over poses whose stamps match within 20 ms, as the benchmark does. Needs python3-numpy, python3-matplotlib.
"""
import argparse
import os
import sys

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend has to be chosen first)

from tum_trajectory import BadTrajectory, read_trajectory  # noqa: E402

MAX_STAMP_DIFFERENCE_S = 0.02
LEAST_POSES = 3  # that an alignment needs


def fail(message):
    sys.exit(f"plot_trajectory.py: {message}")


def read(path):
    """Stamps (n,) in s and positions (n, 3) in m."""
    try:
        rows = read_trajectory(path, LEAST_POSES)
    except BadTrajectory as error:
        fail(error)
    return rows[:, 0], rows[:, 1:4]


def match(truth_s, estimate_s):
    """Index pairs of the nearest stamps: (into truth, into estimate)."""
    after = np.clip(np.searchsorted(truth_s, estimate_s), 1, len(truth_s) - 1)
    nearest = after - (estimate_s - truth_s[after - 1] < truth_s[after] - estimate_s)
    close = np.abs(truth_s[nearest] - estimate_s) <= MAX_STAMP_DIFFERENCE_S
    return nearest[close], np.flatnonzero(close)


def alignment(source, target):
    """R, t that minimize |R source + t - target| (Umeyama 1991, without scale)."""
    source_mean, target_mean = source.mean(0), target.mean(0)
    u, _, vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    flip = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ flip @ vt
    return rotation, target_mean - rotation @ source_mean


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("groundtruth")
    parser.add_argument("estimates", nargs="+", metavar="estimate")
    parser.add_argument("--out", required=True, metavar="OUT.png")
    args = parser.parse_args()

    truth_s, truth_m = read(args.groundtruth)
    figure, axes = plt.subplots(1, 3, figsize=(16, 5), constrained_layout=True)
    top, side, error_panel = axes
    spans = []
    for path in args.estimates:
        stamps_s, positions_m = read(path)
        in_truth, in_estimate = match(truth_s, stamps_s)
        if len(in_truth) < LEAST_POSES:
            fail(f"{path} and {args.groundtruth} share no time; are they of the same log?")
        rotation, shift = alignment(positions_m[in_estimate], truth_m[in_truth])
        aligned_m = positions_m @ rotation.T + shift
        error_m = np.linalg.norm(aligned_m[in_estimate] - truth_m[in_truth], axis=1)
        label = f"{os.path.basename(path)}: ATE RMSE {np.sqrt((error_m ** 2).mean()):.4f} m"
        line = top.plot(aligned_m[:, 0], aligned_m[:, 1], lw=1.2, label=label, zorder=2)[0]
        side.plot(aligned_m[:, 0], aligned_m[:, 2], lw=1.2, color=line.get_color(), zorder=2)
        error_panel.plot(stamps_s[in_estimate] - truth_s[0], 100 * error_m, lw=1, color=line.get_color())
        spans.append((stamps_s[0], stamps_s[-1]))
    shown = (truth_s >= min(s[0] for s in spans) - 0.1) & (truth_s <= max(s[1] for s in spans) + 0.1)
    for panel, second, title in ((top, 1, "top"), (side, 2, "side")):
        panel.plot(truth_m[shown, 0], truth_m[shown, second], color="0.3", lw=2.5, alpha=0.6, label="ground truth", zorder=1)
        panel.set(title=title, xlabel="x (m)", ylabel="xyz"[second] + " (m)", aspect="equal")
        panel.set_adjustable("datalim")
        panel.grid(alpha=0.3)
    error_panel.set(title="error after alignment", xlabel="time (s)", ylabel="error (cm)", ylim=(0, None))
    error_panel.grid(alpha=0.3)
    top.legend(fontsize=8, loc="best")
    part = args.out + ".part"
    try:
        figure.savefig(part, dpi=100, format="png")
        os.replace(part, args.out)
    except OSError as error:
        fail(f"cannot write {args.out}: {error.strerror}; name a file in a folder that you may write to")


if __name__ == "__main__":
    main()
