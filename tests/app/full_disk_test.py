# SPDX-License-Identifier: Apache-2.0
"""Disk full, read-only folder, too little memory: one clear error, the exit code of the contract, nothing half written.

The full disk is a limit on the size of files, which no test needs privileges for; writing fails there as it does on a disk.
"""
import json
import resource
import signal
import subprocess
import unittest

from program import FRAMES, PROGRAM, RUN_FAILED, ProgramTest, run_args, stillmap


def limited(limit, value):
    def before_exec():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(limit, (value, value))
    return before_exec


class FullDisk(ProgramTest):
    def run_limited(self, limit, value, *args):
        return subprocess.run([PROGRAM, *args], capture_output=True, text=True, timeout=600, preexec_fn=limited(limit, value))

    def test_a_map_that_does_not_fit_leaves_the_one_before(self):
        for name in ("m.ply", "m.stillmap"):
            file = self.path / name
            file.write_text("an earlier map")
            result = self.run_limited(resource.RLIMIT_FSIZE, 20_000, *run_args("--mode", "lockstep", "--duration", "0.5", "--map", file))
            self.assert_error(result, RUN_FAILED, str(file))
            self.assertEqual(file.read_text(), "an earlier map")
            self.assertEqual([p.name for p in self.path.iterdir()], [name])
            file.unlink()

    def test_a_trajectory_that_does_not_fit(self):
        file = self.path / "t.txt"
        result = self.run_limited(resource.RLIMIT_FSIZE, 500, *run_args("--mode", "lockstep", "--trajectory", file))
        self.assert_error(result, RUN_FAILED, str(file))
        self.assertEqual(list(self.path.iterdir()), [])

    def test_a_recording_goes_on_with_what_fits_and_says_so(self):
        report = self.path / "r.json"
        for mode in ("lockstep", "realtime"):
            with self.subTest(mode=mode):
                folder = self.path / mode
                result = self.run_limited(resource.RLIMIT_FSIZE, 100_000, *run_args("--mode", mode, "--record", folder, "--set", "record.colour=png",
                                                                                    "--report", report))
                self.assert_error(result, RUN_FAILED, f"--record {folder}", "could not be written")
                facts = json.loads(report.read_text())
                self.assertEqual(facts["frames"]["processed"] + sum(facts["frames"]["dropped"].values()), FRAMES)  # the run went on
                self.assertGreater(facts["record"]["failed"], 0)
                self.assertEqual((folder / "associations.txt").read_text().count("\n"), facts["record"]["frames"])
                self.assertEqual(sum(1 for _ in (folder / "rgb").iterdir()), facts["record"]["frames"])

    def test_a_folder_that_cannot_be_written_is_refused_before_the_run(self):
        for option, path in (("--map", "/proc/m.ply"), ("--trajectory", "/proc/t.txt"), ("--report", "/proc/r.json"), ("--record", "/proc/log")):
            with self.subTest(option=option):
                self.assert_error(stillmap(*run_args(option, path)), RUN_FAILED, path)


if __name__ == "__main__":
    unittest.main()
