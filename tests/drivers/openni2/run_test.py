# SPDX-License-Identifier: Apache-2.0
"""The whole program on a camera: the real OpenNI2 with the test's device, which shows the rendered log."""
import json
import math
import os
import re
import unittest

from program import CAMERA, DONE, LOG, NO_DETECTOR, QUIET, RUN_FAILED, ProgramTest, stillmap

# Slower than the stamps say, so that a machine that is busy with other things keeps up.
os.environ["STILLMAP_TEST_DEVICE_LOG"] = str(LOG)
os.environ["STILLMAP_TEST_DEVICE_PICTURES"] = "640 480 5000 100"
DEVICE = "openni2:stillmap-test-camera"


def run_camera(*args, behaviour=""):
    os.environ["STILLMAP_TEST_DEVICE"] = behaviour
    return stillmap("run", *CAMERA, "--set", "camera.depth_units_per_m=1000", *NO_DETECTOR, *QUIET, "--source", DEVICE, *args)


def poses(path):
    lines = (l.split() for l in path.read_text().splitlines() if not l.startswith("#"))
    return {stamp: tuple(map(float, place)) for stamp, *place in lines}


class Camera(ProgramTest):
    def test_a_run_tracks_maps_reports_and_its_recording_replays(self):
        log = self.path / "log"
        # The disk's buffer has room for all that the camera shows.
        result = run_camera("--duration", "1", "--record", log, "--set", "record.colour=png", "--set", "record.buffer_frames=32",
                            "--set", "memory.budget_mb=400", *self.outputs())
        self.assertEqual(result.returncode, DONE, result.stderr)
        report = json.loads((self.path / "r.json").read_text())
        frames, heap = report["frames"], report["memory"]["heap_allocations_after_start"]
        self.assertEqual((report["mode"], report["source"]), ("live", DEVICE))
        self.assertEqual(frames["offered"], frames["processed"] + sum(frames["dropped"].values()))
        self.assertGreater(frames["processed"], 5)
        self.assertEqual((report["tracking"]["lost"], report["tracking"]["segments"]), (0, 1))
        self.assertGreater(report["map"]["voxels"], 5000)
        self.assertGreater(report["capture"]["cpu_ms_per_frame"], 0)
        # The library's and the device's threads are told apart.
        self.assertGreater(heap["driver"], 0)
        self.assertEqual((heap["capture"], heap["track"], heap["map"]), (0, 0, 0))

        # What was seen live is what a replay of the recording sees, from the same places.
        live = poses(self.path / "t.txt")
        self.assertEqual(len(live), frames["processed"])
        again = stillmap("run", "--config", log / "camera.toml", *NO_DETECTOR, *QUIET, "--source", f"tum:{log}", "--mode", "lockstep",
                         *self.outputs(self.path / "again"))
        self.assertEqual(again.returncode, DONE, again.stderr)
        replay = json.loads((self.path / "again/r.json").read_text())
        self.assertEqual(report["record"]["failed"], 0)
        self.assertEqual((replay["frames"]["processed"], replay["frames"]["dropped"]), (report["record"]["frames"], {}))
        replayed = poses(self.path / "again/t.txt")
        both = live.keys() & replayed.keys()
        self.assertGreaterEqual(len(both), len(live) - report["record"]["left_out"], "a busy machine may leave some out")
        for stamp in both:
            self.assertLess(math.dist(live[stamp][:3], replayed[stamp][:3]), 0.05, stamp)

    def test_without_a_profile_the_lens_is_what_the_camera_tells(self):
        os.environ["STILLMAP_TEST_DEVICE"] = ""
        result = stillmap("run", "--source", DEVICE, "--duration", "0.3", "--record", self.path / "log", *NO_DETECTOR, *QUIET)
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertIn("as the camera tells it (fx 512, fy 512 px)", result.stderr)
        self.assertRegex((self.path / "log/camera.toml").read_text(), r"camera\.fx = 51[12]\.")
        os.environ["STILLMAP_TEST_DEVICE"] = "lensless"
        result = stillmap("run", "--source", DEVICE, "--duration", "0.3", *NO_DETECTOR, *QUIET)
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertIn("the camera tells nothing of its lens: a nominal one is assumed", result.stderr)

    def test_a_camera_that_is_pulled_out_and_comes_back_is_followed_on(self):
        result = run_camera("--duration", "2", *self.outputs(), behaviour="unplug")
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertRegex(result.stderr, re.compile("source_gone.*source_back", re.S))
        report = json.loads((self.path / "r.json").read_text())
        self.assertGreater(report["frames"]["processed"], 5, "more than the five before it was pulled out")

    def test_a_camera_that_falls_silent_for_good_ends_the_run(self):
        result = run_camera("--set", "camera.stall_s=1", "--set", "camera.give_up_s=0", *self.outputs(), behaviour="dies")
        self.assert_error(result, RUN_FAILED, DEVICE, "the source is gone")
        self.assertIn("source_stalled", result.stderr)
        self.assertGreater(json.loads((self.path / "r.json").read_text())["frames"]["processed"], 0, "outputs are complete all the same")


if __name__ == "__main__":
    unittest.main()
