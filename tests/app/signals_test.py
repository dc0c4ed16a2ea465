# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM end a run within 2 s, with exit code 0 and every output complete."""
import json
import os
import random
import re
import resource
import signal
import subprocess
import time
import unittest
from pathlib import Path

from program import DETECTOR, DONE, LOG, NO_DETECTOR, PROGRAM, ProgramTest, run_args


def endless_log(folder, frames=5000, fps=30):
    """The rendered log again and again, as if the camera stood still for ever; 5000 frames are three minutes."""
    lines = [l.split() for l in (LOG / "associations.txt").read_text().splitlines() if not l.startswith("#")]
    folder.mkdir()
    (folder / "rgb").symlink_to(LOG / "rgb")
    (folder / "depth").symlink_to(LOG / "depth")
    with open(folder / "associations.txt", "w") as out:
        for n in range(frames):
            _, colour, _, depth = lines[n % 2]
            out.write(f"{1 + n / fps:.6f} {colour} {1 + n / fps:.6f} {depth}\n")
    return folder


def processor_s(usage):
    return usage.ru_utime + usage.ru_stime


def waited_for_processors_s():
    """For how long somebody had to wait for a processor so far; 0 where the kernel does not say."""
    pressure = Path("/proc/pressure/cpu")
    return int(re.search(r"total=(\d+)", pressure.read_text())[1]) / 1e6 if pressure.exists() else 0


class Signals(ProgramTest):
    """Stopping is timed as where nobody else is busy: what the program works, or goes by without anybody's waiting for a processor,
    and a tenth of all that goes by."""

    def stop(self, number, args, after_s, waits_for=None):
        ended_before_s = processor_s(resource.getrusage(resource.RUSAGE_CHILDREN))
        process = subprocess.Popen([PROGRAM, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if waits_for:
            while waits_for not in process.stderr.readline():
                self.assertIsNone(process.poll())
        time.sleep(after_s)
        ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        process.send_signal(number)
        begin, waited_s = time.monotonic(), waited_for_processors_s()
        out, err = process.communicate(timeout=300)
        went_by_s, waited_s = time.monotonic() - begin, waited_for_processors_s() - waited_s
        worked_s = processor_s(resource.getrusage(resource.RUSAGE_CHILDREN)) - ended_before_s - sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        return process.returncode, max(worked_s, went_by_s - waited_s, went_by_s / 10), out, err

    def assert_complete(self, folder=None):
        folder = folder or self.path
        report = json.loads((folder / "r.json").read_text())
        if report["tracking"]["tracked"] + report["tracking"]["weak"] == 0:  # nothing to put in an earlier file's place
            self.assertEqual(os.listdir(folder), ["r.json"])
            return report
        poses = [l for l in (folder / "t.txt").read_text().splitlines() if not l.startswith("#")]
        self.assertEqual(len(poses), report["tracking"]["tracked"] + report["tracking"]["weak"])
        head, _, body = (folder / "m.ply").read_bytes().partition(b"end_header\n")
        self.assertIn(f"element vertex {report['map']['voxels']}\n".encode(), head)
        self.assertEqual(len(body), 15 * report["map"]["voxels"])
        self.assertEqual(report["frames"]["offered"], report["frames"]["processed"] + sum(report["frames"]["dropped"].values()))
        return report

    def test_while_it_runs(self):
        log = endless_log(self.path / "log")
        for mode in ("realtime", "lockstep"):
            for number in (signal.SIGINT, signal.SIGTERM):
                for detector in (NO_DETECTOR, DETECTOR):
                    with self.subTest(mode=mode, signal=number, detector=detector):
                        args = run_args("--mode", mode, *self.outputs(), log=log, detector=detector)
                        code, took_s, out, err = self.stop(number, args, random.uniform(0, 0.6), "tracking_started")
                        self.assertEqual((code, out), (DONE, ""), err)
                        self.assertLess(took_s, 2)
                        self.assertGreater(self.assert_complete()["frames"]["processed"], 0)

    def test_at_random_moments(self):
        log = endless_log(self.path / "log")
        for number in range(int(os.environ.get("STILLMAP_SHUTDOWNS", "24"))):
            mode, after_s = random.choice(("realtime", "fast")), random.uniform(0, 0.8)
            with self.subTest(number=number, mode=mode, after_s=after_s):
                out = self.path / f"out{number}"
                args = run_args("--mode", mode, *self.outputs(out), log=log, detector=DETECTOR, listen=["--listen", "127.0.0.1:0"])
                code, took_s, _, err = self.stop(random.choice((signal.SIGINT, signal.SIGTERM)), args, after_s, "stream: open")
                self.assertEqual(code, DONE, err)
                self.assertLess(took_s, 2)
                self.assert_complete(out)

    def test_while_it_starts(self):
        log = endless_log(self.path / "log")
        for after_s in (0.05, 0.1, 0.2):
            out = self.path / f"after{after_s}"
            code, took_s, _, err = self.stop(signal.SIGTERM, run_args(*self.outputs(out), log=log, detector=DETECTOR), after_s)
            self.assertLess(took_s, 2)
            # Asked before it listens to signals, it ends as any process does.
            self.assertIn(code, (DONE, -signal.SIGTERM), err)
            if code == DONE:
                self.assert_complete(out)

    def test_a_second_signal_changes_nothing(self):
        log = endless_log(self.path / "log")
        process = subprocess.Popen([PROGRAM, *run_args(*self.outputs(), log=log)], stderr=subprocess.PIPE, text=True)
        while "tracking_started" not in process.stderr.readline():
            self.assertIsNone(process.poll())
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=300)
        self.assertEqual(process.returncode, DONE, err)
        self.assert_complete()


if __name__ == "__main__":
    unittest.main()
