# SPDX-License-Identifier: Apache-2.0
"""Map files: written by a run, looked into, exported, and whole whenever the run is killed."""
import json
import re
import unittest

from program import DONE, UNREADABLE_INPUT, WRONG_CONFIG, ProgramTest, run_args, stillmap
from running import RunningTest

UP = ["--set", "camera.T_base_camera=[0, 0, 1, -0.5, 0.5, -0.5, 0.5]"]


class MapFiles(ProgramTest):
    def make(self, name, *args):
        file, report = self.path / name, self.path / "r.json"
        result = stillmap(*run_args("--mode", "lockstep", "--map", file, "--report", report, *args))
        self.assertEqual(result.returncode, DONE, result.stderr)
        report = json.loads(report.read_text())
        self.assertEqual(report["memory"]["heap_allocations_after_start"]["map"], 0)
        return file, report["map"]

    def test_info_and_points(self):
        file, facts = self.make("m.stillmap", "--set", "map.checkpoint_s=0.1")
        ply, _ = self.make("m.ply")
        info = stillmap("map", "info", file)
        self.assertEqual((info.returncode, info.stderr), (DONE, ""))
        self.assertIn(f"voxels       {facts['voxels']} occupied, of 0.04 m\n", info.stdout)
        self.assertIn(f"blocks       {facts['blocks_used']} of", info.stdout)
        exported = self.path / "exported.ply"
        self.assertEqual(stillmap("map", "export", file, "--out", exported).returncode, DONE)
        self.assertEqual(exported.read_bytes(), ply.read_bytes())
        tree = self.path / "exported.bt"
        self.assertEqual(stillmap("map", "export", file, "--out", tree).returncode, DONE)
        self.assertTrue(tree.read_bytes().startswith(b"# Octomap OcTree binary file\n"))
        self.assertIn(b"\nres 0.04\n", tree.read_bytes())

    def test_floor_plan(self):
        flat, _ = self.make("flat.stillmap")
        self.assert_error(stillmap("map", "export", flat, "--out", self.path / "p.pgm"), WRONG_CONFIG, str(flat), "camera.T_base_camera", lines=1)
        file, _ = self.make("m.stillmap", *UP)
        result = stillmap("map", "export", file, "--out", self.path / "plan.pgm", "--from", "0.2", "--to", "1.6")
        self.assertEqual(result.returncode, DONE, result.stderr)
        width, height, pixels = re.fullmatch(rb"P5\n(\d+) (\d+)\n255\n(.*)", (self.path / "plan.pgm").read_bytes(), re.S).groups()
        self.assertEqual(len(pixels), int(width) * int(height))
        for grey in (0, 205, 254):
            self.assertGreater(pixels.count(grey), 50, grey)
        self.assertIn("image: plan.pgm\nresolution: 0.04\n", (self.path / "plan.yaml").read_text())

    def test_what_is_no_map_is_refused_and_nothing_overwritten(self):
        file, _ = self.make("m.stillmap")
        whole, out = file.read_bytes(), self.path / "out.ply"
        out.write_text("earlier")
        for bytes_, word in ((whole[:-1000], "cut off"), (whole[:999] + b"x" + whole[1000:], "damaged"), (b"ply\n" * 50, "no Stillmap map")):
            file.write_bytes(bytes_)
            for command in (["info", file], ["export", file, "--out", out]):
                self.assert_error(stillmap("map", *command), UNREADABLE_INPUT, str(file), word, lines=1)
        self.assertEqual(out.read_text(), "earlier")
        self.assert_error(stillmap("map", "export", file, "--out", "m.obj"), WRONG_CONFIG, ".ply", lines=1)

    def test_a_run_of_few_poses_leaves_the_earlier_map(self):
        file, _ = self.make("m.stillmap")
        earlier = file.read_bytes()
        for number in range(2):  # the second writes over its like
            result = stillmap(*run_args("--mode", "lockstep", "--map", file, "--duration", "0.04"))
            self.assertEqual(result.returncode, DONE, result.stderr)
            self.assertEqual("m.1.stillmap" in result.stderr, number == 0)
            self.assertEqual((self.path / "m.1.stillmap").read_bytes(), earlier)
            self.assertLess(2 * file.stat().st_size, len(earlier))
        file.write_bytes(earlier)
        # Its first checkpoint is small, its end is not.
        self.make("m.stillmap", "--set", "map.checkpoint_s=0.1")
        self.assertEqual(sorted(p.name for p in self.path.iterdir()), ["m.1.stillmap", "m.stillmap", "r.json"])


class Killed(RunningTest):
    def test_a_killed_run_leaves_its_last_checkpoint(self):
        file = self.path / "m.stillmap"
        process = self.start("--map", file, "--set", "map.checkpoint_s=0.3")
        self.wait_for_mapped(file)
        process.kill()
        process.wait()
        self.assertTrue(self.has_voxels(file))


if __name__ == "__main__":
    unittest.main()
