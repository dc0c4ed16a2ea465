# SPDX-License-Identifier: Apache-2.0
"""Outputs appear whole; what cannot be written is refused before the run, and a failed run takes nothing away."""
import json
import os
import struct
import unittest

from program import (DONE, FRAMES, LOG, RUN_FAILED, UNREADABLE_INPUT, WRONG_CONFIG, ProgramTest, link_log, run_args, stillmap)


class Outputs(ProgramTest):
    def test_all_of_them(self):
        result = stillmap(*run_args("--mode", "lockstep", *self.outputs()))
        self.assertEqual((result.returncode, result.stdout), (DONE, ""))
        self.assertEqual(sorted(os.listdir(self.path)), ["f.txt", "m.ply", "r.json", "t.txt"])
        report = json.loads((self.path / "r.json").read_text())
        header, columns, *poses = (self.path / "t.txt").read_text().splitlines()
        self.assertTrue(header.startswith("# ") and "T_map_camera" in header)
        self.assertEqual(len(poses), report["tracking"]["tracked"] + report["tracking"]["weak"])
        stamps = [float(p.split()[0]) for p in poses]
        self.assertEqual(stamps, sorted(set(stamps)))
        head, _, body = (self.path / "m.ply").read_bytes().partition(b"end_header\n")
        self.assertIn(f"element vertex {report['map']['voxels']}\n".encode(), head)
        self.assertEqual(len(body), 15 * report["map"]["voxels"])
        self.assertTrue(all(abs(v) < 20 for v in struct.unpack_from("<3f", body)))

    def test_refused_before_the_run(self):
        (self.path / "file").write_text("x")
        for option, path in (("--trajectory", "none/t.txt"), ("--trajectory-final", "file/t.txt"), ("--report", "none/r.json"),
                             ("--map", "none/m.ply"), ("--report", ".")):
            with self.subTest(option=option, path=path):
                result = stillmap(*run_args(option, self.path / path))
                self.assert_error(result, RUN_FAILED, str(self.path / path), lines=1)
        self.assert_error(stillmap(*run_args("--map", self.path / "m.obj")), WRONG_CONFIG, ".ply", lines=1)
        self.assertEqual(os.listdir(self.path), ["file"])

    def test_what_is_written_while_running_is_a_regular_file(self):
        for option, name in (("--map", "m.stillmap"), ("--set", "flight")):
            pipe = self.path / name
            os.mkfifo(pipe)
            value = f"runtime.flight_recorder={pipe}" if option == "--set" else pipe
            with self.subTest(name):
                self.assert_error(stillmap(*run_args("--mode", "realtime", option, value), timeout=60), RUN_FAILED, str(pipe), "no regular file", lines=1)

    def test_a_run_that_fails_at_its_start_leaves_no_files_and_takes_none(self):
        for failing, code in ((run_args(log=self.path / "none"), UNREADABLE_INPUT), (run_args("--set", "memory.budget_mb=16"), WRONG_CONFIG)):
            out = self.path / "out"
            outputs = self.outputs(out)
            self.assertEqual(stillmap(*failing, *outputs).returncode, code)
            self.assertEqual(os.listdir(out), [])
            (out / "m.ply").write_text("an earlier map")
            self.assertEqual(stillmap(*failing, *outputs).returncode, code)
            self.assertEqual((out / "m.ply").read_text(), "an earlier map")
            (out / "m.ply").unlink()

    def test_a_log_without_a_usable_frame_leaves_only_the_report(self):
        log = link_log(self.path / "log", 4)
        for file in (log / "rgb").iterdir():
            file.unlink()
            file.write_bytes(b"no picture")
        out = self.path / "out"
        for mode in ("lockstep", "realtime"):
            outputs = self.outputs(out)
            (out / "t.txt").write_text("an earlier trajectory")
            self.assert_error(stillmap(*run_args("--mode", mode, *outputs, log=log)), UNREADABLE_INPUT, str(log), "report")
            self.assertEqual(sorted(os.listdir(out)), ["r.json", "t.txt"])
            self.assertEqual((out / "t.txt").read_text(), "an earlier trajectory")
            frames = json.loads((out / "r.json").read_text())["frames"]
            self.assertEqual(frames, {"offered": 4, "processed": 0, "dropped": {"corrupt_colour": 4}})

    def test_a_run_that_never_tracks_leaves_earlier_outputs(self):
        files = {"--trajectory": self.path / "t.txt", "--trajectory-final": self.path / "f.txt", "--map": self.path / "m.stillmap"}
        for mode in ("lockstep", "realtime"):
            for file in files.values():
                file.write_text("earlier")
            outputs = [a for option in files.items() for a in option]
            # Every reading lies some kilometres away; and a checkpoint is due all the time.
            result = stillmap(*run_args("--mode", mode, *outputs, "--report", self.path / "r.json", "--set", "camera.depth_units_per_m=1",
                                        "--set", "map.checkpoint_s=0.1"))
            self.assert_error(result, UNREADABLE_INPUT, str(LOG), "could be tracked", "camera.depth_units_per_m")
            self.assertEqual([file.read_bytes() for file in files.values()], [b"earlier"] * len(files))
            report = json.loads((self.path / "r.json").read_text())
            self.assertGreater(report["frames"]["processed"], 0)
            self.assertEqual(report["tracking"]["initializing"], report["frames"]["processed"])
            self.assertIn(f"{report['frames']['processed']} before the first pose, 0 tracked", result.stderr)

    def test_a_log_with_some_bad_frames_is_used_all_the_same(self):
        log = link_log(self.path / "log", 12)
        colour, depth = sorted((log / "rgb").iterdir()), sorted((log / "depth").iterdir())
        colour[3].unlink()
        colour[5].unlink()
        colour[5].write_bytes(b"no picture")
        whole = depth[7].read_bytes()
        depth[7].unlink()
        depth[7].write_bytes(whole[:len(whole) // 2])
        result = stillmap(*run_args("--mode", "lockstep", "--report", self.path / "r.json", log=log))
        self.assertEqual(result.returncode, DONE, result.stderr)
        frames = json.loads((self.path / "r.json").read_text())["frames"]
        self.assertEqual(frames, {"offered": 12, "processed": 9, "dropped": {"missing_file": 1, "corrupt_colour": 1, "corrupt_depth": 1}})
        for reason in frames["dropped"]:
            self.assertIn(f"1 frames dropped: {reason} (", result.stderr)

    def test_standard_output_can_be_named(self):
        result = stillmap(*run_args("--mode", "lockstep", "--duration", "0.1", "--report", "/dev/stdout"))
        self.assertEqual(result.returncode, DONE, result.stderr)
        self.assertEqual(json.loads(result.stdout)["frames"]["processed"], 4)


if __name__ == "__main__":
    unittest.main()
