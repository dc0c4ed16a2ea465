# SPDX-License-Identifier: Apache-2.0
"""The machine around a run is against it: a wall clock that jumps, a disk that turns read-only or slow, a model that is
replaced, an address space that is closed, a log that nobody reads. Calls of the C library are answered by hostile_world.cpp."""
import os
import resource
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

from program import DETECTOR, DONE, MODEL, PROGRAM, RUN_FAILED, run_args, stillmap
from running import RunningTest

sys.path.insert(0, os.environ["STILLMAP_SOURCE_DIR"] + "/scripts")
from stream_client import StreamClient  # noqa: E402

WORLD = os.environ["STILLMAP_HOSTILE_WORLD"]


class HostileWorld(RunningTest):
    def test_the_wall_clock_is_nobodys_business(self):
        jumping = {**os.environ, "LD_PRELOAD": WORLD, "STILLMAP_TEST_CLOCK": "1"}
        looks = subprocess.run(["/usr/bin/python3", "-c", "import time; print(abs(time.time() - time.time()) > 3600)"], env=jumping,
                               capture_output=True, text=True, check=True)
        self.assertEqual(looks.stdout, "True\n", "the clock does not jump")
        files = {}
        for environment in (os.environ, jumping):
            folder = self.path / str(len(files))
            args = run_args("--mode", "lockstep", "--duration", "0.4", *self.outputs(folder), detector=DETECTOR)
            subprocess.run([PROGRAM, *args], env=environment, check=True, capture_output=True)
            files[folder] = [(folder / name).read_bytes() for name in ("t.txt", "f.txt", "m.ply")]
        self.assertEqual(*files.values())
        process = self.start("--report", self.path / "r.json", environment={"LD_PRELOAD": WORLD, "STILLMAP_TEST_CLOCK": "1"})
        self.wait_for_frames(20)
        code, said = self.stop(process)
        self.assertEqual(code, DONE, said)
        facts = self.report()
        self.assertEqual(facts["frames"]["dropped"].get("time_jump", 0), 0)
        self.assertEqual(facts["tracking"]["lost"], 0)

    def wait_for_refused_map(self):
        before = self.says("checkpoint: ")
        self.wait_for(lambda: self.says("checkpoint: ") > before)

    def test_a_disk_turns_slow_and_read_only_and_well_again(self):
        disk, record, map_file = self.path / "disk", self.path / "record", self.path / "m.stillmap"
        disk.write_text("-")
        process = self.start("--record", record, "--map", map_file, "--report", self.path / "r.json", "--set", "map.checkpoint_s=0.1",
                             environment={"LD_PRELOAD": WORLD, "STILLMAP_TEST_DISK": str(disk)})
        self.wait_for(map_file.exists)
        for state in "srsr":
            with open(disk, "r+") as file:
                file.write(state)
            self.wait_for_frames(15)
        self.wait_for_refused_map()  # what was being written before is done
        map_before = map_file.read_bytes()
        self.wait_for_refused_map()
        self.assertEqual(map_file.read_bytes(), map_before, "what could not be written leaves the map before")
        with open(disk, "r+") as file:
            file.write("-")
        self.wait_for(lambda: map_file.read_bytes() != map_before)
        code, said = self.stop(process)
        self.assertEqual(code, RUN_FAILED, said)  # frames are missing in the recording
        self.assertRegex(said.splitlines()[-1], r"^stillmap: --record .*: \d+ frames could not be written")
        facts = self.report()
        self.assertEqual(facts["frames"]["dropped"].get("no_free_slot", 0), 0)
        kept = facts["record"]
        self.assertGreater(kept["failed"], 0)
        self.assertEqual(kept["frames"] + kept["failed"] + kept["left_out"], facts["frames"]["offered"])
        self.assertEqual((record / "associations.txt").read_text().count("\n"), kept["frames"])
        self.assertEqual(stillmap(*run_args("--mode", "lockstep", log=record)).returncode, DONE)
        self.assertEqual(stillmap("map", "info", map_file).returncode, DONE)
        self.assertEqual(list(self.path.glob("*.tmp")), [])

    def test_a_log_on_a_disk_that_turns_slow_costs_time_and_nothing_else(self):
        disk = self.path / "disk"
        disk.write_text("-")
        process = self.start(*self.outputs(), environment={"LD_PRELOAD": WORLD, "STILLMAP_TEST_DISK": str(disk)})
        for state in "l-l":
            with open(disk, "r+") as file:  # the program has it in its memory: it must not be empty for a moment
                file.write(state)
            self.wait_for_frames(8)
        code, said = self.stop(process)
        self.assertEqual(code, DONE, said)
        facts = self.report()
        frames = facts["frames"]
        self.assertEqual(frames["offered"], frames["processed"] + sum(frames["dropped"].values()))
        self.assertEqual(facts["tracking"]["lost"], 0)

    def test_a_model_that_is_replaced_is_not_looked_at_again(self):
        model = self.path / "net.onnx"
        shutil.copy(MODEL, model)
        sums = {}
        for name in ("before", "replaced"):
            process = self.start("--report", self.path / "r.json", detector=[*DETECTOR, "--set", f"detector.model={model}"])
            if name == "replaced":
                model.write_bytes(b"no network")  # in place, and then by another file
                (self.path / "other").write_bytes(b"none either")
                os.replace(self.path / "other", model)
            runs = self.count("stillmap_detector_runs_total")
            self.wait_for(lambda: self.count("stillmap_detector_runs_total") > runs + 3)
            code, said = self.stop(process)
            self.assertEqual(code, DONE, said)
            self.assertNotIn("detector_failed", said)
            sums[name] = self.report()["model_sha256"]
        self.assertEqual(sums["before"], sums["replaced"])

    def test_an_address_space_that_is_closed_costs_the_detector_at_most(self):
        process = self.start(*self.outputs())
        pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[0])
        resource.prlimit(process.pid, resource.RLIMIT_AS, (pages * resource.getpagesize(), resource.RLIM_INFINITY))
        self.wait_for_frames(30)
        resource.prlimit(process.pid, resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        self.wait_for_frames(10)
        code, said = self.stop(process)
        self.assertEqual(code, DONE, said)
        facts = self.report()
        self.assertEqual(facts["tracking"]["lost"], 0)
        self.assertEqual(facts["frames"]["dropped"].get("no_free_slot", 0), 0)

    def test_a_reader_of_stderr_that_stops_holds_up_nobody(self):
        process = self.start("--report", self.path / "r.json", "--map", self.path / "m.ply")
        os.set_blocking(process.stderr.fileno(), False)

        def fill():
            pipe = os.open(f"/proc/{process.pid}/fd/2", os.O_WRONLY | os.O_NONBLOCK)
            self.addCleanup(os.close, pipe)
            try:
                while True:
                    os.write(pipe, b".")
            except BlockingIOError:
                pass

        def make_event():
            client = StreamClient("127.0.0.1", int(self.metrics.split(":")[2].split("/")[0]))
            client.start()
            client.socket.close()

        def read():
            try:
                return os.read(process.stderr.fileno(), 1 << 20)
            except BlockingIOError:
                return b""

        fill()
        make_event()
        self.wait_for_frames(40)
        heard = []

        def heard_of_it():
            heard.append(read())
            make_event()
            return b"messages are missing here: nobody read stderr" in b"".join(heard)

        self.wait_for(heard_of_it)
        fill()
        process.terminate()
        self.assertEqual(process.wait(timeout=60), DONE)
        facts = self.report()
        self.assertEqual(facts["frames"]["offered"], facts["frames"]["processed"] + sum(facts["frames"]["dropped"].values()))
        self.assertTrue((self.path / "m.ply").exists())

    def run_within(self, megabytes, *args):
        def limit():
            resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
        return subprocess.run([PROGRAM, *args], capture_output=True, text=True, timeout=300, preexec_fn=limit)

    def test_too_little_memory_is_a_clear_refusal(self):
        self.assert_error(self.run_within(57, *run_args("--mode", "lockstep")), RUN_FAILED, "out of memory", "stillmap plan")

    def test_at_any_limit_it_runs_or_is_refused_in_one_line(self):
        """From where the libraries just load to where it runs, and the last steps to there in more detail."""
        def runs(megabytes):
            args = run_args("--mode", "realtime", "--duration", "0.05", detector=DETECTOR, listen=["--listen", "127.0.0.1:0"])
            result = self.run_within(megabytes, *args)
            linked = result.returncode != 127  # the dynamic linker's word
            if linked and result.returncode != DONE:
                with self.subTest(megabytes=megabytes):
                    self.assert_error(result, RUN_FAILED, "out of memory")
            return linked and result.returncode == DONE
        enough = next(megabytes for megabytes in range(28, 600, 8) if runs(megabytes))
        self.assertGreater(enough, 60)
        for megabytes in range(enough - 7, enough + 10):  # how much is enough is a little chance, that the refusal is clear is not
            runs(megabytes)
        self.assertTrue(runs(enough + 32))


if __name__ == "__main__":
    unittest.main()
