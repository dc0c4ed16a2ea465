# SPDX-License-Identifier: Apache-2.0
"""Every shipped profile loads, and the plan of each board with each camera fits it."""
import re
import unittest

from program import DONE, SOURCE, WRONG_CONFIG, stillmap

FIRMWARE = SOURCE / "firmware-config"
BOARDS, CAMERAS, CLASSES, MODELS = (sorted((FIRMWARE / kind).glob("*.toml")) for kind in ("boards", "cameras", "classes", "models"))
# Of the smallest model that is sold. Others want memory, too: a budget is at most a fifth of it.
BOARD_RAM_MB = {"raspberry-pi-5": 2048, "raspberry-pi-4": 1024, "jetson-orin-nano": 4096, "rk3588": 4096, "two-core": 1024}
BOARD_CORES = {"raspberry-pi-5": 4, "raspberry-pi-4": 4, "jetson-orin-nano": 6, "rk3588": 8, "two-core": 2}


def budget_mb(plan):
    return float(re.search(r"\(budget ([0-9.]+) MB\)", plan)[1])


class ProfilesTest(unittest.TestCase):
    def test_every_board_plans_every_camera_with_its_trajectory_within_its_budget(self):
        self.assertTrue(BOARDS and CAMERAS)
        for board in BOARDS:
            for camera in CAMERAS:
                with self.subTest(board=board.stem, camera=camera.stem):
                    result = stillmap("plan", "--config", board, "--config", camera, "--source", "openni2:", "--trajectory", "t.txt")
                    self.assertEqual(result.returncode, DONE, result.stderr)
                    self.assertLessEqual(budget_mb(result.stdout), BOARD_RAM_MB[board.stem] / 5)

    def test_every_board_says_which_cores_and_locks_its_memory(self):
        for board in BOARDS:
            with self.subTest(board=board.stem):
                said = stillmap("check", "--config", board, "--config", CAMERAS[0], "--dump").stdout
                values = dict(re.findall(r"^((?:threads|memory)\.\w+) = (\S+) .*; from \S+\.toml$", said, re.M))
                self.assertEqual(values["memory.lock"], "true")
                self.assertIn(values["threads.realtime"], ("true", "false"))
                cores = int(values["threads.tracking_core"]), int(values["threads.other_core"])
                self.assertNotEqual(*cores)
                self.assertTrue(all(0 <= c < BOARD_CORES[board.stem] for c in cores))

    def test_every_table_of_classes_and_models_loads(self):
        for table in [*CLASSES, *MODELS, FIRMWARE / "demo.toml"]:
            with self.subTest(table=table.stem):
                result = stillmap("check", "--config", CAMERAS[0], "--config", table)
                self.assertEqual(result.returncode, DONE, result.stderr)

    def service_run(self, **settings):
        """What the service's command says with its settings as shipped, but for these; it stops before it opens anything."""
        env = dict(re.findall(r"^([A-Z]+)=(.*)$", (FIRMWARE / "systemd/stillmap.env").read_text(), re.M)) | settings
        command = re.search(r"^ExecStart=/usr/bin/stillmap (run .*)$", (FIRMWARE / "systemd/stillmap.service").read_text(), re.M)[1]
        args = []
        for word in command.split():
            if word.startswith("${"):
                args.append(env[word[2:-1]].replace("/usr/share/stillmap", str(SOURCE)))
            else:
                args += env[word[1:]].split() if word.startswith("$") else [word]
        return stillmap(*args, "--source", "none")

    def test_the_service_takes_no_camera_for_another(self):
        refused = self.service_run()
        self.assertEqual(refused.returncode, WRONG_CONFIG)
        for words in ("--config names no file", "/etc/stillmap/stillmap.env", "CAMERA"):
            self.assertIn(words, refused.stderr)
        for camera in CAMERAS:
            self.assertIn("--source none: expected tum:DIR", self.service_run(CAMERA=str(camera)).stderr)

    def test_the_service_may_lock_and_hold_the_largest_budget(self):
        unit = (FIRMWARE / "systemd/stillmap.service").read_text()
        limits = [int(m) for m in re.findall(r"^MemoryMax=([0-9]+)M$", unit, re.M)]
        self.assertEqual(len(limits), 1)
        # With a finite limit, what is mapped later may be refused, so the runtime would not lock.
        self.assertIn("\nLimitMEMLOCK=infinity\n", unit)
        self.assertGreaterEqual(int(re.search(r"^LimitRTPRIO=(\d+)$", unit, re.M)[1]), 20, "capture's priority")
        budgets = [budget_mb(stillmap("plan", "--config", b, "--config", CAMERAS[0]).stdout) for b in BOARDS]
        self.assertGreaterEqual(min(limits), 2 * max(budgets))


if __name__ == "__main__":
    unittest.main()
