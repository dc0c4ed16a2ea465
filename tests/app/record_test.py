# SPDX-License-Identifier: Apache-2.0
"""--record: what a run writes down replays to the same run."""
import json
import unittest

from program import DONE, FRAMES, LOG, RUN_FAILED, QUIET, NO_DETECTOR, ProgramTest, run_args, stillmap


class Record(ProgramTest):
    def test_an_exact_recording_replays_to_the_same_trajectory(self):
        first, again = self.path / "first.txt", self.path / "again.txt"
        log, report = self.path / "log", self.path / "report.json"
        result = stillmap(*run_args("--mode", "lockstep", "--record", log, "--set", "record.colour=png", "--trajectory", first, "--report", report))
        self.assertEqual(result.returncode, DONE, result.stderr)
        recorded = json.loads(report.read_text())["record"]
        self.assertEqual((recorded["frames"], recorded["left_out"], recorded["failed"]), (FRAMES, 0, 0))
        self.assertGreater(recorded["cpu_ms_per_frame"], 0)
        result = stillmap("run", "--config", log / "camera.toml", *NO_DETECTOR, *QUIET, "--source", f"tum:{log}", "--mode", "lockstep", "--trajectory", again)
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertEqual(first.read_text(), again.read_text())

    def test_a_jpeg_recording_is_whole_in_realtime_too(self):
        log, report = self.path / "log", self.path / "report.json"
        result = stillmap(*run_args("--record", log, "--report", report))
        self.assertEqual(result.returncode, DONE, result.stderr)
        facts = json.loads(report.read_text())
        lines = (log / "associations.txt").read_text().splitlines()
        self.assertEqual(len(lines), facts["record"]["frames"])
        self.assertEqual(facts["record"]["frames"] + facts["record"]["left_out"], FRAMES)
        self.assertTrue(all((log / name).is_file() for line in lines for name in line.split()[1::2]))
        self.assertTrue(lines[0].split()[1].endswith(".jpg"))
        self.assertEqual(facts["memory"]["heap_allocations_after_start"]["capture"], 0)

    def test_an_existing_log_is_not_written_over(self):
        self.assert_error(stillmap(*run_args("--record", LOG)), RUN_FAILED, f"--record {LOG}: holds a log or a camera.toml already", "give a new folder")

    def test_the_profile_of_a_log_can_be_read_whatever_the_camera_is_called(self):
        log = self.path / "log"
        named = ["--set", 'camera.name=Bob"s cam \\ 2', "--duration", "0.1", "--mode", "lockstep"]
        self.assertEqual(stillmap(*run_args(*named, "--record", log)).returncode, DONE)
        result = stillmap("check", "--config", log / "camera.toml")
        self.assertEqual(result.returncode, DONE, result.stderr)


if __name__ == "__main__":
    unittest.main()
