# SPDX-License-Identifier: Apache-2.0
"""ci_gates.py: what it compares and counts, and that each bound that is broken fails, on a program that only pretends."""
import copy
import io
import json
import os
import stat
import subprocess
import sys
import tempfile
import unittest
from contextlib import redirect_stdout
from pathlib import Path
from unittest import mock

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
sys.path.insert(0, str(SCRIPTS))
import ci_gates  # noqa: E402

GOOD = {
    "frames": {"offered": 180, "processed": 180, "dropped": {}},
    "latency_ms": {"track": {"p50": 1.0}}, "detector": {"runs": 180, "latency_ms": {"p50": 1.0}}, "cpu_s": 5.0, "cpu_decode_s": 1.0,
    "wall_s": 6.0, "throughput_fps": 30.0, "start_to_first_pose_ms": 100.0, "stream": {"bytes_sent": 1}, "map": {"voxels": 10},
    "memory": {"rss_start_kb": 1, "rss_end_kb": 2, "rss_peak_kb": 2, "planned_bytes": 3,
               "heap_allocations_after_start": {"capture": 0, "track": 0, "map": 0, "stream": 0, "detect": 9, "driver": 0}},
    "accuracy": {"ate_rmse_m": 0.003, "coverage": 1.0},
}
# Stands for stillmap and stillmap-synth: writes what pretend.json beside it says for the run.
PRETEND = '''#!{python}
import json, pathlib, sys
words = sys.argv[1:]
value = lambda name: pathlib.Path(words[words.index(name) + 1])
stamps = ["%.6f" % (1000 + i / 30) for i in range(180)]
if sys.argv[0].endswith("synth"):
    value("--out").mkdir(parents=True)
    (value("--out") / "groundtruth.txt").write_text("")
    (value("--out") / "rgb.txt").write_text("# colour\\n" + "".join(s + " rgb/" + s + ".jpg\\n" for s in stamps))
else:
    name = value("--report").parent.name
    runs = json.loads((pathlib.Path(sys.argv[0]).parent / "pretend.json").read_text())
    value("--report").write_text(json.dumps(runs[name]["report"]))
    value("--map").write_text(runs[name].get("map", "map"))
    kept = stamps[:len(stamps) - runs[name].get("last_frames_without_pose", 0)]
    value("--trajectory").write_text("# header\\n" + "".join(s.rstrip("0") + " 0 0 0 0 0 0 1\\n" for s in kept))
'''


