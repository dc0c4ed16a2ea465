# SPDX-License-Identifier: Apache-2.0
"""Commands that do not run the pipeline, and everything that is refused before it starts."""
import hashlib
import json
import os
import re
import socket
import subprocess
import unittest

from program import (CAMERA, DETECTOR, DONE, FRAMES, GROUNDTRUTH, LOG, MODEL, NO_DETECTOR, PROGRAM, QUIET, RUN_FAILED, SOURCE,
                     UNREADABLE_INPUT, WRONG_CONFIG, ProgramTest, link_log, run_args, stillmap)


class Help(ProgramTest):
    def test_version_names_the_sources(self):
        result = stillmap("--version")
        self.assertEqual(result.returncode, DONE)
        self.assertRegex(result.stdout, r"^stillmap \d+\.\d+\.\d+ \(\S+\), sources: .*tum")
        self.assertEqual(result.stderr, "")

    def test_help_of_the_program_and_of_each_command(self):
        whole = stillmap("--help")
        self.assertEqual((whole.returncode, whole.stderr), (DONE, ""))
        for command in ("run", "eval", "plan", "check", "map", "devices", "doctor"):
            self.assertIn(command, whole.stdout)
            self.assertEqual(stillmap(command, "--help").returncode, DONE)
        options = stillmap("run", "--help").stdout
        self.assertRegex(options, r"--mode TEXT:\{live,realtime,fast,lockstep\}\s")
        for option in ("--config", "--set", "--source", "--mode", "--trajectory", "--map", "--report", "--groundtruth", "--listen",
                       "--loop", "--duration"):
            self.assertIn(option, options)


