#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Draws a map (binary PLY with xyz and rgb) from above and at an angle, side by side.

    render_map.py MAP.ply OUT.png [--trajectory FILE] [--up x|y|z|-y] [--size 900]

`--up` is the axis of the map that points to the sky; the default -y is that of a map in its first camera's axes. With a
trajectory (TUM format, in the map's frame), its way is drawn, and what is well above it (a ceiling) is left out.
Needs python3-numpy and python3-opencv.
"""
import argparse
import sys

import cv2
import numpy as np

from tum_trajectory import BadTrajectory, read_trajectory

BACKGROUND_BGR = (24, 20, 18)
TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
         "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
# To right, depth-of-the-room, up, for each choice of the axis that points up.
AXES = {"z": np.eye(3), "-y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
        "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])}
CEILING_M = 0.4  # above the highest camera


def fail(message):
    sys.exit(f"render_map.py: {message}")


def read_ply(path):
    """Points (n, 3) in m and colours (n, 3) as b, g, r."""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror}; name a map that a run wrote with --map")
    head, end, body = data.partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    if not end or lines[0] != ["ply"] or ["format", "binary_little_endian", "1.0"] not in lines:
        fail(f"{path} is no binary little-endian PLY file; name a map that a run wrote with --map")
    count, fields = 0, []
    for words in lines:
        if words[:1] == ["element"]:
            if words[1] != "vertex":
                break
            count = int(words[2])
        elif words[:1] == ["property"]:
            if words[1] not in TYPES:
                fail(f"{path}: property type {words[1]} is not understood; vertices must hold plain numbers")
            fields.append((words[2], "<" + TYPES[words[1]]))
    missing = {"x", "y", "z", "red", "green", "blue"} - {name for name, _ in fields}
    if missing:
        fail(f"{path} has no {', '.join(sorted(missing))}; the map needs xyz and rgb")
    layout = np.dtype(fields)
    if count == 0 or len(body) < count * layout.itemsize:
        fail(f"{path} holds {len(body) // layout.itemsize} of the {count} points it names; was the run cut off?")
    points = np.frombuffer(body, layout, count)
    xyz = np.stack([points[n] for n in "xyz"], 1).astype(np.float64)
    bgr = np.stack([points[n] for n in ("blue", "green", "red")], 1).astype(np.float64)
    finite = np.isfinite(xyz).all(1)
    return xyz[finite], bgr[finite]


def spacing(xyz):
    """The usual distance to the next point: a voxel's edge."""
    some = xyz[np.linspace(0, len(xyz) - 1, min(len(xyz), 200)).astype(int)]
    nearest = []
    for p in some:
        distance_sq = ((xyz - p) ** 2).sum(1)
        distance_sq[distance_sq < 1e-12] = np.inf
        nearest.append(distance_sq.min())
    edge = float(np.sqrt(np.median(nearest)))
    return edge if np.isfinite(edge) and edge > 0 else 0.05


def draw(xyz, bgr, trajectory, size, voxel_m):
    """A parallel projection along the third axis, whose larger values are nearer to the eye."""
    # A few stray points must not make the rest small.
    low, high = np.percentile(xyz[:, :2], [0.5, 99.5], axis=0)
    if trajectory is not None:
        low, high = np.minimum(low, trajectory[:, :2].min(0)), np.maximum(high, trajectory[:, :2].max(0))
    px_per_m = 0.92 * size / max((high - low).max(), 4 * voxel_m)
    middle = (low + high) / 2

    def to_px(points):
        flat = (points[:, :2] - middle) * px_per_m
        return np.stack([size / 2 + flat[:, 0], size / 2 - flat[:, 1]], 1)

    # Each point is a square of a voxel's size. Painted from far to near, so that the nearer one stays.
    width = max(1, int(np.ceil(voxel_m * px_per_m * 1.1)))
    order = np.argsort(xyz[:, 2], kind="stable")
    corner = np.floor(to_px(xyz[order]) - (width - 1) / 2).astype(int)
    picture = np.full((size, size, 3), BACKGROUND_BGR, np.float64)
    height = np.full((size, size), -np.inf)
    offsets = np.stack(np.meshgrid(np.arange(width), np.arange(width)), -1).reshape(-1, 2)
    px = (corner[:, None, :] + offsets[None]).reshape(-1, 2)
    index = np.repeat(order, len(offsets))
    inside = ((px >= 0) & (px < size)).all(1)
    px, index = px[inside], index[inside]
    picture[px[:, 1], px[:, 0]] = bgr[index]
    height[px[:, 1], px[:, 0]] = xyz[index, 2]

    # What lies lower than its surroundings is darker, which makes the shapes readable.
    filled = np.where(np.isfinite(height), height, np.nanmin(np.where(np.isfinite(height), height, np.nan)))
    around = cv2.GaussianBlur(filled, (0, 0), max(2.0, width * 1.5))
    shade = np.clip(1 + 0.6 * (filled - around) / (0.3 + np.abs(filled - around)), 0.45, 1.25)
    picture = np.where(np.isfinite(height)[..., None], picture * shade[..., None], picture)
    picture = np.clip(picture, 0, 255).astype(np.uint8)
    if trajectory is not None:
        way = np.round(to_px(trajectory) * 16).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [way], False, (20, 20, 20), 5, cv2.LINE_AA, 4)
        cv2.polylines(picture, [way], False, (60, 200, 255), 2, cv2.LINE_AA, 4)
        for at, colour in ((way[0, 0], (80, 220, 80)), (way[-1, 0], (80, 80, 255))):  # from green to red
            cv2.circle(picture, (int(at[0]), int(at[1])), 6 * 16, colour, -1, cv2.LINE_AA, 4)
    bar = int(round(px_per_m))
    cv2.line(picture, (20, size - 20), (20 + bar, size - 20), (230, 230, 230), 2)
    cv2.putText(picture, "1 m", (24, size - 28), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (230, 230, 230), 1, cv2.LINE_AA)
    return picture


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", metavar="MAP.ply")
    parser.add_argument("out", metavar="OUT.png")
    parser.add_argument("--trajectory", metavar="FILE")
    parser.add_argument("--up", choices=sorted(AXES), default="-y")
    parser.add_argument("--size", type=int, default=900, help="edge of each view in px")
    words = sys.argv[1:]
    if ["--up", "-y"] in [words[i:i + 2] for i in range(len(words))]:  # argparse takes -y for an option, unless joined
        at = words.index("--up")
        words[at:at + 2] = ["--up=-y"]
    args = parser.parse_args(words)
    if not 64 <= args.size <= 8192:
        fail(f"--size {args.size} does not fit; expected 64 to 8192 px")

    turn = AXES[args.up]
    xyz, bgr = read_ply(args.map)
    xyz = xyz @ turn.T
    trajectory = None
    if args.trajectory:
        try:
            trajectory = read_trajectory(args.trajectory)[:, 1:4] @ turn.T
        except BadTrajectory as error:
            fail(error)
        low_enough = xyz[:, 2] < trajectory[:, 2].max() + CEILING_M
        xyz, bgr = xyz[low_enough], bgr[low_enough]
    if len(xyz) == 0:
        fail(f"{args.map} holds no point to draw; is --up {args.up} right?")
    voxel_m = spacing(xyz)

    # At an angle: turned about the vertical, then tilted, so that walls on the near side do not hide the room.
    yaw, tilt = np.radians(30), np.radians(50)
    c, s = np.cos(yaw), np.sin(yaw)
    about_up = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(tilt), np.sin(tilt)
    oblique = np.array([[1, 0, 0], [0, s, c], [0, -c, s]]) @ about_up
    views = [draw(xyz, bgr, trajectory, args.size, voxel_m),
             draw(xyz @ oblique.T, bgr, None if trajectory is None else trajectory @ oblique.T, args.size, voxel_m)]
    _, png = cv2.imencode(".png", np.hstack(views))
    try:
        with open(args.out, "wb") as file:
            file.write(png.tobytes())
    except OSError as error:
        fail(f"cannot write {args.out}: {error.strerror}; name a file in a folder that you may write to")


if __name__ == "__main__":
    main()
