# SPDX-License-Identifier: Apache-2.0
"""The process is killed at random moments while it maps, saves and records: what it leaves can be used.

STILLMAP_KILLS says how often; test.sh --full asks for more.
"""
import os
import random
import re
import subprocess
import time
import unittest

from program import DETECTOR, DONE, NO_DETECTOR, PROGRAM, QUIET, UNREADABLE_INPUT, ProgramTest, run_args, stillmap
from signals_test import endless_log

KILLS = int(os.environ.get("STILLMAP_KILLS", "4"))


class PowerCut(ProgramTest):
    def kill(self, mode, detector, after_s, map_file, record, until=lambda: True):
        """Runs, and kills it so long after tracking began; not before `until`."""
        args = run_args("--mode", mode, "--map", map_file, "--record", record, "--set", "map.checkpoint_s=0.1", log=self.log, detector=detector)
        process = subprocess.Popen([PROGRAM, *args], stderr=subprocess.PIPE, text=True)
        while "tracking_started" not in process.stderr.readline():
            self.assertIsNone(process.poll())
        time.sleep(after_s)
        end = time.monotonic() + 250
        while not until() and time.monotonic() < end:
            time.sleep(0.05)
        process.kill()
        process.communicate()

    def replayed(self, record):
        """Frames that a recording plays; every one that its list names."""
        lines = [line for line in (record / "associations.txt").read_text().split("\n")[:-1]]
        report = self.path / "replay.json"
        result = stillmap("run", "--config", record / "camera.toml", *NO_DETECTOR, *QUIET, "--source", f"tum:{record}", "--mode", "fast", "--report", report)
        self.assertEqual(result.returncode, DONE if lines else UNREADABLE_INPUT, result.stderr)
        if lines:
            self.assertIn(f'"offered": {len(lines)},', report.read_text())
            self.assertIn('"dropped": {}', report.read_text())
        return len(lines)

    def test_maps_and_recordings_survive(self):
        self.log = endless_log(self.path / "log")
        map_file = self.path / "m.stillmap"
        saved = recorded = 0
        before = None
        for number in range(KILLS):
            mode, detector, after_s = random.choice(("realtime", "lockstep")), random.choice((NO_DETECTOR, DETECTOR)), random.uniform(0, 1.2)
            with self.subTest(number=number, mode=mode, detector=detector, after_s=after_s):
                record = self.path / f"record{number}"
                # A slow machine may not have come to saving and recording; the last time it has.
                names = record / "associations.txt"
                until = lambda: number + 1 < KILLS or (map_file.exists() and names.exists() and names.stat().st_size > 200)
                self.kill(mode, detector, after_s, map_file, record, until)
                recorded += self.replayed(record)
                if map_file.exists():  # the one before is there as long as the new one is not complete
                    info = stillmap("map", "info", map_file)
                    self.assertEqual(info.returncode, DONE, info.stderr)
                    self.assertRegex(info.stdout, r"voxels +\d+ occupied")
                    saved += map_file.read_bytes() != before
                    before = map_file.read_bytes()
                else:
                    self.assertIsNone(before, "a complete map is gone")
        self.assertGreater(saved, 0)
        self.assertGreater(recorded, 0)
        # And the next run takes up where nothing is in its way.
        result = stillmap(*run_args("--mode", "lockstep", "--map", map_file))
        self.assertEqual(result.returncode, DONE, result.stderr)

    def test_a_list_that_the_power_cut_through_plays_up_to_there(self):
        record = self.path / "record"
        result = stillmap(*run_args("--mode", "lockstep", "--record", record))
        self.assertEqual(result.returncode, DONE, result.stderr)
        text = (record / "associations.txt").read_text()
        for cut in random.sample(range(1, 120), 3):
            with self.subTest(cut=cut):
                (record / "associations.txt").write_text(text[:-cut])
                report = self.path / "replay.json"
                result = stillmap("run", "--config", record / "camera.toml", *NO_DETECTOR, *QUIET, "--source", f"tum:{record}", "--mode", "fast",
                                  "--report", report)
                self.assertEqual(result.returncode, DONE, result.stderr)
                self.assertGreaterEqual(int(re.search(r'"processed": (\d+)', report.read_text()).group(1)), text.count("\n") - 2)


if __name__ == "__main__":
    unittest.main()
