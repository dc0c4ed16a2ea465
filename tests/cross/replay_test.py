# SPDX-License-Identifier: Apache-2.0
"""The cross-built program, emulated, replays a log as this machine's own build does.

Equality of bytes is not promised: the processors' mathematical libraries may round the last bit differently, Eigen adds
in the order of the processor's vectors, and a point near a threshold may then fall on its other side. What must agree is
what a user sees: each frame's pose, the states, the map. (Measured: nothing differed in what is printed, 1 um.)
"""
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

SOURCE, NATIVE = Path(os.environ["STILLMAP_SOURCE_DIR"]), Path(os.environ["STILLMAP_NATIVE"])
EMULATED = os.environ["STILLMAP_EMULATOR"].split() + [os.environ["STILLMAP_BIN"]]
FRAMES = 12
MAX_APART_M, MAX_APART_DEG = 0.0005, 0.02
MAX_COUNT_APART = 0.01  # share of features and voxels
PLACE_BYTES, VOXEL_BYTES = 12, 15  # x, y, z as floats, then a byte each of red, green and blue


def quaternion_angle_deg(a, b):
    apart = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return np.degrees(4 * np.arcsin(apart / 2))


def counts(report):
    tracking, features = report["tracking"], report["tracking"]["features"]
    return {"voxels": report["map"]["voxels"], "static": features["static"], "dynamic": features["dynamic"]}, \
        {k: tracking[k] for k in ("tracked", "weak", "lost", "keyframes")} | {"detector_runs": report["detector"]["runs"]}


def voxels(ply):
    body = ply.read_bytes().partition(b"end_header\n")[2]
    return {body[i:i + PLACE_BYTES] for i in range(0, len(body), VOXEL_BYTES)}


class ReplayTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.path = Path(folder.name)
        subprocess.run([NATIVE / "stillmap-synth", "--out", cls.path / "log", "--seed", "3", "--frames", str(FRAMES)], check=True)
        subprocess.run([sys.executable, SOURCE / "scripts/make_demo_model.py", cls.path / "demo.onnx"], check=True)
        cls.native, cls.emulated = cls.run_program("native", [NATIVE / "stillmap"]), cls.run_program("emulated", EMULATED)

    @classmethod
    def run_program(cls, name, program):
        trajectory, report = cls.path / f"{name}.txt", cls.path / f"{name}.json"
        result = subprocess.run(
            [*program, "run", "--config", SOURCE / "firmware-config/cameras/synthetic.toml",
             "--config", SOURCE / "firmware-config/demo.toml", "--set", f"detector.model={cls.path / 'demo.onnx'}",
             "--source", f"tum:{cls.path / 'log'}", "--mode", "lockstep", "--listen", "off", "--detector-delay", "2",
             "--detector-every", "3", "--trajectory", trajectory, "--report", report, "--map", cls.path / f"{name}.ply"],
            capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise AssertionError(f"{name}: exit {result.returncode}: {result.stderr}")
        return np.loadtxt(trajectory), json.loads(report.read_text())

    def test_each_frame_has_the_same_pose(self):
        ours, theirs = self.native[0], self.emulated[0]
        self.assertEqual(len(ours), FRAMES)
        np.testing.assert_array_equal(ours[:, 0], theirs[:, 0])
        apart_m = np.linalg.norm(ours[:, 1:4] - theirs[:, 1:4], axis=1)
        apart_deg = quaternion_angle_deg(ours[:, 4:], theirs[:, 4:])
        print(f"poses apart: at most {1000 * apart_m.max():.4f} mm and {apart_deg.max():.5f} degrees")
        self.assertLess(apart_m.max(), MAX_APART_M)
        self.assertLess(apart_deg.max(), MAX_APART_DEG)

    def test_the_maps_are_the_same_places(self):
        ours, theirs = voxels(self.path / "native.ply"), voxels(self.path / "emulated.ply")
        print(f"{len(ours ^ theirs)} of {len(ours)} voxels are in one map only")
        self.assertGreater(len(ours), 1000)
        self.assertLessEqual(len(ours ^ theirs), MAX_COUNT_APART * len(ours))

    def test_the_runs_count_the_same(self):
        (ours, ours_exact), (theirs, theirs_exact) = counts(self.native[1]), counts(self.emulated[1])
        print(f"here {ours}, emulated {theirs}")
        self.assertEqual(ours_exact, theirs_exact)
        for name, count in ours.items():
            self.assertGreater(count, 0, name)
            self.assertLessEqual(abs(theirs[name] - count), MAX_COUNT_APART * count, name)


if __name__ == "__main__":
    if not (NATIVE / "stillmap").exists() or not (NATIVE / "stillmap-synth").exists():
        print(f"skipped: nothing to compare with in {NATIVE}; build preset release first")
        sys.exit(77)
    unittest.main()