class CiGatesTest(unittest.TestCase):
    def gates(self, change=lambda runs: None):
        """Exit code and words of the script where the program's runs are good ones but for `change`."""
        names = ("lockstep-1", "lockstep-2", "off", "realtime-1", "realtime-2", "realtime-3")
        runs = {name: {"report": copy.deepcopy(GOOD)} for name in names}
        runs["off"]["report"]["accuracy"]["ate_rmse_m"] = 0.07
        change(runs)
        with tempfile.TemporaryDirectory() as folder:
            for name in ("stillmap", "stillmap-synth"):
                path = Path(folder) / name
                path.write_text(PRETEND.replace("{python}", sys.executable))
                path.chmod(path.stat().st_mode | stat.S_IXUSR)
            (Path(folder) / "pretend.json").write_text(json.dumps(runs))
            result = subprocess.run([sys.executable, "-B", SCRIPTS / "ci_gates.py", "--bin", folder, "--out", Path(folder) / "out"],
                                    capture_output=True, text=True, check=False)
        self.assertEqual(result.stderr, "")
        return result.returncode, result.stdout

    def test_good_runs_pass(self):
        code, words = self.gates()
        self.assertEqual(code, 0, words)
        self.assertRegex(words.splitlines()[-1], r"^13 passed, 0 failed$")

    def test_each_bound_fails(self):
        def report(*path, value, names=("lockstep-1", "lockstep-2")):
            def change(runs):
                for name in names:
                    part = runs[name]["report"]
                    for key in path[:-1]:
                        part = part[key]
                    part[path[-1]] = value
            return change
        realtime = ("realtime-1", "realtime-2", "realtime-3")
        for expected, change in (
            ("lockstep: ATE: 0.007", report("accuracy", "ate_rmse_m", value=0.007)),
            ("lockstep: coverage", report("accuracy", "coverage", value=0.99)),
            ("lockstep: no frame dropped", report("frames", "dropped", value={"corrupt": 1})),
            ("lockstep: processor time", report("cpu_s", value=13.0)),
            ("lockstep: no heap allocation", report("memory", "heap_allocations_after_start", "map", value=1)),
            ("lockstep: ATE over that without", report("accuracy", "ate_rmse_m", value=0.005, names=("off",))),
            ("two runs report the same map.voxels 10 / 11", report("map", "voxels", value=11, names=("lockstep-2",))),
            ("two runs write the same map.ply", lambda runs: runs["lockstep-2"].update(map="other")),
            ("two runs write the same trajectory.txt", lambda runs: runs["lockstep-2"].update(last_frames_without_pose=1)),
            ("realtime: ATE", report("accuracy", "ate_rmse_m", value=0.02, names=realtime)),
            ("realtime: each frame is accounted", report("frames", "processed", value=179, names=realtime)),
            ("realtime: no heap allocation", report("memory", "heap_allocations_after_start", "track", value=1, names=realtime)),
        ):
            with self.subTest(expected=expected):
                code, words = self.gates(change)
                failed = [line for line in words.splitlines() if line.startswith("FAILED")]
                self.assertEqual((code, len(failed)), (1, 1), words)
                self.assertIn(expected, failed[0])
                self.assertRegex(words.splitlines()[-1], r"^12 passed, 1 failed$")

    def test_drops_fail_but_not_on_a_busy_machine(self):
        def drop(runs):
            for name in ("realtime-1", "realtime-2", "realtime-3"):
                runs[name]["last_frames_without_pose"] = 30
        code, words = self.gates(drop)
        last = words.splitlines()[-2]
        if last.startswith("skipped"):
            self.assertIn("20.0%", last)
            self.assertRegex(words.splitlines()[-1], r"^11 passed, 0 failed, 1 skipped$")
            self.assertEqual(code, 0)
        else:
            self.assertTrue(last.startswith("FAILED  realtime: frames without a pose after the first second: 20 %"), last)
            self.assertEqual(code, 1)

    def test_a_run_that_shares_its_cores_is_told_from_one_that_has_them(self):
        # Of two cores in 10 s this run took 8 s; then nobody, or others, had the other 12.
        with mock.patch.object(ci_gates.time, "monotonic", side_effect=[0, 10] * 2):
            for others_s, expected in ((0, 1), (5, 0.75)):
                with mock.patch.object(ci_gates, "children_s", side_effect=[2, 10]), \
                        mock.patch.object(ci_gates, "idle_s", side_effect=[100, 112 - others_s]):
                    self.assertEqual(ci_gates.with_share(lambda: "report"), ("report", expected))
        self.assertGreater(ci_gates.idle_s(), 0)

    def test_drops_are_judged_where_one_run_had_its_cores(self):
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder)
            (log / "rgb.txt").write_text("".join(f"{i / 30:.6f} rgb/{i}.png\n" for i in range(180)))
            for attempt, poses in ((1, 100), (2, 120), (3, 90)):
                (log / f"realtime-{attempt}").mkdir()
                (log / f"realtime-{attempt}/trajectory.txt").write_text("".join(f"{i / 30:.6f} 0 0 0 0 0 0 1\n" for i in range(poses)))
            for shares, busy, judged in (((0.5, 0.9, 0.6), 1, False), ((1, 1, 1), 0.5, False), ((0.5, 0.9, 0.99), 0.95, True)):
                with mock.patch.object(ci_gates, "with_share", side_effect=[(GOOD, share) for share in shares]), \
                        mock.patch.object(ci_gates, "share_of_busy", return_value=busy), redirect_stdout(io.StringIO()):
                    gates = ci_gates.Gates()
                    ci_gates.gate_realtime(gates, None, log, log)
                self.assertEqual((gates.passed, gates.failed, gates.skipped), (3, 1, 0) if judged else (2, 0, 1))

    def test_a_better_attempt_counts(self):
        code, words = self.gates(lambda runs: runs["realtime-1"].update(last_frames_without_pose=30))
        self.assertEqual(code, 0, words)
        self.assertIn("after the first second: 0 %", words)

    def test_volatile_keys_are_the_contracts(self):
        other = copy.deepcopy(GOOD)
        other["memory"]["major_faults"] = 7
        other["cpu_s"], other["memory"]["rss_peak_kb"], other["detector"]["latency_ms"], other["stream"] = 1, 1, {}, {}
        self.assertEqual(ci_gates.differences(ci_gates.stable(GOOD), ci_gates.stable(other)), [])
        other["memory"]["planned_bytes"] = 4
        self.assertEqual(ci_gates.differences(ci_gates.stable(GOOD), ci_gates.stable(other)), ["memory.planned_bytes 3 / 4"])


if __name__ == "__main__":
    unittest.main()
