# SPDX-License-Identifier: Apache-2.0
"""/health and /metrics answer while the program runs, on the port that its first words name."""
import json
import re
import signal
import subprocess
import time
import unittest
import urllib.error
import urllib.request
from pathlib import Path

from program import DETECTOR, DONE, PROGRAM, ProgramTest, run_args
from signals_test import endless_log


class Stream(ProgramTest):
    def start(self, mode):
        log = endless_log(self.path / "log", 20_000)
        args = run_args("--mode", mode, log=log, detector=DETECTOR, listen=["--listen", "127.0.0.1:0"])
        process = subprocess.Popen([PROGRAM, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        while not (match := re.search(r"http://127\.0\.0\.1:(\d+) ", line := process.stderr.readline())):
            self.assertNotEqual(line, "", "the program ended")
        self.assertNotEqual(match[1], "0")
        return process, f"http://127.0.0.1:{match[1]}"

    def get(self, url):
        with urllib.request.urlopen(url, timeout=20) as answer:
            return answer.headers["Content-Type"], answer.read().decode()

    def wait_for(self, url, good):
        """The first text that is good; a run that has just begun says 503."""
        for _ in range(1200):
            try:
                kind, text = self.get(url)
                if good(text):
                    return kind, text
            except urllib.error.HTTPError as e:
                self.assertEqual(e.code, 503)
            time.sleep(0.05)
        self.fail(f"{url} never had what was waited for")

    def counters(self, text):
        return {k: float(v) for k, v in re.findall(r"^(stillmap_\w+_total(?:\{.*\})?) (\S+)$", text, re.M)}

    def threads(self, process):
        return {(task / "comm").read_text().strip() for task in Path(f"/proc/{process.pid}/task").iterdir()}

    def check_mode(self, mode):
        process, url = self.start(mode)
        kind, health = self.wait_for(url + "/health", lambda t: json.loads(t)["frames"]["processed"] > 0)
        self.assertEqual(kind, "application/json")
        self.assertIn(json.loads(health)["state"], ("tracking", "weak", "lost", "initializing"))
        kind, metrics = self.wait_for(url + "/metrics", lambda t: 'pool="map_blocks"' in t)
        self.assertIn("version=0.0.4", kind)
        before = self.counters(metrics)
        self.assertIn('stillmap_frames_dropped_total{reason="no_free_slot"}', before)
        name = "stillmap_frames_processed_total"
        _, metrics = self.wait_for(url + "/metrics", lambda t: self.counters(t)[name] > before[name])
        after = self.counters(metrics)
        self.assertEqual(before.keys(), after.keys())
        for key, value in before.items():
            self.assertGreaterEqual(after[key], value, key)
        self.assertIn("<html", self.get(url + "/")[1])
        if mode == "realtime":  # each thread takes its name when it first gets a processor
            expected, end = {"capture", "track", "detect", "map", "stream"}, time.monotonic() + 60
            while time.monotonic() < end and not expected <= (names := self.threads(process)):
                time.sleep(0.05)
            self.assertLessEqual(expected, names)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=300)
        self.assertEqual((process.returncode, out), (DONE, ""), err)

    def test_realtime(self):
        self.check_mode("realtime")

    def test_lockstep(self):
        self.check_mode("lockstep")


if __name__ == "__main__":
    unittest.main()