class Machine(ProgramTest):
    """What the program says about cameras and the machine; in tests there is no camera."""

    def fake_root(self):
        for name, text in {"sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave",
                           "sys/bus/usb/devices/2-1/idVendor": "8086", "sys/bus/usb/devices/2-1/product": "Depth Camera 435",
                           "sys/bus/usb/devices/2-1/speed": "480", "sys/bus/usb/devices/2-1/2-1:1.0/bInterfaceClass": "0e",
                           "sys/bus/usb/devices/3-1/idVendor": "046d", "sys/bus/usb/devices/3-1/bInterfaceClass": "03",
                           "sys/bus/usb/devices/4-1/idVendor": "045e", "sys/bus/usb/devices/4-1/idProduct": "02ae",
                           "sys/bus/usb/devices/5-1/idVendor": "1d27", "usr/lib/any/OpenNI2/Drivers/libPS1080.so.0": "",
                           "dev/video0": ""}.items():
            path = self.path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text + "\n")
        return self.path

    def test_doctor_gives_each_finding_with_its_mend(self):
        result = stillmap("doctor", "--root", self.fake_root())
        lines = result.stdout.splitlines()
        bad = sum(line.startswith("BAD") for line in lines)
        self.assertGreaterEqual(bad, 3)
        self.assertEqual((result.returncode, result.stderr), (RUN_FAILED, f"stillmap: {bad} of {len(lines) - bad} findings are BAD; their mends stand below them\n"))
        for line, following in zip(lines, lines[1:] + [""]):
            self.assertEqual(line.startswith("BAD"), following.startswith("     mend: "), result.stdout)
        self.assertRegex(result.stdout, r"(?m)^(ok  |BAD ) core speed: \d+ million")
        self.assertIn("BAD  frequency governor: powersave", lines)
        self.assertIn("BAD  USB camera Depth Camera 435 at 480 Mbit/s", lines)
        self.assertNotIn("046d", result.stdout)
        self.assertIn("BAD  OpenNI2's plug-in for it, OpenNI2/Drivers/libFreenectDriver.so.0", lines)
        self.assertIn("ok   OpenNI2's plug-in for it, OpenNI2/Drivers/libPS1080.so.0", lines)
        self.assertTrue(any(line.endswith("/dev/video0 can be opened") for line in lines), result.stdout)
        for limit in ("real-time priority", "locked memory"):
            self.assertIn(limit, result.stdout)

    def test_devices_lists_sources_or_says_that_there_is_none(self):
        result = stillmap("devices")
        self.assertEqual(result.returncode, DONE)
        self.assertNotEqual(bool(result.stdout), "no camera found" in result.stderr)

    def test_a_source_without_its_option_or_its_kind_is_understood(self):
        for args, meant in (([f"tum:{LOG}"], f"tum:{LOG}"), ([LOG], f"tum:{LOG}"), (["v4l2:/dev/video0,/dev/video1"], "v4l2:/dev/video0,/dev/video1"),
                            (["--source", LOG], f"tum:{LOG}")):
            with self.subTest(args=args):
                self.assert_error(stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, *args), WRONG_CONFIG, f"did you mean `--source {meant}`?", lines=1)
        for args in (["stray"], ["--source", "stray"]):
            result = stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, *args)
            self.assert_error(result, WRONG_CONFIG, "stray", lines=1)
            self.assertNotIn("did you mean", result.stderr)

    def test_a_log_that_is_no_folder(self):
        estimate = ["eval", "--groundtruth", GROUNDTRUTH, "--estimate", GROUNDTRUTH]
        for command in (["run", *CAMERA, *NO_DETECTOR, *QUIET], estimate):
            self.assert_error(stillmap(*command, "--source", "tum:"), WRONG_CONFIG, "--source tum:: names no folder", "rgb.txt", lines=1)
            self.assert_error(stillmap(*command, "--source", f"tum:{GROUNDTRUTH}"), UNREADABLE_INPUT, f"{GROUNDTRUTH}: is a file", f"tum:{LOG}", lines=1)

    @unittest.skipIf(stillmap("devices").stdout, "this machine has a camera")
    def test_run_without_a_source_and_without_a_camera(self):
        self.assert_error(stillmap("run"), RUN_FAILED, "no camera found", "stillmap doctor", "--source tum:DIR", lines=1)

    def test_sources_that_cannot_be(self):
        for source, *words in (("v4l2:/dev/video0", "expected v4l2:COLOUR,DEPTH"), ("v4l2:,", "expected v4l2:COLOUR,DEPTH"),
                               ("webcam:0", "expected tum:DIR"), ("webcam", "expected tum:DIR")):
            with self.subTest(source=source):
                self.assert_error(stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, "--source", source), WRONG_CONFIG, source, *words, lines=1)
        self.assert_error(stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, "--source", "v4l2:/dev/null,/dev/null"), RUN_FAILED,
                          "/dev/null: is no video node", lines=1)

    @unittest.skipIf("openni2" not in stillmap("--version").stdout, "this program has no OpenNI2")
    def test_a_pipe_in_place_of_a_recording(self):
        os.mkfifo(self.path / "pipe.oni")
        result = stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, "--source", f"openni2:{self.path}/pipe.oni", timeout=60)
        self.assert_error(result, UNREADABLE_INPUT, "pipe.oni", "no regular file")


