# SPDX-License-Identifier: Apache-2.0
"""report_table.py on made reports: each column says what the report says."""
import copy
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "report_table.py"
REPORT = {"mode": "lockstep", "throughput_fps": 31.26, "cpu_s": 4.5, "map": {"voxels": 4321},
          "frames": {"offered": 100, "processed": 90, "dropped": {"tracker_behind": 7, "corrupt_depth": 3}},
          "memory": {"planned_bytes": 61_400_000, "rss_peak_kb": 95_600}, "accuracy": {"ate_rmse_m": 0.01234}}


class ReportTableTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def report(self, name, change=lambda report: None):
        report = copy.deepcopy(REPORT)
        change(report)
        (self.path / name).write_text(json.dumps(report))
        return self.path / name

    def table(self, *words, code=0):
        result = subprocess.run([sys.executable, "-B", SCRIPT, *words], capture_output=True, text=True, check=False)
        self.assertEqual(result.returncode, code, result.stderr)
        if code != 0:
            self.assertEqual((result.stdout, len(result.stderr.strip().splitlines())), ("", 1), result.stderr)
        return result.stdout if code == 0 else result.stderr

    def test_a_row_for_each_report_in_the_order_given(self):
        def nothing_processed(report):
            report["frames"] = {"offered": 5, "processed": 0, "dropped": {"corrupt_depth": 5}}
            del report["accuracy"]
        lines = self.table(f"b={self.report('b.json')}", f"a={self.report('a.json')}",
                           f"none={self.report('n.json', nothing_processed)}").splitlines()
        self.assertRegex(lines[0], r"^run +mode +frames/s +dropped +CPU a frame +ATE \(RMSE\) +voxels +planned +peak RSS$")
        self.assertRegex(lines[2], r"^b +lockstep +31\.3 +10 of 100 +50 ms +0\.0123 m +4321 +61 MB +96 MB$")
        self.assertEqual(lines[3].split()[1:], lines[2].split()[1:])
        self.assertRegex(lines[4], r"^none +lockstep +31\.3 +5 of 5 +4500 ms +- +4321 +61 MB +96 MB$")
        self.assertEqual(len(lines), 5)

    def test_what_cannot_be_read_is_named(self):
        (self.path / "damaged.json").write_text('{"mode": ')
        self.assertIn("usage", self.table(code=1))
        self.assertIn("usage", self.table("report.json", code=1))
        self.assertIn("gone.json", self.table(f"a={self.path / 'gone.json'}", code=1))
        self.assertIn("damaged.json", self.table(f"a={self.path / 'damaged.json'}", code=1))
        self.assertIn("'memory'", self.table(f"a={self.report('m.json', lambda report: report.pop('memory'))}", code=1))


if __name__ == "__main__":
    unittest.main()
