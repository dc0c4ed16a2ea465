# SPDX-License-Identifier: Apache-2.0
"""A processor that is throttled: the program is stopped and let go on every 5 ms, so that it has half of the time. What is given up
for that, in which order, and that all of it comes back."""
import json
import os
import re
import signal
import threading
import time
import unittest

from program import DETECTOR, DONE, run_args, stillmap
from running import RunningTest

# What src/runtime/load_shedder.h promises.
PLAN = ["full quality", "detector on every 3rd frame", "detector on every 6th frame", "three quarters of the features",
        "half the features", "half the fusion", "a quarter of the fusion"]
SLICE_S = 0.005
PATIENCE = 2 * 6 * 90 * 8  # frames: twice what six steps back may take each, as src/runtime/load_shedder.h has it


def before_others(priority):
    """Nobody else's work counts, where that is allowed."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        pass


class Throttle(threading.Thread):
    """Halves a process's time while `half` is set."""

    def __init__(self, process):
        super().__init__(daemon=True)
        self.process, self.half, self.going = process, False, True

    def run(self):
        before_others(11)
        while self.going:
            if self.half:
                self.process.send_signal(signal.SIGSTOP)
                time.sleep(SLICE_S)
                self.process.send_signal(signal.SIGCONT)
            time.sleep(SLICE_S)


class Throttling(RunningTest):
    def steps(self):
        """The plan's steps that were told so far, from full quality on."""
        told = [re.search(r"quality_(?:lowered|raised) at frame \d+: to (.*), since ", line) for line in list(self.said)]
        return [0] + [PLAN.index(match[1]) for match in told if match]

    def share_detected(self, frames):
        """Of so many frames from now on, how many go through the detector."""
        seen, runs = self.frames(), self.count("stillmap_detector_runs_total")
        self.wait_for(lambda: self.frames() >= seen + frames)
        return (self.count("stillmap_detector_runs_total") - runs) / (self.frames() - seen)

    def frame_rate(self):
        """So many frames a second that the tracker is busy for a little more than half of the time at full quality."""
        report = self.path / "alone.json"
        alone = stillmap(*run_args("--mode", "realtime", "--report", report, detector=DETECTOR))
        self.assertEqual(alone.returncode, DONE, alone.stderr)
        return round(min(550 / json.loads(report.read_text())["latency_ms"]["track"]["p50"], 120))

    def test_half_the_time_sheds_in_order_and_all_comes_back(self):
        before_others(10)  # the program's threads, too, as its children have it
        rate = self.frame_rate()
        process = self.start(*self.outputs(), "--set", f"camera.fps={rate}", "--set", "map.fuse_every=6", fps=rate)
        self.wait_for_frames(3 * rate)
        if self.count("stillmap_shedding_step") != 0:
            self.skipTest("others leave too little of this machine")
        at_full = self.share_detected(2 * rate)

        throttle = Throttle(process)
        throttle.start()
        self.addCleanup(lambda: setattr(throttle, "going", False))
        throttle.half, begin = True, time.monotonic()
        self.wait_for(lambda: self.count("stillmap_shedding_step") >= 3)
        shed = self.share_detected(2 * rate)
        self.assertLess(shed, at_full / 2)
        lowest = max(self.steps())
        throttled_s, throttle.half, begin = time.monotonic() - begin, False, time.monotonic()

        last = self.count("stillmap_frames_offered_total") + PATIENCE
        is_back = lambda: self.count("stillmap_shedding_step") == 0
        while not is_back() and self.count("stillmap_frames_offered_total") < last:
            time.sleep(0.1)
        was_back, recovered_s = is_back(), time.monotonic() - begin
        throttle.going = False
        throttle.join()
        code, said = self.stop(process)
        self.assertEqual(code, DONE, said)

        steps, facts = self.steps(), self.report()
        # One step at a time: whatever is given up, what comes before it in the plan was, and comes back later.
        self.assertEqual({abs(after - before) for before, after in zip(steps, steps[1:])}, {1}, steps)
        self.assertGreaterEqual(lowest, 3)  # the detector first, then features
        self.assertIn(lowest - 1, steps[steps.index(lowest):], "something was taken back")
        self.assertGreater(facts["shedding"]["frames_shed"], 0)
        self.assertEqual(facts["tracking"]["lost"], 0)
        if not was_back:
            self.skipTest(f"others leave too little of this machine: steps {steps}")
        print(f"{rate} frames a second; half the time for {throttled_s:.1f} s: steps {steps}, the lowest {PLAN[lowest]}; detector on"
              f" {at_full:.2f} of the frames, then {shed:.2f}; back after {recovered_s:.1f} s; dropped {facts['frames']['dropped']}")


if __name__ == "__main__":
    unittest.main()
