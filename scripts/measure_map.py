#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Ghosts in the map: a log with people against the same log without them.

    measure_map.py --walkers DIR --empty DIR [--model FILE] [--rules silhouette,paper,off] [--poses own,true]

Both logs are in TUM format with the same stamps and ground truth; DIR/mask/<colour stamp>.png of the first marks the
people (0: background). The empty log is mapped with true poses and nothing rejected: that is the truth. Mapped again
without the pixels that people hide in the other log, themselves or by the shadow beside them that its depth has no
reading in, it is the truth in view. Then the log with people is mapped under
each rule, with true poses and with the tracker's own (the map is brought into the truth's frame by the SE(3) alignment
of the trajectory).

  ghost      an occupied voxel within one voxel of a person's pixel (true pose, true mask) and over two voxels from
             every voxel of the truth; litres are its volume, share is of all occupied voxels
  recall     share of the voxels of the truth in view with an occupied voxel within 5 cm; F: of that and of the
             precision (the share of occupied voxels with a voxel of the truth within 5 cm)

Needs python3-numpy, python3-opencv and python3-scipy, the shared logs, and stillmap-map-replay, which the tests' build makes.
"""
import argparse
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from render_map import read_ply
from stillmap_runs import ROOT, RunFailed, print_table, run_stillmap
from tum_trajectory import BadTrajectory, read_trajectory

REACH_M = 0.05  # of recall and F-score
HEAD = ("poses", "rule", "voxels", "ghosts", "litres", "share %", "recall %", "precision %", "F %", "reduction")


def read_poses(path):
    """Stamps (n), rotations (n, 3, 3) and positions (n, 3) of a trajectory in TUM format."""
    rows = read_trajectory(path)
    x, y, z, w = rows[:, 4:8].T
    rotations = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                          2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                          2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1).reshape(-1, 3, 3)
    return rows[:, 0], rotations, rows[:, 1:4]


def nearest_pose(poses, stamp):
    i = np.abs(poses[0] - stamp).argmin()
    return poses[1][i], poses[2][i], abs(poses[0][i] - stamp)


def alignment(estimate, truth):
    """R, t that take the estimate's poses to the truth's, from whole poses: a camera that only turns has no path to fit."""
    turns, pairs = np.zeros((3, 3)), []
    for stamp, rotation, position in zip(*estimate):
        true_rotation, true_position, gap = nearest_pose(truth, stamp)
        if gap <= 0.02:
            turns += true_rotation @ rotation.T
            pairs.append((position, true_position))
    u, _, vt = np.linalg.svd(turns)
    rotation = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rotation, np.mean([true - rotation @ own for own, true in pairs], axis=0)


def rays_of(camera):
    u, v = np.meshgrid(np.arange(camera["width"], dtype=np.float64), np.arange(camera["height"], dtype=np.float64))
    matrix = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    lens = np.array([camera.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")])
    flat = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2), matrix, lens).reshape(-1, 2)
    return np.concatenate([flat, np.ones((len(flat), 1))], 1).reshape(*u.shape, 3)


def people(log, camera, truth, edge_m):
    """The centres of the cells that a person's pixel falls into, through true poses and true masks."""
    rays, parts = rays_of(camera), []
    for colour_stamp, _, depth_stamp, depth_file in associations(log):
        mask = cv2.imread(str(log / "mask" / f"{colour_stamp}.png"), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(log / depth_file), cv2.IMREAD_UNCHANGED) / camera["depth_units_per_m"]
        rotation, position, _ = nearest_pose(truth, float(depth_stamp))
        points = (rays * depth[..., None])[(mask > 0) & (depth > 0)] @ rotation.T + position
        parts.append(np.unique(np.floor(points / edge_m).astype(int), axis=0))
    return (np.unique(np.concatenate(parts), axis=0) + 0.5) * edge_m


def near(points, others, reach_m):
    """Whether one of the `others` (a tree) lies within the reach of each point."""
    return others.query(points, distance_upper_bound=reach_m + 1e-6)[0] <= reach_m + 1e-6


def measure(points, walkers, truth, in_view, edge_m):
    # From a voxel's centre to anything in a neighbour that shares a face are at most 1.5 edges.
    ghost = near(points, walkers, 1.5 * edge_m) & ~near(points, truth, 2 * edge_m)
    precision = near(points, truth, REACH_M).mean()
    recall = near(in_view.data, cKDTree(points), REACH_M).mean()
    f = 2 * precision * recall / (precision + recall)
    litres = ghost.sum() * edge_m**3 * 1000
    return [len(points), ghost.sum(), f"{litres:.2f}", f"{100 * ghost.mean():.3f}", f"{100 * recall:.2f}", f"{100 * precision:.2f}", f"{100 * f:.2f}"]


