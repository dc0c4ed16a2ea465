# SPDX-License-Identifier: Apache-2.0
"""render_map.py on small maps of which it is known what must be seen where."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import cv2
import numpy as np

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "render_map.py"
HEADER = ("ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
          "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n")


def ply(points, colours):
    data = np.zeros(len(points), [("p", "<f4", 3), ("c", "u1", 3)])
    data["p"], data["c"] = points, colours
    return HEADER.format(len(points)).encode() + data.tobytes()


def floor(axes):
    """A 4 m x 2 m floor with a red half (+right), a blue half (-right) and a green column; axes = right, ahead, up."""
    right, ahead = np.meshgrid(np.arange(-2, 2, 0.05) + 0.025, np.arange(-1, 1, 0.05) + 0.025)
    points = right.reshape(-1, 1) * axes[0] + ahead.reshape(-1, 1) * axes[1]
    colours = np.where(right.reshape(-1, 1) > 0, (200, 0, 0), (0, 0, 200))
    heights = np.arange(0.05, 1, 0.05).reshape(-1, 1)
    column = heights * axes[2] + 1.5 * axes[0] + 0.5 * axes[1]
    return np.vstack([points, column]), np.vstack([colours, np.tile((0, 200, 0), (len(column), 1))])


class RenderMapTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def render(self, data, *arguments, code=0):
        (self.path / "map.ply").write_bytes(data)
        result = subprocess.run([sys.executable, SCRIPT, self.path / "map.ply", self.path / "out.png", *arguments], capture_output=True, text=True)
        self.assertEqual(result.returncode, code, result.stderr)
        if code != 0:
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
            self.assertFalse((self.path / "out.png").exists())
            return result.stderr
        return cv2.imread(str(self.path / "out.png"))

    def check_top_view(self, picture):
        self.assertEqual(picture.shape, (200, 400, 3))
        top = picture[:, :200]
        blue, green, red = (np.argwhere((top.max(2) > 80) & (top.argmax(2) == k)) for k in range(3))
        green = green[green[:, 1] > 100]  # a trajectory's start, on the left, is green, too
        self.assertGreater(len(blue), 4000)
        self.assertGreater(len(red), 4000)
        self.assertLess(blue[:, 1].mean() + 50, red[:, 1].mean())  # red lies right of blue
        self.assertLess(green[:, 0].mean(), red[:, 0].mean() - 10)  # the column stands ahead: higher in the picture
        self.assertGreater(green[:, 1].mean(), 150)

    def test_every_choice_of_up(self):
        x, y, z = np.eye(3)
        for up, axes in (("z", (x, y, z)), ("-y", (x, z, -y)), ("y", (x, -z, y)), ("x", (y, z, x))):
            with self.subTest(up=up):
                self.check_top_view(self.render(ply(*floor(axes)), "--up", up, "--size", "200"))

    def test_up_is_that_of_the_first_camera_by_default(self):
        x, y, z = np.eye(3)
        self.check_top_view(self.render(ply(*floor((x, z, -y))), "--size", "200"))

    def test_oblique_view_shows_the_column_standing(self):
        picture = self.render(ply(*floor(np.eye(3))), "--up", "z", "--size", "200")
        tall = [np.ptp(np.argwhere((v[:, :, 1] > 80) & (v[:, :, 0] < 60) & (v[:, :, 2] < 60))[:, 0]) for v in (picture[:, :200], picture[:, 200:])]
        self.assertGreater(tall[1], 3 * tall[0])

    def test_ceiling_above_the_trajectory_is_left_out(self):
        points, colours = floor(np.eye(3))
        lid = points[colours[:, 1] == 0] + (0, 0, 2.5)
        data = ply(np.vstack([points, lid]), np.vstack([colours, np.full((len(lid), 3), 255)]))
        self.assertGreater(self.render(data, "--up", "z", "--size", "200")[100, 20:180].min(), 150)
        (self.path / "t.txt").write_text("# way\n1 -1.5 0 1.2 0 0 0 1\n2 1.5 0 1.2 0 0 0 1\n")
        picture = self.render(data, "--up", "z", "--size", "200", "--trajectory", self.path / "t.txt")
        self.check_top_view(picture)
        orange = (picture[:, :200] == (60, 200, 255)).all(2)
        self.assertGreater(orange.sum(), 100)

    def test_single_point(self):
        self.render(ply([[1, 2, 3]], [[255, 0, 0]]), "--size", "64")

    def test_damaged_maps_are_refused(self):
        whole = ply(*floor(np.eye(3)))
        for data, expected in ((b"", "no binary"), (b"hello\n", "no binary"), (whole[:-1], "cut off"), (HEADER.format(0).encode(), "0 points"),
                               (whole.replace(b"binary_little_endian", b"ascii"), "no binary"),
                               (whole.replace(b"property uchar blue\n", b""), "no blue"),
                               (whole.replace(b"property float x", b"property list x"), "not understood")):
            with self.subTest(expected=expected):
                self.assertIn(expected, self.render(data, code=1))

    def test_missing_files_are_named(self):
        self.assertIn("cannot read", self.render(ply([[0, 0, 0]], [[1, 1, 1]]), "--trajectory", "/nowhere/t.txt", code=1))


if __name__ == "__main__":
    unittest.main()
