# SPDX-License-Identifier: Apache-2.0
"""evaluate.py on a program that only pretends: what it runs, which figures it prints, which trajectory it draws."""
import json
import os
import stat
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
sys.path.insert(0, str(SCRIPTS))
import evaluate  # noqa: E402

# Stands for stillmap. ATE is 1 cm times the seed, ten times as much without rejection; seed 3 of paper fails where asked.
PRETEND = '''#!{python}
import json, os, pathlib, sys
words = sys.argv[1:]
if words[0] == "eval":
    print(json.dumps({{"ate_rmse_m": float(pathlib.Path(words[words.index("--estimate") + 1]).read_text())}}))
    sys.exit()
value = lambda name: words[words.index(name) + 1]
settings = dict(word.split("=", 1) for word, before in zip(words[1:], words) if before == "--set")
rule, seed = settings["track.dynamic_rule"], int(settings["runtime.seed"])
with open(pathlib.Path(sys.argv[0]).with_name("calls.txt"), "a") as calls:
    print(json.dumps(words), file=calls)
if (rule, seed) == ("paper", 3) and os.environ.get("PRETEND") == "fail":
    print("warning: slow", "stillmap: no such model; fetch one", sep="\\n", file=sys.stderr)
    sys.exit(3)
error = 0.01 * seed * (10 if rule == "off" else 1)
report = {{"throughput_fps": 30.0 + seed, "frames": {{"offered": 40}}, "detector": {{"model": "models/net.onnx"}},
          "tracking": {{"tracked": 40 - seed, "weak": seed, "lost": 0}},
          "latency_ms": {{"track_cpu": {{"p50": seed, "p99": 10 * seed}}}},
          "accuracy": {{"ate_rmse_m": error, "rpe_1s_rmse_m": error / 2, "rpe_1s_rmse_deg": seed, "coverage": 1 - seed / 100,
                       "share_in_90_percent_ellipsoid_1s": 0.9 + seed / 100}}}}
if (rule, seed) == ("paper", 3) and os.environ.get("PRETEND") == "lost":
    del report["accuracy"]
pathlib.Path(value("--report")).write_text(json.dumps(report))
truth = pathlib.Path(value("--groundtruth")).read_text()
pathlib.Path(value("--trajectory-final")).write_text(str(error / 4))
pathlib.Path(value("--trajectory")).write_text(f"# {{rule}} {{seed}}\\n" + truth)
'''


class EvaluateTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        program = self.path / "stillmap"
        program.write_text(PRETEND.replace("{python}", sys.executable).replace("{{", "{").replace("}}", "}"))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)

    def log(self, name):
        folder = self.path / name
        folder.mkdir()
        t = np.arange(0, 2, 0.1)
        np.savetxt(folder / "groundtruth.txt", np.stack([t, t, t * t, t ** 3] + [0 * t] * 3 + [0 * t + 1], 1))
        return folder

    def evaluate(self, *words, code=0, pretend=""):
        result = subprocess.run([sys.executable, "-B", SCRIPTS / "evaluate.py", *words, "--bin", self.path, "--out", self.path / "out"],
                                capture_output=True, text=True, check=False, env=os.environ | {"PRETEND": pretend})
        self.assertEqual(result.returncode, code, result.stderr)
        if code != 0:
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        return result.stderr if code else result.stdout

    def calls(self):
        return [" ".join(json.loads(line)) for line in (self.path / "calls.txt").read_text().splitlines()]

    def test_medians_and_worst_of_the_seeds_for_each_rule(self):
        words = self.evaluate(self.log("rgbd_dataset_freiburg3_walking_xyz"), "--seeds", "3", "--model", "x.onnx", "--detector-every", "2")
        self.assertIn("\nfr3_walking_xyz: 40 frames, 3 seeds, detector net.onnx --detector-every 2\n", words)
        self.assertIn("published ATE RMSE: ORB-SLAM3 0.162 m, seed paper (YOLOv5 + ORB-SLAM3) 0.0144 m", words)
        rows = [line.split() for line in words.splitlines()]
        rest = ["2.00", "3.00", "38", "2", "0", "0.970", "0.92", "32.0", "2.0", "20.0"]
        for rule, *figures in (("silhouette", "0.0200", "0.0300", "0.0050", "0.0075", "0.0100", "0.0150"),
                               ("paper", "0.0200", "0.0300", "0.0050", "0.0075", "0.0100", "0.0150"),
                               ("off", "0.2000", "0.3000", "0.0500", "0.0750", "0.1000", "0.1500")):
            self.assertIn([f"{rule},", "lockstep", *figures, *rest], rows)
            drawn = (self.path / "out/fr3_walking_xyz" / f"{rule}-lockstep.txt").read_text()
            self.assertTrue(drawn.startswith(f"# {rule} 2\n"), "the trajectory of the median seed")
        self.assertTrue((self.path / "out/fr3_walking_xyz/trajectories.png").read_bytes().startswith(b"\x89PNG"))

        calls = self.calls()
        runs = [f"track.dynamic_rule={rule} --set runtime.seed={seed} " for rule in evaluate.RULES for seed in (1, 2, 3)]
        self.assertEqual([[run in call for call in calls].count(True) for run in runs], [1] * len(calls))
        for call in calls:
            for part in ("--mode lockstep", "detector.model=x.onnx", "--detector-every 2", "cameras/tum-fr3.toml"):
                self.assertIn(part, call)

    def test_modes_and_starts(self):
        log = self.log("fr1_rpy")
        (log / "rgb").mkdir()
        (log / "rgb.txt").write_text("# colour\n1.0 rgb/1.png\n1.1 rgb/2.png\n1.2 rgb/3.png\n")
        words = self.evaluate(log, "--seeds", "1", "--rules", "paper", "--modes", "lockstep,realtime", "--starts", "0,2")
        self.assertIn("40 frames, begun 0, 2 frames late, 1 seeds", words)
        late = self.path / "out/fr1_rpy/from-2"
        self.assertEqual([call.split("--source ")[1].split()[0] for call in self.calls()], 2 * [f"tum:{log}", f"tum:{late}"])
        self.assertEqual([call.split("--mode ")[1].split()[0] for call in self.calls()], ["lockstep"] * 2 + ["realtime"] * 2)
        self.assertEqual((late / "rgb.txt").read_text(), "1.2 rgb/3.png\n")
        self.assertEqual((late / "rgb").resolve(), log / "rgb")
        for wrong in (("--modes", "live"), ("--rules", "paper,none"), ("--starts", "-1"), ("--starts", "x")):
            result = subprocess.run([sys.executable, "-B", SCRIPTS / "evaluate.py", log, *wrong], capture_output=True, text=True, check=False)
            self.assertEqual(result.returncode, 2)
            self.assertIn(wrong[0], result.stderr.splitlines()[-1])
        self.assertIn("lockstep alone", self.evaluate(log, "--modes", "realtime", "--detector-delay", "5", code=1))

    def test_the_camera_goes_by_the_logs_name_unless_it_is_given(self):
        for name, camera in (("fr1_rpy_walkers", "tum-fr1"), ("rgbd_dataset_freiburg3_sitting_xyz", "tum-fr3"), ("office_walk", "hololens-540x360")):
            path = evaluate.camera_of(Path("data") / name, None)
            self.assertEqual(path.name, camera + ".toml")
            self.assertTrue(path.is_file())
        self.assertEqual(evaluate.camera_of(Path("mine"), Path("my.toml")), Path("my.toml"))

    def test_what_cannot_be_evaluated_is_named_before_anything_runs(self):
        good = self.log("fr1_rpy")
        (self.path / "empty").mkdir()
        for words, expected in (((good, self.path / "empty"), "empty holds no groundtruth.txt"), ((good, self.log("kitchen")), "--camera FILE")):
            self.assertIn(expected, self.evaluate(*words, code=1))
        self.assertFalse((self.path / "calls.txt").exists())

    def test_a_run_that_fails_or_has_no_accuracy_ends_it_with_its_last_word(self):
        log = self.log("fr1_rpy")
        self.assertRegex(self.evaluate(log, "--seeds", "3", code=1, pretend="fail"), r"no such model; fetch one \(exit code 3 of: ")
        self.assertIn("paper-lockstep-0-3", self.evaluate(log, "--seeds", "3", code=1, pretend="lost"))


if __name__ == "__main__":
    unittest.main()
