# SPDX-License-Identifier: Apache-2.0
"""import_calibration.py: both kinds of calibration to a profile, and its words about what it cannot use."""
import math
import os
import random
import re
import runpy
import subprocess
import tempfile
import tomllib
import unittest
from pathlib import Path

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "import_calibration.py"

ROS = """image_width: 640
image_height: 480
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [525.5, 0, 319.25, 0, 526.5, 240.75, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, -0.002, 0.05]}
"""
KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0.01, -0.02, 0.003, -0.004]
  distortion_model: radtan
  intrinsics: [610.0, 611.0, 321.0, 241.0]
  resolution: [640, 480]
"""
# The depth camera is turned by 90 degrees about z and stands at (0.1, 0.2, 0.3) in colour.
CAM1 = """cam1:
  T_cn_cnm1: [[0, 1, 0, -0.2], [-1, 0, 0, 0.1], [0, 0, 1, -0.3], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [380.0, 381.0, 320.0, 240.0]
  resolution: [640, 400]
"""


class ImportTest(unittest.TestCase):
    def run_on(self, text, *args):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "c.yaml").write_text(text)
            return subprocess.run(["/usr/bin/python3", "-B", SCRIPT, Path(folder) / "c.yaml", *args], capture_output=True, text=True, check=False)

    def profile(self, text, *args):
        result = self.run_on(text, *args)
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        return tomllib.loads(result.stdout)["camera"]

    def test_ros(self):
        self.assertEqual(self.profile(ROS, "--depth-units-per-m", "5000", "--fps", "15"), {
            "width": 640, "height": 480, "fx": 525.5, "fy": 526.5, "cx": 319.25, "cy": 240.75, "k1": 0.1, "k2": -0.2,
            "p1": 0.001, "p2": -0.002, "k3": 0.05, "depth_units_per_m": 5000, "fps": 15})

    def test_kalibr(self):
        camera = self.profile(KALIBR)
        self.assertEqual([camera[k] for k in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")],
                         [610, 611, 321, 241, 0.01, -0.02, 0.003, -0.004, 0])
        self.assertNotIn("depth", camera)
        self.assertEqual((camera["depth_units_per_m"], camera["fps"]), (1000, 30))
        self.assertIn("millimetres are assumed", self.run_on(KALIBR).stdout)

    def test_kalibr_with_a_depth_camera(self):
        depth = self.profile(KALIBR + CAM1)["depth"]
        self.assertEqual((depth["height"], depth["fx"]), (400, 380))
        expected = [0.1, 0.2, 0.3, 0, 0, math.sqrt(0.5), math.sqrt(0.5)]
        for got, wanted in zip(depth["T_colour_depth"], expected):
            self.assertAlmostEqual(got, wanted, places=12)

    def test_refusals(self):
        for text, words in ((ROS.replace("plumb_bob", "equidistant"), "'equidistant' is none of plumb_bob"),
                            (KALIBR.replace("radtan", "equi"), "'equi' is none of radtan"),
                            (KALIBR.replace("pinhole", "omni"), "'omni' is not pinhole"),
                            (KALIBR.replace("resolution", "size"), "has no 'resolution'"),
                            (KALIBR.replace("[610.0, 611.0, 321.0, 241.0]", "[610.0, x]"), "intrinsics must be a list of 4 numbers"),
                            ("a: [", "expected"), ("a: 1", "neither a ROS camera_info"), ("text", "is no calibration")):
            with self.subTest(words=words):
                result = self.run_on(text)
                self.assertEqual((result.returncode, result.stdout), (1, ""))
                self.assertEqual(len(result.stderr.splitlines()), 1)
                self.assertIn(words, result.stderr)

    def test_a_file_that_cannot_be_opened(self):
        for path, words in (("/none/ost.yaml", "/none/ost.yaml: No such file or directory"), ("/tmp", "/tmp: Is a directory")):
            result = subprocess.run([SCRIPT, path], capture_output=True, text=True)
            self.assertEqual((result.returncode, result.stderr), (1, f"import_calibration.py: {words}; give the YAML file of a calibration\n"))

    def test_damage_of_any_kind_is_refused_or_harmless(self):
        """Hundreds of damaged calibrations: a profile of finite numbers, or one line."""
        module = runpy.run_path(str(SCRIPT))
        chance, words = random.Random(1), ["nan", ".inf", "-1", "1e400", "null", "[]", "{}", "~", "true", "9" * 20, "[[1]]", "&a [*a]", "2001-13-41"]
        refused = 0
        for _ in range(200):
            text = chance.choice([ROS, KALIBR, KALIBR + CAM1])
            for _ in range(chance.randint(1, 3)):
                at = chance.randrange(len(text))
                numbers = list(re.finditer(r"-?\d+(\.\d+)?", text))
                damage = chance.randrange(4)
                if damage == 0:
                    text = text[:at] + chance.choice("\0\t\n \"':[]{}\xe9\u2028") + text[at + 1:]
                elif damage == 1:
                    text = "\n".join(line for line in text.split("\n") if chance.random() > 0.1) or "x"
                elif damage == 2 and numbers:
                    number = chance.choice(numbers)
                    text = text[:number.start()] + chance.choice(words) + text[number.end():]
                else:
                    text = text[:at] or "x"
            with self.subTest(text=text), tempfile.NamedTemporaryFile("w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                try:
                    colour, depth, pose = module["read"](file.name)
                except module["Unusable"] as error:
                    refused += 1
                    self.assertNotIn("\n", str(error))
                    continue
                self.assertTrue(all(math.isfinite(v) for v in [*colour.values(), *(depth or {}).values(), *(pose or [])]))
        self.assertGreater(refused, 60)
        self.assertLess(refused, 200)


if __name__ == "__main__":
    unittest.main()
