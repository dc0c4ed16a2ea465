# SPDX-License-Identifier: Apache-2.0
"""A run that goes on in the map of an earlier one."""
import json
import re
import signal
import unittest

import numpy as np
from program import DONE, LOG, NO_DETECTOR, UNREADABLE_INPUT, WRONG_CONFIG, run_args, stillmap
from running import RunningTest


def trajectory(path):
    return {row[0]: row[1:] for row in np.loadtxt(path, ndmin=2)}


class Resume(RunningTest):
    def setUp(self):
        super().setUp()
        self.map, self.first = self.path / "room.stillmap", self.path / "first.txt"
        result = stillmap(*run_args("--mode", "lockstep", "--map", self.map, "--trajectory", self.first))
        self.assertEqual(result.returncode, DONE, result.stderr)

    def second_half(self):
        """The log from its middle on: a run of its own would begin its frame there."""
        folder = self.path / "half"
        folder.mkdir()
        for kind in ("rgb", "depth"):
            (folder / kind).symlink_to(LOG / kind)
        lines = [l for l in (LOG / "associations.txt").read_text().splitlines() if not l.startswith("#")]
        (folder / "associations.txt").write_text("\n".join(lines[len(lines) // 2:]) + "\n")
        return folder

    def test_goes_on_in_the_earlier_frame_and_map(self):
        poses, report, again = self.path / "second.txt", self.path / "r.json", self.path / "again.stillmap"
        result = stillmap(*run_args("--mode", "lockstep", "--resume", self.map, "--map", again, "--trajectory", poses, "--report", report,
                                    log=self.second_half()))
        self.assertEqual(result.returncode, DONE, result.stderr)
        tracking = json.loads(report.read_text())["tracking"]
        self.assertEqual((tracking["relocalized"], tracking["segments"], tracking["lost"]), (1, 0, 0))
        first, second = trajectory(self.first), trajectory(poses)
        self.assertGreaterEqual(len(second), 20)
        start = first[min(second)][:3]
        self.assertGreater(np.linalg.norm(start), 0.05, "the half log begins where the whole one does not")
        for stamp, pose in second.items():
            self.assertLess(np.linalg.norm(pose[:3] - first[stamp][:3]), 0.02)
            self.assertGreater(abs(np.dot(pose[3:], first[stamp][3:])), np.cos(np.radians(1) / 2))
        before, after = (stillmap("map", "info", file).stdout for file in (self.map, again))
        blocks, more = (int(re.search(r"blocks +(\d+)", text).group(1)) for text in (before, after))
        self.assertGreaterEqual(more, blocks)
        self.assertLess(more, 1.1 * blocks)
        self.assertGreater(int(re.search(r"keyframes +(\d+) with", before).group(1)), 2)

    def test_a_killed_or_aborted_runs_checkpoint_is_enough(self):
        report, recorder = self.path / "r.json", self.path / "flight.jsonl"
        for number in (signal.SIGKILL, signal.SIGABRT):
            file = self.path / f"{number.name}.stillmap"
            process = self.start("--map", file, "--resume", file, "--set", "map.checkpoint_s=0.5", "--set", f"runtime.flight_recorder={recorder}", detector=NO_DETECTOR)
            self.wait_for_mapped(file)
            process.send_signal(number)
            self.assertEqual(process.wait(), -number)
            self.assertEqual(recorder.exists(), number == signal.SIGABRT)
            result = stillmap(*run_args("--mode", "lockstep", "--resume", file, "--map", file, "--report", report))
            self.assertEqual(result.returncode, DONE, result.stderr)
            tracking = json.loads(report.read_text())["tracking"]
            self.assertEqual((tracking["relocalized"], tracking["lost"]), (1, 0))

    def test_begins_its_own_map_where_there_is_none(self):
        own, other = self.path / "own.stillmap", self.path / "none.stillmap"
        for said in ("a new map begins", "relocalized"):
            result = stillmap(*run_args("--mode", "lockstep", "--map", own, "--resume", own))
            self.assertEqual(result.returncode, DONE, result.stderr)
            self.assertIn(said, result.stderr)
        self.assert_error(stillmap(*run_args("--mode", "lockstep", "--map", own, "--resume", other)), UNREADABLE_INPUT, str(other))

    def test_what_does_not_fit_is_refused_and_nothing_overwritten(self):
        whole, out = self.map.read_bytes(), self.path / "out.stillmap"
        out.write_text("earlier")
        for bytes_, word in ((whole[:-1000], "cut off"), (whole[:999] + b"x" + whole[1000:], "damaged"), (b"ply\n" * 50, "no Stillmap map")):
            other = self.path / "other.stillmap"
            other.write_bytes(bytes_)
            self.assert_error(stillmap(*run_args("--mode", "lockstep", "--resume", other, "--map", out)), UNREADABLE_INPUT, str(other), word)
        for setting, word in (("camera.fx=400", "another camera calibration"), ("map.voxel_m=0.05", "map.voxel_m=0.04"),
                              ("camera.T_base_camera=[0, 0, 1, -0.5, 0.5, -0.5, 0.5]", "camera.T_base_camera"),
                              ("map.capacity_voxels=20000", "map.kept_blocks"), ("track.points=1000", "track.points")):
            self.assert_error(stillmap(*run_args("--mode", "lockstep", "--resume", self.map, "--map", out, "--set", setting, "--set", "map.kept_blocks=0")), WRONG_CONFIG, str(self.map), word)
        self.assertEqual(out.read_text(), "earlier")
        self.assertEqual(self.map.read_bytes(), whole)


if __name__ == "__main__":
    unittest.main()