def associations(log):
    """Colour stamp and file, depth stamp and file of each frame."""
    return [line.split() for line in (log / "associations.txt").read_text(encoding="utf-8").splitlines() if not line.startswith("#")]


def hide_people(empty, walkers, out):
    """The empty log without the pixels that people, or the shadows of their depth, hide in the other one."""
    (out / "depth").mkdir(parents=True, exist_ok=True)
    (out / "associations.txt").write_text((empty / "associations.txt").read_text(encoding="utf-8"), encoding="utf-8")
    (out / "rgb").unlink(missing_ok=True)
    (out / "rgb").symlink_to((empty / "rgb").resolve())
    with_people = {stamp: file for stamp, _, _, file in associations(walkers)}
    for stamp, _, _, file in associations(empty):
        depth = cv2.imread(str(empty / file), cv2.IMREAD_UNCHANGED)
        depth[cv2.imread(str(walkers / "mask" / f"{stamp}.png"), cv2.IMREAD_UNCHANGED) > 0] = 0
        depth[cv2.imread(str(walkers / with_people[stamp]), cv2.IMREAD_UNCHANGED) == 0] = 0
        cv2.imwrite(str(out / file), depth)
    return out


def replay(args, log, out, *settings):
    result = subprocess.run([args.bin / "stillmap-map-replay", args.camera, log, args.empty / "groundtruth.txt", out, *settings],
                            capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise RunFailed(result.stderr.strip())
    return float(result.stdout.split("point reduction ")[1].split(",")[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walkers", type=Path, required=True, metavar="DIR")
    parser.add_argument("--empty", type=Path, required=True, metavar="DIR")
    parser.add_argument("--camera", type=Path, default=ROOT / "firmware-config/cameras/tum-fr1.toml", metavar="FILE")
    parser.add_argument("--model", default="auto", help="ONNX file")
    parser.add_argument("--rules", default="silhouette,paper,off")
    parser.add_argument("--poses", default="true,own")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="further settings of every run")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/release/bin", help="folder of the programs")
    parser.add_argument("--out", type=Path, default=ROOT / "build/measure-map")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    camera = tomllib.loads(args.camera.read_text(encoding="utf-8"))["camera"]
    edge_m = next((float(s.split("=")[1]) for s in args.set if s.startswith("map.voxel_m=")), 0.04)

    hidden = hide_people(args.empty, args.walkers, args.out / "hidden")
    maps = [args.out / "truth.ply", args.out / "in-view.ply"]
    for log, out in zip((args.empty, hidden), maps):
        replay(args, log, out, *args.set, "detector.model=none", "track.dynamic_rule=off")
    truth, in_view = (cKDTree(read_ply(path)[0]) for path in maps)
    poses = read_poses(args.walkers / "groundtruth.txt")
    walkers = cKDTree(people(args.walkers, camera, poses, edge_m / 2))
    rows = []
    for kind in args.poses.split(","):
        for rule in args.rules.split(","):
            settings = [*args.set, f"detector.model={args.model}", f"track.dynamic_rule={rule}"]
            out = args.out / f"{kind}-{rule}"
            out.mkdir(exist_ok=True)
            if kind == "true":
                reduction = replay(args, args.walkers, out / "map.ply", *settings)
                points = read_ply(out / "map.ply")[0]
            else:
                report = run_stillmap(args.bin / "stillmap", args.walkers, [args.camera], out, "--mode", "lockstep",
                                      *[word for s in settings for word in ("--set", s)])
                reduction = report["map"]["point_reduction"]
                rotation, position = alignment(read_poses(out / "trajectory.txt"), poses)
                points = read_ply(out / "map.ply")[0] @ rotation.T + position
            rows.append([kind, rule, *measure(points, walkers, truth, in_view, edge_m), f"{reduction:.1f}"])
    print(f"truth: {truth.n} voxels of {100 * edge_m:g} cm, {in_view.n} in view")
    print_table(rows, HEAD)


if __name__ == "__main__":
    try:
        main()
    except (RunFailed, BadTrajectory) as error:
        sys.exit(f"measure_map.py: {error}")
