# SPDX-License-Identifier: Apache-2.0
"""soak.py: what it calls good, on made-up samples; and a program that fails."""
import copy
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
sys.path.insert(0, str(SCRIPTS))
import soak  # noqa: E402

REPORT = {"frames": {"offered": 3600, "processed": 3590, "dropped": {"tracker_behind": 10, "no_free_slot": 0}},
          "memory": {"heap_allocations_after_start": {"capture": 0, "track": 0, "map": 0, "stream": 9},
                     "pools": {"keyframes": {"capacity": 12, "high_water": 12, "refused": 80}, "points": {"capacity": 2000, "high_water": 2000}}},
          "shedding": {"steps": 0}, "map": {"blocks_evicted": 5}}


def samples(growth_kb_a_minute=0):
    """Two minutes, 30 frames a second; the first minute settles by 9 MB."""
    def at(second):
        return {"stillmap_frames_offered_total": 30.0 * second,
                "stillmap_resident_bytes": 60e6 + (9e6 if second >= 60 else 0) + growth_kb_a_minute * 1000 * max(0, second - 60) / 60}
    return [(float(second), at(second)) for second in range(5, 125, 5)]


def failed(watched=None, report=None, due=30.0):
    return [row[0] for row in soak.judge(watched or samples(), report or REPORT, 6, due) if row[3] == "no"]


class SoakTest(unittest.TestCase):
    def changed(self, change):
        report = copy.deepcopy(REPORT)
        change(report)
        return report

    def test_a_steady_run_is_good(self):
        self.assertEqual(failed(), [])

    def test_memory_counts_after_the_first_minute(self):
        self.assertEqual(failed(samples(growth_kb_a_minute=900)), [])
        self.assertEqual(failed(samples(growth_kb_a_minute=1200)), ["resident memory, growth after the first minute"])

    def test_frames_are_accounted_and_due(self):
        lost = self.changed(lambda r: r["frames"].update(processed=3580))
        self.assertEqual(failed(report=lost), ["offered less processed less dropped"])
        starved = self.changed(lambda r: r["frames"].update(dropped={"no_free_slot": 10}))
        self.assertEqual(failed(report=starved), ["dropped for other reasons than time"])
        many = self.changed(lambda r: r["frames"].update(processed=3500, dropped={"tracker_behind": 100}))
        self.assertEqual(failed(report=many), ["dropped"])
        self.assertEqual(failed(due=26.0), ["frames offered a second"])

    def test_counters_heap_and_pools(self):
        fallen = samples()
        fallen[9] = (fallen[9][0], {**fallen[9][1], "stillmap_frames_offered_total": 1.0})
        self.assertEqual(failed(fallen), ["counters that fell or went"])
        self.assertEqual(failed(report=self.changed(lambda r: r["memory"]["heap_allocations_after_start"].update(map=1))),
                         ["heap allocations in capture, track, map"])
        self.assertEqual(failed(report=self.changed(lambda r: r["memory"]["pools"]["points"].update(high_water=2001))), ["pools beyond their capacity"])

    def test_evictions(self):
        self.assertEqual([row[3] for row in soak.judge_evictions(REPORT)], ["yes"] * 3)
        roomy = self.changed(lambda r: (r["map"].update(blocks_evicted=0), r["memory"]["pools"]["points"].update(high_water=1999)))
        self.assertEqual([row[3] for row in soak.judge_evictions(roomy)], ["no", "yes", "no"])

    def test_a_program_that_fails_is_one_line(self):
        with tempfile.TemporaryDirectory() as folder:
            program = Path(folder, "stillmap")
            program.write_text("#!/bin/sh\necho 'the log cannot be read' >&2\nexit 3\n")
            program.chmod(0o755)
            Path(folder, "rgb.txt").write_text("1.0 a\n2.0 b\n")
            result = subprocess.run([sys.executable, "-B", SCRIPTS / "soak.py", "--log", folder, "--bin", folder, "--out", f"{folder}/out"],
                                    capture_output=True, text=True, check=False)
        self.assertEqual((result.returncode, result.stderr), (1, "soak.py: the log cannot be read\n"))


if __name__ == "__main__":
    unittest.main()
