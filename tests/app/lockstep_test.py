# SPDX-License-Identifier: Apache-2.0
"""Two lockstep runs are equal byte for byte, apart from what the contract names."""
import json
import unittest

from program import DETECTOR, DONE, FRAMES, GROUNDTRUTH, NO_DETECTOR, ProgramTest, run_args, stillmap

# latency, cpu, wall, throughput, start time, rss (with what the system had to read back) and stream.
OF_THIS_RUN = {"latency_ms", "throughput_fps", "cpu_s", "cpu_decode_s", "wall_s", "start_to_first_pose_ms", "rss_start_kb",
               "rss_end_kb", "rss_peak_kb", "major_faults", "stream"}


def without_times(value):
    if not isinstance(value, dict):
        return value
    return {k: without_times(v) for k, v in value.items() if k not in OF_THIS_RUN}


class Lockstep(ProgramTest):
    def run_once(self, name, *args, detector=DETECTOR):
        outputs = self.outputs(self.path / name)
        result = stillmap(*run_args("--mode", "lockstep", "--groundtruth", GROUNDTRUTH, *outputs, *args, detector=detector))
        self.assertEqual(result.returncode, DONE, result.stderr)
        files = dict(zip(outputs[::2], (p.read_bytes() for p in outputs[1::2])))
        return files, json.loads(files.pop("--report"))

    def assert_same_twice(self, *args, detector=DETECTOR):
        (files, report), (files_again, report_again) = (self.run_once(n, *args, detector=detector) for n in ("a", "b"))
        self.assertEqual(files, files_again)
        self.assertEqual(without_times(report), without_times(report_again))
        self.assertEqual(report["frames"], {"offered": FRAMES, "processed": FRAMES, "dropped": {}})
        self.assertEqual(len(files["--trajectory"].splitlines()), 2 + report["tracking"]["tracked"] + report["tracking"]["weak"])
        return files, report

    def test_with_the_detector(self):
        _, report = self.assert_same_twice("--detector-delay", "0", "--detector-every", "1")
        self.assertEqual(report["detector"]["runs"], FRAMES)
        self.assertEqual(report["detector"]["frames_with_fresh_boxes"], FRAMES)
        self.assertLess(report["accuracy"]["ate_rmse_m"], 0.05)

    def test_as_measured_live(self):
        _, report = self.assert_same_twice()
        self.assertEqual(report["detector"]["runs"], FRAMES)
        self.assertEqual(report["detector"]["frames_without_boxes"], 1)
        self.assertLess(report["accuracy"]["ate_rmse_m"], 0.05)

    def test_with_a_detector_that_is_late_and_seldom(self):
        _, report = self.assert_same_twice("--detector-delay", "5", "--detector-every", "3")
        self.assertEqual(report["detector"]["runs"], FRAMES // 3)
        self.assertGreater(report["map"]["frames_fused_with_own_boxes"], 0)

    def test_without_a_detector(self):
        files, report = self.assert_same_twice(detector=NO_DETECTOR)
        self.assertEqual(report["detector"]["runs"], 0)
        self.assertEqual(report["detector"]["model"], "none")
        # With another seed another draw is allowed, the run is not another.
        _, seeded = self.run_once("c", "--set", "runtime.seed=2", detector=NO_DETECTOR)
        self.assertEqual(seeded["seed"], 2)
        self.assertEqual(seeded["frames"], report["frames"])
        self.assertNotEqual(seeded["config_sha256"], report["config_sha256"])


if __name__ == "__main__":
    unittest.main()
