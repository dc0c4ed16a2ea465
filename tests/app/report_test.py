# SPDX-License-Identifier: Apache-2.0
"""The report has every key that the contract names, each with its type."""
import json
import re
import unittest

from program import DETECTOR, DONE, FRAMES, GROUNDTRUTH, MODEL, LOG, NO_DETECTOR, ProgramTest, run_args, stillmap

COUNT, NUMBER, TEXT = "count", "number", "text"
QUANTILES = {"p50": NUMBER, "p95": NUMBER, "p99": NUMBER, "max": NUMBER}
POOL = {"capacity": COUNT, "high_water": COUNT, "refused": COUNT}
KEYS = {
    "version": COUNT, "mode": TEXT, "source": TEXT, "seed": COUNT, "git_revision": TEXT, "config_sha256": TEXT, "model_sha256": TEXT,
    "frames": {"offered": COUNT, "processed": COUNT, "dropped": {}},
    "tracking": {"initializing": COUNT, "tracked": COUNT, "weak": COUNT, "lost": COUNT, "relocalized": COUNT, "segments": COUNT, "keyframes": COUNT,
                 "corrections": COUNT, "features": {"static": COUNT, "dynamic": COUNT, "semi_static": COUNT, "unknown": COUNT}},
    "latency_ms": {k: QUANTILES for k in ("capture_to_pose", "decode", "track", "track_cpu", "detect", "fuse", "fuse_cpu")},
    "throughput_fps": NUMBER, "cpu_s": NUMBER, "cpu_decode_s": NUMBER, "wall_s": NUMBER, "start_to_first_pose_ms": NUMBER,
    "detector": {"model": TEXT, "runs": COUNT, "latency_ms": QUANTILES, "frames_with_fresh_boxes": COUNT,
                 "frames_with_carried_boxes": COUNT, "frames_without_boxes": COUNT},
    "memory": {"planned_bytes": COUNT, "rss_start_kb": COUNT, "rss_end_kb": COUNT, "major_faults": COUNT, "rss_peak_kb": COUNT,
               "heap_allocations_after_start": {k: COUNT for k in ("capture", "track", "map", "stream", "detect", "driver")},
               "pools": {k: POOL for k in ("frames", "points", "keyframes", "map_blocks")}},
    "shedding": {"steps": COUNT, "frames_shed": COUNT},
    "map": {"voxels": COUNT, "blocks_used": COUNT, "blocks_capacity": COUNT, "blocks_evicted": COUNT, "blocks_kept": COUNT, "blocks_lost": COUNT, "voxel_m": NUMBER,
            "point_reduction": NUMBER},
    "stream": {"clients_peak": COUNT, "bytes_sent": COUNT, "messages_dropped": COUNT},
}
ACCURACY = {"ate_rmse_m": NUMBER, "ate_max_m": NUMBER, "rpe_1s_rmse_m": NUMBER, "rpe_1s_rmse_deg": NUMBER,
            "rpe_frame_rmse_m": NUMBER, "matched_poses": COUNT, "coverage": NUMBER}


class Report(ProgramTest):
    def report(self, *args, detector=NO_DETECTOR):
        file = self.path / "r.json"
        result = stillmap(*run_args("--report", file, *args, detector=detector))
        self.assertEqual(result.returncode, DONE, result.stderr)
        return json.loads(file.read_text())

    def assert_keys(self, found, expected, where=""):
        for key, kind in expected.items():
            at = f"{where}.{key}"
            self.assertIn(key, found, at)
            value = found[key]
            if isinstance(kind, dict):
                self.assertIsInstance(value, dict, at)
                self.assert_keys(value, kind, at)
            elif kind == TEXT:
                self.assertIsInstance(value, str, at)
            else:
                self.assertIn(type(value), (int,) if kind == COUNT else (int, float), at)
                self.assertGreaterEqual(value, 0, at)

    def assert_accounted(self, r):
        self.assertEqual(r["frames"]["offered"], FRAMES)
        self.assertEqual(r["frames"]["offered"], r["frames"]["processed"] + sum(r["frames"]["dropped"].values()))
        boxes = r["detector"]
        with_boxes = sum(boxes[f"frames_{k}"] for k in ("with_fresh_boxes", "with_carried_boxes", "without_boxes"))
        self.assertEqual(with_boxes, r["frames"]["processed"])

    def test_lockstep_with_detector_and_ground_truth(self):
        r = self.report("--groundtruth", GROUNDTRUTH, "--mode", "lockstep", detector=DETECTOR)
        self.assert_keys(r, {**KEYS, "accuracy": ACCURACY})
        self.assertEqual((r["version"], r["mode"], r["source"]), (1, "lockstep", f"tum:{LOG}"))
        self.assertEqual(r["detector"]["model"], str(MODEL))
        for key in ("config_sha256", "model_sha256"):
            self.assertRegex(r[key], "^[0-9a-f]{64}$")
        self.assert_accounted(r)
        self.assertNotIn("note", r["accuracy"])

    def test_realtime_with_detector_and_ground_truth(self):
        r = self.report("--groundtruth", GROUNDTRUTH, "--mode", "realtime", detector=DETECTOR)
        self.assert_keys(r, KEYS)
        self.assertEqual(r["mode"], "realtime")
        self.assert_accounted(r)
        self.assertGreaterEqual(r["wall_s"], (FRAMES - 1) / 30)
        # A machine that is busy enough leaves too few poses for an error.
        accuracy = r.get("accuracy", {"coverage": 1})
        self.assertEqual("note" in accuracy, accuracy["coverage"] < 0.99)

    def test_lockstep_without_either(self):
        r = self.report("--mode", "lockstep")
        self.assert_keys(r, KEYS)
        self.assertNotIn("accuracy", r)
        self.assertEqual((r["mode"], r["model_sha256"], r["detector"]["model"]), ("lockstep", "", "none"))
        self.assertEqual(r["memory"]["heap_allocations_after_start"]["capture"], 0)
        self.assertEqual(r["memory"]["heap_allocations_after_start"]["track"], 0)
        self.assertEqual(r["memory"]["heap_allocations_after_start"]["map"], 0)

    def test_figures_are_no_noise_of_rounding(self):
        file = self.path / "r.json"
        self.assertEqual(stillmap(*run_args("--report", file)).returncode, DONE)
        for number in re.findall(r'"(?:p50|p95|p99|max|throughput_fps|cpu_s|wall_s)": ([\d.]+)', file.read_text()):
            self.assertLessEqual(len(number.partition(".")[2]), 3, number)


if __name__ == "__main__":
    unittest.main()
