# SPDX-License-Identifier: Apache-2.0
"""The whole program on a camera: the real OpenNI2 with the test's device, which shows the rendered log."""
import ctypes
import json
import math
import os
import re
import time
import unittest

from program import CAMERA, DONE, LOG, NO_DETECTOR, QUIET, RUN_FAILED, SOURCE, UNREADABLE_INPUT, ProgramTest, stillmap

# Slower than the stamps say, so that a machine that is busy with other things keeps up.
os.environ["STILLMAP_TEST_DEVICE_LOG"] = str(LOG)
os.environ["STILLMAP_TEST_DEVICE_PICTURES"] = "640 480 5000 100"
DEVICE = "openni2:stillmap-test-camera"


def run_camera(*args, behaviour=""):
    os.environ["STILLMAP_TEST_DEVICE"] = behaviour
    return run_source(DEVICE, *args)


def run_source(source, *args):
    return stillmap("run", *CAMERA, "--set", "camera.depth_units_per_m=1000", *NO_DETECTOR, *QUIET, "--source", source, *args)


def record_oni(file):
    """What the camera shows, recorded by the library itself through its C interface."""
    os.environ["STILLMAP_TEST_DEVICE"] = "unsynced"
    library = ctypes.CDLL("libOpenNI2.so.0")

    def call(name, *args):
        if (status := getattr(library, name)(*args)) != 0:
            raise RuntimeError(f"{name}: {status}")
    device, recorder, colour, depth = (ctypes.c_void_p() for _ in range(4))
    call("oniInitialize", 2002)  # the version of its interface
    call("oniDeviceOpen", DEVICE.removeprefix("openni2:").encode(), ctypes.byref(device))
    call("oniCreateRecorder", str(file).encode(), ctypes.byref(recorder))
    for kind, stream in ((2, colour), (3, depth)):  # as OniSensorType counts
        call("oniDeviceCreateStream", device, kind, ctypes.byref(stream))
        call("oniRecorderAttachStream", recorder, stream, False)
    call("oniRecorderStart", recorder)
    for stream in (depth, colour):
        call("oniStreamStart", stream)
    end = time.monotonic() + 10
    while file.read_bytes().count(b"NIR\0\n") < 16 and time.monotonic() < end:  # pictures; a busy machine leaves some out
        time.sleep(0.1)
    library.oniRecorderStop(recorder)
    call("oniRecorderDestroy", ctypes.byref(recorder))
    for stream in (depth, colour):
        library.oniStreamDestroy(stream)
    call("oniDeviceClose", device)
    library.oniShutdown()


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

    def test_a_recording_plays_alike_in_every_mode_and_a_damaged_one_as_far_as_it_is_whole(self):
        file = self.path / "room.oni"
        record_oni(file)
        counts = []
        for mode in ("lockstep", "fast"):
            result = run_source(f"openni2:{file}", "--mode", mode, *self.outputs())
            self.assertEqual(result.returncode, DONE, result.stderr)
            report = json.loads((self.path / "r.json").read_text())
            heap = report["memory"]["heap_allocations_after_start"]
            self.assertEqual((heap["capture"], heap["track"], heap["map"]), (0, 0, 0), mode)
            counts.append({"offered": report["frames"]["offered"], "lost": report["tracking"]["lost"]})
        self.assertGreater(counts[0]["offered"], 2)
        self.assertEqual(counts, [{"offered": counts[0]["offered"], "lost": 0}] * 2)

        damaged = bytearray(file.read_bytes())
        begin, end = len(damaged) // 5, len(damaged) // 3
        damaged[begin:end] = bytes(end - begin)
        file.write_bytes(damaged)
        result = run_source(f"openni2:{file}", "--mode", "fast", *self.outputs())
        self.assert_error(result, UNREADABLE_INPUT, str(file), "is damaged and plays so far only", "record it anew")
        self.assertGreater(json.loads((self.path / "r.json").read_text())["frames"]["processed"], 0, "outputs are complete all the same")
        file.write_bytes(damaged[:begin])
        self.assert_error(run_source(f"openni2:{file}"), UNREADABLE_INPUT, str(file), "no recording that was brought to its end")

    def test_without_a_profile_the_lens_is_what_the_camera_tells(self):
        os.environ["STILLMAP_TEST_DEVICE"] = ""
        result = stillmap("run", "--source", DEVICE, "--duration", "0.3", "--record", self.path / "log", *NO_DETECTOR, *QUIET)
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertIn("as the camera tells it (fx 512, fy 512 px)", result.stderr)
        self.assertRegex((self.path / "log/camera.toml").read_text(), r"camera\.fx = 51[12]\.")
        os.environ["STILLMAP_TEST_DEVICE"] = "lensless"
        board = SOURCE / "firmware-config/boards/two-core.toml"  # says nothing of the camera
        result = stillmap("run", "--config", board, "--source", DEVICE, "--duration", "0.3", *NO_DETECTOR, *QUIET)
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
