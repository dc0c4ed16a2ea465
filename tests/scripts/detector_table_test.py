# SPDX-License-Identifier: Apache-2.0
"""detector_table.py: real networks side by side, and what it makes of the programs' answers, which stand-ins give."""
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import quantize_model_test as small

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
# Each answers by the words that it was given.
COVERAGE = """#!/usr/bin/python3
import json, sys
share = 0.5 if "float" in sys.argv[-1] else 0.25
print(json.dumps({"covered_by_boxes": share, "covered_by_carried": share / 2, "covered_by_mask": share / 4, "background_in_mask": 0.0625, "cpu_ms_median": 7.5}))
"""
RUN = """#!/usr/bin/python3
import json, sys
words = sys.argv
seed = int(words[-1].split("=")[1])
if FAILS: sys.exit("the log is torn")
accuracy = {"ate_rmse_m": seed / 100, "coverage": 0.9 if "realtime" in words else 1.0}
json.dump({"accuracy": accuracy}, open(words[words.index("--report") + 1], "w"))
"""


class DetectorTableTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.path = Path(folder.name)
        small.pictures(cls.path, 8)
        subprocess.run([sys.executable, SCRIPTS / "quantize_model.py", small.SmallNetwork().write_ncnn(cls.path), "--log", cls.path, "--size", str(small.WIDTH),
                        str(small.HEIGHT), "--float", cls.path / "float.onnx", "--out", cls.path / "int8.onnx"], check=True, capture_output=True)
        (cls.path / "groundtruth.txt").write_text("")
        (cls.path / "mask").mkdir()

    def table(self, *arguments, code=0, fails=False):
        for name, text in (("stillmap-coverage", COVERAGE), ("stillmap", RUN.replace("FAILS", str(fails)))):
            (self.path / name).write_text(text)
            (self.path / name).chmod(0o755)
        camera = SCRIPTS.parent / "firmware-config/cameras/tum-fr1.toml"
        result = subprocess.run([sys.executable, SCRIPTS / "detector_table.py", "--bin", self.path, "--out", self.path / "out", "--camera", camera,
                                 "--float", self.path / "float.onnx", *arguments], capture_output=True, text=True, check=False)
        self.assertEqual(result.returncode, code, result.stderr)
        return result

    def test_a_row_for_each_network(self):
        result = self.table("--log", self.path, self.path / "int8.onnx")
        head, _, of_float, of_int8 = ([cell.strip() for cell in line.split("|")[1:-1]] for line in result.stdout.splitlines())
        self.assertEqual(len(head), len(of_int8))
        self.assertEqual(of_float[:2], ["float", f"{small.WIDTH}x{small.HEIGHT}"])
        self.assertEqual(of_float[4:8], ["-", "-", "50.0 %", "25.0 %"])
        self.assertEqual(of_int8[3], "7.5 ms")
        self.assertEqual(of_int8[6:], ["25.0 %", "12.5 %", "6.2 %", "6.2 %", "0.0200 / 0.0300 m", "0.0200 / 0.0300 m on 90 %"])
        figures = json.loads((self.path / "out/detector_table.json").read_text())
        self.assertGreater(figures["int8"]["boxes"]["of_float_in_int8"], 0.6)
        self.assertEqual(of_int8[4], f"{100 * figures['int8']['boxes']['of_float_in_int8']:.1f} %")
        self.assertEqual(set(figures["float"]["opencv_ms"]), {"1", "2"})

    def test_refusals(self):
        def error(*arguments, **options):
            lines = self.table(*arguments, code=1, **options).stderr.strip().splitlines()
            self.assertEqual(len(lines), 1, lines)
            return lines[0]
        self.assertIn("the log is torn", error("--log", self.path, self.path / "int8.onnx", fails=True))
        self.assertIn("holds no groundtruth.txt", error("--log", self.path / "rgb", self.path / "int8.onnx"))
        bare = self.path / "bare.onnx"
        bare.write_bytes((self.path / "int8.onnx").read_bytes())
        self.assertIn("bare.toml is no manifest", error("--log", self.path, bare))


if __name__ == "__main__":
    unittest.main()
