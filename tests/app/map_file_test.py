# SPDX-License-Identifier: Apache-2.0
"""Map files: written by a run, looked into, exported, and whole whenever the run is killed."""
import json
import os
import re
import struct
import subprocess
import unittest
from pathlib import Path

from program import DONE, NO_DETECTOR, PROGRAM, QUIET, SOURCE, UNREADABLE_INPUT, WRONG_CONFIG, ProgramTest, run_args, stillmap
from running import RunningTest

WALK = Path(os.environ.get("STILLMAP_SHARED", SOURCE / "../shared")) / "data/office_walk"
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
        out.write_bytes(whole)  # a map by another name
        self.assert_error(stillmap("map", "export", out, "--out", out), WRONG_CONFIG, str(out), "is the map itself", lines=1)
        self.assertEqual(out.read_bytes(), whole)
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


class Evicted(RunningTest):
    """A table too small for the map: what gives way in memory is in the file."""
    def blocks(self, file):
        found = re.search(r"blocks +(\d+) of", stillmap("map", "info", file).stdout)
        return int(found[1]) if found else 0

    @unittest.skipUnless(WALK.exists(), "needs shared/data/office_walk")
    def test_a_small_memory_saves_what_a_large_one_does(self):
        maps = {}
        for name, capacity in (("large", 2_000_000), ("small", 512_000)):
            file, report, ply = self.path / f"{name}.stillmap", self.path / "r.json", self.path / "m.ply"
            result = stillmap("run", "--config", SOURCE / "firmware-config/cameras/hololens-540x360.toml", *NO_DETECTOR, *QUIET, "--source", f"tum:{WALK}",
                              "--mode", "lockstep", "--map", file, "--set", f"map.capacity_voxels={capacity}", "--report", report)
            self.assertEqual(result.returncode, DONE, result.stderr)
            facts = json.loads(report.read_text())
            self.assertEqual(facts["memory"]["heap_allocations_after_start"]["map"], 0)
            self.assertEqual(stillmap("map", "export", file, "--out", ply).returncode, DONE)
            points = ply.read_bytes().split(b"end_header\n")[1]
            maps[name] = {struct.unpack_from("<3f", points, i) for i in range(0, len(points), 15)}
        facts = facts["map"]
        self.assertEqual((facts["blocks_used"], facts["blocks_lost"]), (1000, 0))
        self.assertGreater(facts["blocks_kept"], 400)
        large, small = maps["large"], maps["small"]
        print(f"[ MEASURED ] {facts['blocks_used']} blocks in memory, {facts['blocks_kept']} kept: {100 * len(large & small) / len(large):.1f} % of the "
              f"large map's voxels, {100 * len(small - large) / len(small):.1f} % others; in memory alone {facts['voxels']} of {len(large)}")
        self.assertGreater(len(large & small), 0.95 * len(large))
        self.assertLess(len(small - large), 0.02 * len(small))
        self.assertLess(facts["voxels"], 0.7 * len(large))

    def test_a_killed_run_leaves_them_and_the_next_goes_on_with_them(self):
        file, again, report = self.path / "m.stillmap", self.path / "again.stillmap", self.path / "r.json"
        small = ["--set", f"map.capacity_voxels={300 * 512}"]
        process = subprocess.Popen([PROGRAM, *run_args("--mode", "realtime", "--loop", "1000", "--map", file, "--set", "map.checkpoint_s=0.3", *small)],
                                   stderr=subprocess.DEVNULL)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        self.wait_for(lambda: file.exists() and self.blocks(file) > 320)
        process.kill()
        process.wait()
        self.assertEqual({p.name for p in self.path.iterdir()} - {"m.stillmap.tmp"}, {"m.stillmap"})
        resumed = ["--mode", "lockstep", "--resume", file, *small]
        self.assert_error(stillmap(*run_args(*resumed, "--map", self.path / "m.ply")), WRONG_CONFIG, str(file), "map.capacity_voxels")
        result = stillmap(*run_args(*resumed, "--map", again, "--report", report))
        self.assertEqual(result.returncode, DONE, result.stderr)
        facts = json.loads(report.read_text())
        self.assertEqual((facts["tracking"]["relocalized"], facts["map"]["blocks_used"], facts["map"]["blocks_lost"]), (1, 300, 0))
        self.assertGreaterEqual(self.blocks(again), self.blocks(file))

    def test_without_room_for_them_they_are_lost_and_counted(self):
        report = self.path / "r.json"
        for kept in (0, 3):
            result = stillmap(*run_args("--mode", "lockstep", "--map", self.path / "m.stillmap", "--report", report, "--set", f"map.kept_blocks={kept}",
                                        "--set", f"map.capacity_voxels={380 * 512}"))
            self.assertEqual(result.returncode, DONE, result.stderr)
            self.assertEqual("raise map.kept_blocks" in result.stderr, kept > 0, result.stderr)
            facts = json.loads(report.read_text())["map"]
            self.assertEqual(facts["blocks_kept"], kept)
            self.assertGreater(facts["blocks_lost"], 10)
            self.assertEqual(self.blocks(self.path / "m.stillmap"), 380 + kept)


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
