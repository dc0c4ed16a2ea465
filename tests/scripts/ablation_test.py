# SPDX-License-Identifier: Apache-2.0
"""ablation.py on a program that only pretends: what it leaves out, and the table."""
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])

# Stands for stillmap. ATE is 1 mm times the seed, ten times as much without loops.
PRETEND = '''#!%s
import json, pathlib, sys
words = sys.argv[1:]
settings = dict(word.split("=", 1) for word, before in zip(words[1:], words) if before == "--set")
left_out = json.loads(settings.get("track.without", "[]"))
ate = 0.001 * int(settings["runtime.seed"]) * (10 if left_out == ["loops"] else 1)
report = {"accuracy": {"ate_rmse_m": ate}, "tracking": {"lost": 5 if "--detector-delay" in words else 0},
          "latency_ms": {"track": {"p50": 8, "p99": 12}}}
pathlib.Path(words[words.index("--report") + 1]).write_text(json.dumps(report))
'''


class AblationTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        self.program = self.path / "stillmap"
        self.program.write_text(PRETEND % sys.executable)
        self.program.chmod(0o755)
        (self.path / "groundtruth.txt").touch()
        (self.path / "camera.toml").touch()

    def run_on(self, log):
        return subprocess.run([sys.executable, "-B", SCRIPTS / "ablation.py", log, "--model", "none", "--binary", self.program],
                              capture_output=True, text=True, check=False)

    def test_a_row_for_each_part(self):
        result = self.run_on(f"{self.path}={self.path}/camera.toml")
        self.assertEqual(result.returncode, 0, result.stderr)
        rows = result.stdout.splitlines()[2:]
        self.assertEqual(rows[0], "| (nothing) | 2.0, 0.0, 8/12 | 2.0, 5.0, 8/12 |")
        self.assertEqual(rows[-1], "| loops | 20.0, 0.0, 8/12 | 20.0, 5.0, 8/12 |")
        self.assertEqual(len(rows), 8)

    def test_refusals(self):
        result = self.run_on(f"{self.path}=/no/such.toml")
        self.assertIn("expected LOG=CAMERA", result.stderr)
        self.assertEqual(len(result.stderr.splitlines()), 1)


if __name__ == "__main__":
    unittest.main()
