# SPDX-License-Identifier: Apache-2.0
"""A program that tracks an endless log and is asked over the stream's port how it is."""
import json
import os
import re
import signal
import subprocess
import time
import urllib.error
import urllib.request

from program import DETECTOR, PROGRAM, ProgramTest, run_args
from signals_test import endless_log


class RunningTest(ProgramTest):
    def start(self, *args, detector=DETECTOR, environment=None):
        """The running program, tracking; `self.frames()` tells how many frames it has processed."""
        log = self.path / "endless"
        if not log.exists():
            endless_log(log)
        command = run_args("--mode", "realtime", *args, log=log, detector=detector, listen=["--listen", "127.0.0.1:0"])
        process = subprocess.Popen([PROGRAM, *command], stderr=subprocess.PIPE, text=True, env={**os.environ, **(environment or {})})
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        said = ""
        while "tracking_started" not in said:
            line = process.stderr.readline()
            self.assertNotEqual(line, "", said)
            said += line
        self.metrics = re.search(r"http://127\.0\.0\.1:\d+", said)[0] + "/metrics"
        return process

    def count(self, name):
        for _ in range(200):
            try:
                with urllib.request.urlopen(self.metrics, timeout=20) as answer:
                    return float(re.search(rf"^{name} (\S+)$", answer.read().decode(), re.M)[1])
            except urllib.error.HTTPError:  # it has just begun
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

    def stop(self, process):
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=60)[1]
        return process.returncode, said

    def report(self):
        facts = json.loads((self.path / "r.json").read_text())
        self.assertEqual(facts["frames"]["offered"], facts["frames"]["processed"] + sum(facts["frames"]["dropped"].values()))
        return facts