class Arguments(ProgramTest):
    def test_wrong_arguments(self):
        for args in ([], ["fly"], ["run", "--fly"], run_args("--mode", "slow"), run_args("--mode", "2"), run_args("--detector-delay", "-1"),
                     run_args("--detector-every", "0"), run_args("--duration", "-1"), run_args("--loop", "0"), ["eval"], ["check", "stray"]):
            with self.subTest(args=args):
                self.assert_error(stillmap(*args), WRONG_CONFIG, "--help", lines=1)

    def test_a_duration_that_is_no_number(self):
        self.assert_error(stillmap(*run_args("--duration", "nan")), WRONG_CONFIG, "--duration nan", "0 for all", lines=1)

    def test_errors_are_one_line_whatever_is_in_a_name(self):
        self.assert_error(stillmap("check", "--set", "camera\n.width\x1b[2J=640"), WRONG_CONFIG, "camera?.width?[2J", lines=1)

    def test_wrong_configuration(self):
        bad_file = self.path / "bad.toml"
        bad_file.write_text("[track]\nfeaturs = 900\n")
        broken = self.path / "broken.toml"
        broken.write_text("[track\n")
        for command in (["check"], ["plan", "--source", f"tum:{LOG}"], ["run", "--source", f"tum:{LOG}"]):
            for args, words in (
                ([*CAMERA, "--config", bad_file], ("bad.toml", "track.featurs", "track.features")),
                ([*CAMERA, "--config", broken], ("broken.toml:", "TOML")),
                ([*CAMERA, "--config", self.path / "none.toml"], ("none.toml", "no such")),
                ([*CAMERA, "--set", "track.features=none"], ("track.features", "whole number", "200")),
                ([*CAMERA, "--set", "map.voxel_m=9"], ("map.voxel_m", "0.5 m")),
                ([*CAMERA, "--set", "nonsense"], ("KEY=VALUE",)),
                ([], ("camera.width", "missing", "firmware-config/cameras")),
            ):
                with self.subTest(command=command, args=args):
                    self.assert_error(stillmap(*command, *args), WRONG_CONFIG, *words, lines=1)

    def test_sources_that_cannot_be(self):
        for source in ("nothing", "ftp:x"):
            with self.subTest(source=source):
                result = stillmap("run", *CAMERA, *NO_DETECTOR, *QUIET, "--source", source)
                self.assert_error(result, WRONG_CONFIG, "tum:DIR", lines=1)

    def test_two_outputs_do_not_share_a_file(self):
        path, same = self.path / "x.ply", f"{self.path}/../{self.path.name}/x.ply"
        for args, words in ((["--map", path, "--trajectory", same], ("--trajectory", "--map", str(path))),
                            (["--report", path, "--trajectory-final", path], ("--trajectory-final", "--report")),
                            (["--groundtruth", path, "--trajectory", path], ("--groundtruth", "--trajectory")),
                            (["--config", path, "--report", same], ("--config", "--report")),
                            (["--resume", path, "--trajectory", path], ("--resume", "--trajectory")),
                            (["--trajectory", GROUNDTRUTH], ("--source", "--trajectory", str(GROUNDTRUTH)))):
            with self.subTest(args=args):
                self.assert_error(stillmap(*run_args(*args)), WRONG_CONFIG, "the same file", *words, lines=1)
        self.assertEqual(list(self.path.iterdir()), [])

    def test_missing_log_and_ground_truth(self):
        none = self.path / "none"
        self.assert_error(stillmap(*run_args(log=none)), UNREADABLE_INPUT, str(none), "rgb.txt", lines=1)
        self.assert_error(stillmap(*run_args(log=self.path)), UNREADABLE_INPUT, str(self.path), "associations.txt", lines=1)
        self.assert_error(stillmap(*run_args("--groundtruth", none)), UNREADABLE_INPUT, str(none), lines=1)

    def test_listed_files_that_are_not_there(self):
        log = link_log(self.path / "log", 3)
        for file in (log / "depth").iterdir():
            file.unlink()
        self.assert_error(stillmap(*run_args(log=log)), UNREADABLE_INPUT, "no usable pair", lines=1)

    def test_models(self):
        missing = stillmap(*run_args(detector=["--set", f"detector.model={self.path}/none.onnx"]))
        self.assert_error(missing, UNREADABLE_INPUT, "none.onnx", "get_model.sh")
        wrong = stillmap(*run_args("--set", "detector.sha256=" + "0" * 64, detector=DETECTOR))
        self.assert_error(wrong, UNREADABLE_INPUT, str(MODEL), hashlib.sha256(MODEL.read_bytes()).hexdigest())
        text = self.path / "text.onnx"
        text.write_text("no network")
        self.assert_error(stillmap(*run_args(detector=["--set", f"detector.model={text}"])), UNREADABLE_INPUT, str(text))
        classes = stillmap(*run_args(detector=["--set", f"detector.model={MODEL}"]))  # the classes are COCO's
        self.assert_error(classes, WRONG_CONFIG, "classes.names")

    def test_a_manifest_beside_the_model(self):
        model, manifest = self.path / "own.onnx", self.path / "own.toml"
        model.write_bytes(MODEL.read_bytes())
        whole = (SOURCE / "firmware-config/models/nanodet_plus_m.toml").read_text()
        said = re.sub('sha256 = ".*"', f'sha256 = "{hashlib.sha256(MODEL.read_bytes()).hexdigest()}"', whole) + '[classes]\nnames = ["person"]\n'
        given = ["--set", f"detector.model={model}", "--set", "classes.dynamic=['person']", "--set", "classes.semi_static=[]", "--set", "classes.static=[]"]
        manifest.write_text(said)
        right = stillmap(*run_args("--mode", "lockstep", "--duration", "0.2", detector=given))
        self.assertEqual(right.returncode, DONE, right.stderr)
        dump = stillmap("check", *CAMERA, *given, "--dump")
        self.assertRegex(dump.stdout, rf'classes.names = \["person"\] .* from {re.escape(str(manifest))}')
        manifest.write_text(said.replace("nanodet_plus", "yolox"))
        self.assert_error(stillmap(*run_args(detector=given)), UNREADABLE_INPUT, str(model), "yolox", str(manifest))
        for wrong, words in (("nanodet_minus", ["detector.decoder", "yolov5"]), ("", ["detector.decoder"])):
            manifest.write_text(said.replace("nanodet_plus", wrong))
            for command in (["check", *CAMERA, *given], run_args(detector=given)):
                self.assert_error(stillmap(*command), WRONG_CONFIG, f"manifest of '{model}'", *words)
        manifest.write_text(whole)
        self.assert_error(stillmap(*run_args(detector=given)), UNREADABLE_INPUT, "detector.sha256")

    def test_listening(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            result = stillmap(*run_args(listen=["--listen", f"127.0.0.1:{port}"]))
            self.assert_error(result, RUN_FAILED, f"port {port}", "in use", "another port")
        self.assert_error(stillmap(*run_args(listen=["--listen", "everywhere"])), WRONG_CONFIG, "ADDR:PORT")


class Modes(ProgramTest):
    def test_the_detectors_timing_is_lockstep_s(self):
        for mode in ([], ["--mode", "realtime"], ["--mode", "fast"]):
            for option in ("--detector-delay", "--detector-every"):
                self.assert_error(stillmap(*run_args(*mode, option, "1")), WRONG_CONFIG, option, "--mode lockstep", lines=1)

    def test_live_is_for_cameras(self):
        self.assert_error(stillmap(*run_args("--mode", "live")), WRONG_CONFIG, "--mode live", "cameras", "realtime", lines=1)

    def test_fast_drops_nothing(self):
        report, detector_off = self.path / "r.json", NO_DETECTOR
        result = stillmap(*run_args("--mode", "fast", "--loop", "3", "--report", report, detector=detector_off))
        self.assertEqual(result.returncode, DONE, result.stderr)
        r = json.loads(report.read_text())
        self.assertEqual((r["mode"], r["frames"]), ("fast", {"offered": 3 * FRAMES, "processed": 3 * FRAMES, "dropped": {}}))

    def test_accuracy_is_the_first_pass(self):
        found = {}
        for loops in ("1", "2"):
            trajectory, report = self.path / f"t{loops}.txt", self.path / f"r{loops}.json"
            result = stillmap(*run_args("--mode", "lockstep", "--loop", loops, "--trajectory", trajectory, "--report", report, "--groundtruth",
                                        GROUNDTRUTH))
            self.assertEqual(result.returncode, DONE, result.stderr)
            stamps = [float(line.split()[0]) for line in trajectory.read_text().splitlines() if not line.startswith("#")]
            self.assertEqual(stamps, sorted(set(stamps)))
            self.assertEqual(len(stamps), int(loops) * FRAMES)
            found[loops] = json.loads(report.read_text())["accuracy"]
        self.assertEqual(found["1"], found["2"])


class Plan(ProgramTest):
    def rows(self, text):
        lines = text.splitlines()
        rows = [re.fullmatch(r"(\S+) +(\d+) +(\d+) +([\d.]+) +[\d.]+%", l) for l in lines[1:-2]]
        self.assertTrue(all(rows), text)
        total = re.fullmatch(r"total +([\d.]+) \(budget ([\d.]+) MB\)", lines[-2])
        self.assertTrue(total, text)
        frames = re.fullmatch(r"frames: (\d+) = (.*)", lines[-1])
        self.assertTrue(frames, text)
        self.assertEqual(int(frames[1]), sum(int(n) for n in re.findall(r"\d+", frames[2])))
        depth = next(r for r in rows if r[1] == "frames.depth")
        self.assertEqual(int(depth[2]), int(frames[1]) * 640 * 480)
        return [(r[1], int(r[2]) * int(r[3]), float(r[4])) for r in rows], float(total[1]), float(total[2])

    def test_the_sum_is_the_total(self):
        result = stillmap("plan", *CAMERA)
        self.assertEqual((result.returncode, result.stderr), (DONE, ""))
        rows, total_mb, budget_mb = self.rows(result.stdout)
        for name, size, mb in rows:
            self.assertAlmostEqual(size / 1e6, mb, delta=0.00051, msg=name)
        sum_bytes = sum(size for _, size, _ in rows)
        # Each piece begins on a cache line.
        self.assertTrue(-500 <= total_mb * 1e6 - sum_bytes <= 64 * len(rows) + 500, (total_mb, sum_bytes))
        self.assertLessEqual(total_mb, budget_mb)

    def test_the_plan_is_what_a_run_takes(self):
        _, total_mb, _ = self.rows(stillmap("plan", *CAMERA, *NO_DETECTOR, "--set", "stream.listen=off").stdout)
        report = self.path / "r.json"
        self.assertEqual(stillmap(*run_args("--mode", "lockstep", "--duration", "0.1", "--report", report)).returncode, DONE)
        self.assertAlmostEqual(json.loads(report.read_text())["memory"]["planned_bytes"] / 1e6, total_mb, delta=0.00051)

    def test_the_plan_takes_the_runs_options(self):
        report = self.path / "r.json"
        options = ("--mode", "lockstep", "--detector-delay", "3", "--trajectory", self.path / "t.txt", "--trajectory-final", self.path / "f.txt",
                   "--groundtruth", GROUNDTRUTH, "--record", self.path / "log", "--loop", "50", "--duration", "0.1", "--report", report)
        run = run_args(*options, detector=DETECTOR)
        rows, total_mb, _ = self.rows(stillmap("plan", *run[1:]).stdout)
        sizes = {name: size for name, size, _ in rows}
        for name in ("trajectory", "trajectory.covariances", "final_trajectory"):
            self.assertGreater(sizes[name], 50 * FRAMES * 50, name)
        self.assertEqual(stillmap(*run).returncode, DONE)
        self.assertAlmostEqual(json.loads(report.read_text())["memory"]["planned_bytes"] / 1e6, total_mb, delta=0.00051)

    def test_half_an_hour_of_a_camera_is_kept(self):
        rows, _, _ = self.rows(stillmap("plan", *CAMERA, "--source", "openni2:", "--trajectory", "t.txt").stdout)
        self.assertEqual({name: size for name, size, _ in rows}["trajectory"], 1800 * 30 * 104)

    def test_without_a_profile_the_lens_is_guessed_as_a_run_does(self):
        for source in ([], ["--source", "v4l2:/dev/video0,/dev/video2"], ["--config", SOURCE / "firmware-config/boards/two-core.toml"]):
            result = stillmap("plan", *source, *NO_DETECTOR)
            self.assertEqual(result.returncode, DONE, result.stderr)
            self.assertIn("no camera profile: planned for 640 x 480 px", result.stderr)
            self.rows(result.stdout)

    def test_over_budget(self):
        over = ["--set", "memory.budget_mb=16"]
        result = stillmap("plan", *CAMERA, *over)
        self.assertEqual(result.returncode, WRONG_CONFIG)
        _, total_mb, budget_mb = self.rows(result.stdout)  # the table comes all the same
        self.assertGreater(total_mb, budget_mb)
        self.assertEqual(len(result.stderr.splitlines()), 1)
        self.assert_error(stillmap(*run_args(*over)), WRONG_CONFIG, "memory.budget_mb", "map.capacity_voxels", "--trajectory-final")


class Check(ProgramTest):
    def test_silent_when_good(self):
        result = stillmap("check", *CAMERA)
        self.assertEqual((result.returncode, result.stdout, result.stderr), (DONE, "", ""))

    def test_every_shipped_profile(self):
        for camera in (SOURCE / "firmware-config/cameras").glob("*.toml"):
            self.assertEqual(stillmap("check", "--config", camera).returncode, DONE, camera)
        for board in (SOURCE / "firmware-config/boards").glob("*.toml"):
            result = stillmap("plan", *CAMERA, "--config", board)  # and what it plans is within its own budget
            self.assertEqual(result.returncode, DONE, result.stderr)

    def test_dump_says_every_key_and_where_it_came_from(self):
        own = self.path / "own.toml"
        own.write_text("[track]\nfeatures = 800\n")
        result = stillmap("check", *CAMERA, "--config", own, "--set", "map.voxel_m=0.05", "--dump")
        self.assertEqual((result.returncode, result.stderr), (DONE, ""))
        found = {}
        for line in result.stdout.splitlines():
            match = re.fullmatch(r"(\S+) = (.*)  # .*; from (.*)", line)
            self.assertTrue(match, line)
            found[match[1]] = (match[2], match[3])
        described = set(re.findall(r'^ +\{"([a-z_]+\.[A-Za-z0-9_.]+)", ', (SOURCE / "src/core/config_keys.cpp").read_text(), re.M))
        self.assertGreater(len(described), 40)
        self.assertEqual(set(found), described)
        self.assertEqual(found["track.features"], ("800", str(own)))
        self.assertEqual(found["map.voxel_m"], ("0.05", "--set"))
        self.assertEqual(found["runtime.seed"], ("1", "default"))
        self.assertEqual(found["camera.fx"], ("525", str(CAMERA[1])))


class Eval(ProgramTest):
    KEYS = {"ate_rmse_m", "ate_max_m", "rpe_1s_rmse_m", "rpe_1s_rmse_deg", "rpe_frame_rmse_m", "matched_poses", "coverage"}

    def write(self, name, poses):
        path = self.path / name
        path.write_text("".join(f"{t:.3f} {x} {y} 0 0 0 0 1\n" for t, x, y in poses))
        return path

    def test_a_known_pair(self):
        # A square of 1 m; the estimate is the same but for one corner, then everything moved and turned by nothing.
        truth = self.write("gt.txt", [(1, 0, 0), (2, 1, 0), (3, 1, 1), (4, 0, 1)])
        same = self.write("same.txt", [(1, 5, 5), (2, 6, 5), (3, 6, 6), (4, 5, 6)])
        result = stillmap("eval", "--groundtruth", truth, "--estimate", same)
        self.assertEqual((result.returncode, result.stderr), (DONE, ""))
        figures = json.loads(result.stdout)
        self.assertEqual(set(figures), self.KEYS)
        self.assertLess(figures["ate_rmse_m"], 1e-6)
        self.assertEqual((figures["matched_poses"], figures["coverage"]), (4, None))
        # Each corner 10 % farther out: no turn or shift helps, each is off by 0.1 * sqrt(0.5).
        larger = self.write("larger.txt", [(1, 0, 0), (2, 1.1, 0), (3, 1.1, 1.1), (4, 0, 1.1)])
        figures = json.loads(stillmap("eval", "--groundtruth", truth, "--estimate", larger).stdout)
        self.assertAlmostEqual(figures["ate_rmse_m"], 0.1 * 0.5 ** 0.5, places=5)
        self.assertAlmostEqual(figures["ate_max_m"], 0.1 * 0.5 ** 0.5, places=5)
        self.assertAlmostEqual(figures["rpe_1s_rmse_m"], 0.1, places=5)

    def test_a_figure_that_does_not_exist_is_null(self):
        short = self.write("short.txt", [(1, 0, 0), (1.1, 1, 0), (1.2, 1, 1)])
        figures = json.loads(stillmap("eval", "--groundtruth", short, "--estimate", short).stdout)
        self.assertIsNone(figures["rpe_1s_rmse_m"])

    def test_with_the_log_it_says_what_the_run_said(self):
        # Ground truth begins before a log and ends after it; some frames of this one cannot be read.
        log, estimate, report = link_log(self.path / "log", 30), self.path / "t.txt", self.path / "r.json"
        for picture in sorted((log / "rgb").iterdir())[10:16]:
            picture.unlink()
            picture.write_text("no picture")
        result = stillmap(*run_args("--mode", "lockstep", "--trajectory", estimate, "--report", report, "--groundtruth", GROUNDTRUTH, log=log))
        self.assertEqual(result.returncode, DONE, result.stderr)
        said = json.loads(report.read_text())["accuracy"]
        self.assertEqual((said["matched_poses"], said["coverage"]), (24, 24 / 30))
        pair = ["eval", "--groundtruth", GROUNDTRUTH, "--estimate", estimate]
        for source, coverage, note in ((["--source", f"tum:{log}"], 24 / 30, True), ([], None, False)):
            figures = json.loads(stillmap(*pair, *source).stdout)
            self.assertEqual((figures["matched_poses"], figures["coverage"], "note" in figures), (24, coverage, note))
            self.assertAlmostEqual(figures["ate_rmse_m"], said["ate_rmse_m"], places=5)
        self.assert_error(stillmap(*pair, "--source", log), WRONG_CONFIG, f"--source {log}: expected tum:DIR", lines=1)
        self.assert_error(stillmap(*pair, "--source", "tum:/none"), UNREADABLE_INPUT, "/none", lines=1)

    def test_report_file(self):
        report = self.path / "e.json"
        result = stillmap("eval", "--groundtruth", GROUNDTRUTH, "--estimate", GROUNDTRUTH, "--report", report)
        self.assertEqual((result.returncode, result.stdout, result.stderr), (DONE, "", ""))
        self.assertEqual(json.loads(report.read_text())["ate_max_m"] < 1e-6, True)

    def test_what_is_refused(self):
        other = self.write("other.txt", [(100, 0, 0), (101, 0, 0), (102, 0, 0)])
        pair = ["eval", "--groundtruth", GROUNDTRUTH, "--estimate"]
        self.assert_error(stillmap(*pair, other), UNREADABLE_INPUT, lines=1)
        self.assert_error(stillmap(*pair, self.path / "none"), UNREADABLE_INPUT, "none", lines=1)
        self.assert_error(stillmap(*pair, GROUNDTRUTH, "--report", self.path / "no/e.json"), RUN_FAILED, "e.json", lines=1)
        before = other.read_text()
        self.assert_error(stillmap(*pair, other, "--report", other), WRONG_CONFIG, str(other), "one of the trajectories", lines=1)
        self.assertEqual(other.read_text(), before)

    def test_a_standard_output_that_takes_nothing(self):
        for args in (["eval", "--groundtruth", GROUNDTRUTH, "--estimate", GROUNDTRUTH], ["check", *CAMERA, "--dump"], ["plan", *CAMERA]):
            with self.subTest(args=args), open("/dev/full", "w", encoding="utf-8") as full:
                result = subprocess.run([PROGRAM, *args], stdout=full, stderr=subprocess.PIPE, text=True)
                self.assertEqual((result.returncode, len(result.stderr.splitlines())), (RUN_FAILED, 1), result.stderr)
                self.assertIn("standard output cannot be written", result.stderr)


if __name__ == "__main__":
    unittest.main()
