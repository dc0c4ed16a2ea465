# SPDX-License-Identifier: Apache-2.0
"""plot_trajectory.py: the figure it names is right, and bad files are refused."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "plot_trajectory.py"
sys.path.insert(0, str(SCRIPT.parent))
import plot_trajectory  # noqa: E402


class PlotTrajectoryTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        t = np.arange(0, 5, 0.01)
        self.truth = np.stack([t, np.sin(t), np.cos(0.7 * t), 0.2 * t] + [0 * t] * 3 + [0 * t + 1], 1)
        np.savetxt(self.path / "truth.txt", self.truth)

    def plot(self, *estimates, code=0):
        result = subprocess.run([sys.executable, SCRIPT, self.path / "truth.txt", *estimates, "--out", self.path / "out.png"],
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, code, result.stderr)
        if code != 0:
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        return result.stderr

    def test_alignment_undoes_a_rigid_motion_but_no_scale_or_mirror(self):
        points = self.truth[:, 1:4]
        turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
        rotation, shift = plot_trajectory.alignment(points @ turn.T + (1, 2, 3), points)
        np.testing.assert_allclose((points @ turn.T + (1, 2, 3)) @ rotation.T + shift, points, atol=1e-9)
        for changed in (2 * points, points * (1, 1, -1)):
            rotation, shift = plot_trajectory.alignment(changed, points)
            self.assertAlmostEqual(np.linalg.det(rotation), 1)
            self.assertGreater(np.abs(changed @ rotation.T + shift - points).max(), 0.1)

    def test_stamps_match_within_20_ms_to_the_nearest(self):
        truth_s = np.array([0.0, 1.0, 2.0])
        in_truth, in_estimate = plot_trajectory.match(truth_s, np.array([-0.019, 0.03, 0.985, 1.021, 2.019, 9.0]))
        self.assertEqual(list(in_truth), [0, 1, 2])
        self.assertEqual(list(in_estimate), [0, 2, 4])

    def test_picture_of_two_estimates(self):
        for name, noise in (("a.txt", 0.01), ("b.txt", 0.05)):
            rows = self.truth[::3].copy()
            rows[:, 1:4] += noise * np.random.default_rng(1).standard_normal(rows[:, 1:4].shape)
            np.savetxt(self.path / name, rows)
        self.plot(self.path / "a.txt", self.path / "b.txt")
        self.assertTrue((self.path / "out.png").read_bytes().startswith(b"\x89PNG"))

    def test_bad_estimates_are_refused(self):
        later = self.truth + np.array([100] + [0] * 7)
        np.savetxt(self.path / "later.txt", later)
        (self.path / "text.txt").write_text("hello\n")
        (self.path / "empty.txt").write_text("# nothing\n")
        for name, expected in (("later.txt", "share no time"), ("text.txt", "cannot read"), ("empty.txt", "no trajectory"), ("gone.txt", "cannot read")):
            with self.subTest(name=name):
                self.assertIn(expected, self.plot(self.path / name, code=1))
        self.assertFalse((self.path / "out.png").exists())


if __name__ == "__main__":
    unittest.main()
