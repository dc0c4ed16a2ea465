# SPDX-License-Identifier: Apache-2.0
"""A program that tracks an endless log, whose words are read as they come, and which is asked over the stream's port how it is."""
import json
import os
import re
import signal
import subprocess
import threading
import time
import urllib.request

from program import DETECTOR, DONE, PROGRAM, ProgramTest, run_args, stillmap
from signals_test import endless_log


class RunningTest(ProgramTest):
    def start(self, *args, detector=DETECTOR, environment=None, fps=30):
        """The running program, tracking; `self.frames()` tells how many frames it has processed."""
        log = self.path / "endless"
        if not log.exists():
            endless_log(log, 20_000, fps)  # longer than a test may take: at its end the program closes its port
        command = run_args("--mode", "realtime", *args, log=log, detector=detector, listen=["--listen", "127.0.0.1:0"])
        self.process = process = subprocess.Popen([PROGRAM, *command], stderr=subprocess.PIPE, text=True, env={**os.environ, **(environment or {})})
        self.said = []
        self.reader = threading.Thread(target=lambda: self.said.extend(process.stderr), daemon=True)
        self.addCleanup(process.stderr.close)
        self.addCleanup(self.reader.join)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        self.reader.start()
        self.wait_for(lambda: self.says("tracking_started") or not self.reader.is_alive())
        self.assertTrue(self.says("tracking_started"), self.said)
        self.metrics = re.search(r"http://127\.0\.0\.1:\d+", "".join(self.said))[0] + "/metrics"
        return process

    def says(self, words):
        """How many lines so far hold these words."""
        return sum(words in line for line in list(self.said))

    def count(self, name):
        for _ in range(200):
            try:
                with urllib.request.urlopen(self.metrics, timeout=20) as answer:
                    return float(re.search(rf"^{name} (\S+)$", answer.read().decode(), re.M)[1])
            except OSError:  # it has just begun, or is too busy to answer in time
                self.assertIsNone(self.process.poll(), self.said)
                time.sleep(0.05)
        self.fail("no metrics")

    def frames(self):
        return self.count("stillmap_frames_processed_total")

    def wait_for(self, what):
        begin = time.monotonic()
        while not what():
            self.assertLess(time.monotonic() - begin, 250)
            time.sleep(0.05)

    def wait_for_frames(self, more):
        goal = self.frames() + more
        self.wait_for(lambda: self.frames() >= goal)

    def has_voxels(self, map_file):
        info = stillmap("map", "info", map_file)
        self.assertEqual(info.returncode, DONE, info.stderr)
        return int(re.search(r"voxels +(\d+)", info.stdout)[1]) > 0

    def wait_for_mapped(self, map_file):
        """Until a checkpoint holds something; on a slow machine the first may come before."""
        self.wait_for(lambda: map_file.exists() and self.has_voxels(map_file))

    def stop(self, process):
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=300)
        self.reader.join()
        return process.returncode, "".join(self.said)

    def report(self):
        facts = json.loads((self.path / "r.json").read_text())
        self.assertEqual(facts["frames"]["offered"], facts["frames"]["processed"] + sum(facts["frames"]["dropped"].values()))
        return facts
