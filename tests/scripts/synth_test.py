# SPDX-License-Identifier: Apache-2.0
"""stillmap-synth: its files are what other programs can read, and wrong arguments are refused."""
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import cv2
import numpy as np

SYNTH = os.environ["STILLMAP_SYNTH"]


class SynthTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def run_synth(self, *arguments):
        return subprocess.run([SYNTH, *arguments], capture_output=True, text=True)

    def test_pictures_decode(self):
        result = self.run_synth("--out", self.path / "log", "--frames", "1", "--people", "2", "--seed", "2", "--path", "walk")
        self.assertEqual(result.returncode, 0, result.stderr)
        colour = cv2.imread(str(self.path / "log/rgb/1000.000000.jpg"), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(self.path / "log/depth/1000.000000.png"), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(self.path / "log/mask/1000.000000.png"), cv2.IMREAD_UNCHANGED)
        self.assertEqual((colour.shape, colour.dtype), ((480, 640, 3), np.uint8))
        self.assertEqual((depth.shape, depth.dtype), ((480, 640), np.uint16))
        self.assertEqual((mask.shape, mask.dtype), ((480, 640), np.uint8))
        readings_m = depth[depth > 0] / 5000
        self.assertGreater(readings_m.min(), 0.39)
        self.assertLess(readings_m.max(), 6.05)
        self.assertGreater(len(readings_m), 0.7 * depth.size)

    def test_wrong_arguments(self):
        for arguments in ([], ["--out"], ["--out", ""], ["--frames", "10"], ["--out", self.path / "x", "--frames", "-1"],
                          ["--out", self.path / "x", "--seed", "1x"], ["--out", self.path / "x", "--path", "fly"],
                          ["--out", self.path / "x", "--people", "17"], ["--in", "x"]):
            with self.subTest(arguments=arguments):
                result = self.run_synth(*arguments)
                self.assertEqual(result.returncode, 2, result.stderr)
                self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        self.assertFalse((self.path / "x").exists())


if __name__ == "__main__":
    unittest.main()
