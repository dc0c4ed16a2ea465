# SPDX-License-Identifier: Apache-2.0
"""check_symbols.py: finds a lock and a sleep in each of the places it looks at, and nothing else."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
sys.path.insert(0, str(SCRIPTS))
from check_symbols import HOT_OBJECTS, HOT_ROOMS  # noqa: E402

HARMLESS = "#include <stdlib.h>\nvoid* f(void) { return malloc(1); }\n"


class CheckSymbolsTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.build = Path(folder.name)
        for room in HOT_ROOMS:
            self.compile(room, HARMLESS)
        for name in HOT_OBJECTS:
            self.compile(name, HARMLESS)

    def compile(self, place, source):
        folder = self.build / "src" / ("runtime/CMakeFiles/stillmap_runtime.dir" if place in HOT_OBJECTS else place)
        folder.mkdir(parents=True, exist_ok=True)
        compiled = folder / f"{place}.cpp.o"
        subprocess.run(["gcc", "-x", "c", "-c", "-", "-o", compiled], input=source, text=True, check=True)
        if place in HOT_ROOMS:
            archive = folder / f"libstillmap_{place}.a"
            archive.unlink(missing_ok=True)
            subprocess.run(["ar", "qc", archive, compiled], check=True)

    def check(self):
        return subprocess.run([sys.executable, "-B", SCRIPTS / "check_symbols.py", self.build], capture_output=True, text=True, check=False)

    def test_clean(self):
        result = self.check()
        self.assertEqual((result.returncode, result.stdout, result.stderr), (0, "", ""))

    def test_each_place(self):
        for place, call in (("track", "pthread_mutex_lock"), ("stream", "nanosleep"), ("threaded", "pthread_cond_wait"), ("core", "usleep"),
                            ("capture", "sem_wait")):
            with self.subTest(place=place):
                self.compile(place, f"void {call}(void);\nvoid f(void) {{ {call}(); }}\n")
                result = self.check()
                self.assertEqual(result.returncode, 1)
                self.assertIn(f"{place}.cpp.o: {call}:", result.stdout)
                self.compile(place, HARMLESS)

    def test_missing_build(self):
        (self.build / "src/map/libstillmap_map.a").unlink()
        result = self.check()
        self.assertEqual(result.returncode, 1)
        self.assertIn("libstillmap_map.a is not there; build first", result.stderr)


if __name__ == "__main__":
    unittest.main()
