#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Trajectory errors computed another way, to hold src/eval against.

usage: reference_accuracy.py GROUNDTRUTH ESTIMATE

Written from the definitions (Sturm et al., IROS 2012; Umeyama, PAMI 1991): 4x4 matrices, an SVD for the
alignment, every pair of stamps compared. Prints one line:
ate_rmse_m ate_max_m rpe_1s_rmse_m rpe_1s_rmse_deg rpe_frame_rmse_m matched_poses
"""
import sys

import numpy as np


def read(path):
    poses = []
    with open(path, encoding="utf-8") as lines:
        for line in lines:
            if line.strip() and not line.startswith("#"):
                # The stamp in whole nanoseconds: a double keeps only 0.2 us of today's seconds.
                seconds, _, fraction = line.split()[0].partition(".")
                ns = int(seconds) * 10**9 + int((fraction + "000000000")[:9])
                poses.append((ns, matrix([float(v) for v in line.split()[1:8]])))
    return sorted(poses, key=lambda p: p[0])


def matrix(v):
    x, y, z, w = np.array(v[3:]) / np.linalg.norm(v[3:])
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] = np.eye(3) + 2 * w * K + 2 * K @ K
    T[:3, 3] = v[:3]
    return T


def align(estimate, truth):
    """Umeyama, eqs. 34 to 43, with scale 1."""
    me, mt = estimate.mean(0), truth.mean(0)
    U, _, Vt = np.linalg.svd((truth - mt).T @ (estimate - me))
    S = np.diag([1, 1, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = U @ S @ Vt
    return R, mt - R @ me


def rmse(values):
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def angle_deg(R):
    # By the chord instead of the trace's arc cosine, which is blind below 1e-8.
    return np.degrees(2 * np.arcsin(min(1.0, np.linalg.norm(R - np.eye(3)) / (2 * np.sqrt(2)))))


def main():
    truth, estimate = read(sys.argv[1]), read(sys.argv[2])
    truth_ns = np.array([t for t, _ in truth], dtype=np.int64)
    stamps, P, Q = [], [], []
    for ns, T in estimate:
        gaps = np.abs(truth_ns - ns)
        nearest = int(np.argmin(gaps))
        if gaps[nearest] <= 20_000_000:
            stamps.append(ns)
            P.append(T)
            Q.append(truth[nearest][1])
    stamps = np.array(stamps, dtype=np.int64)
    R, t = align(np.array([T[:3, 3] for T in P]), np.array([T[:3, 3] for T in Q]))
    errors = [np.linalg.norm(R @ p[:3, 3] + t - q[:3, 3]) for p, q in zip(P, Q)]

    def relative(i, j):
        truth_step = np.linalg.inv(Q[i]) @ Q[j]
        return np.linalg.inv(truth_step) @ np.linalg.inv(P[i]) @ P[j]

    second = []
    for i, ns in enumerate(stamps):
        j = int(np.argmin(np.abs(stamps - (ns + 10**9))))
        if j != len(stamps) - 1 and abs(int(stamps[j]) - int(ns) - 10**9) <= 10**8:
            second.append(relative(i, j))
    frame = [relative(i, i + 1) for i in range(len(stamps) - 1)]
    print(" ".join(repr(v) for v in (
        rmse(errors), float(max(errors)),
        rmse([np.linalg.norm(E[:3, 3]) for E in second]), rmse([angle_deg(E[:3, :3]) for E in second]),
        rmse([np.linalg.norm(E[:3, 3]) for E in frame]), len(stamps))))


main()
