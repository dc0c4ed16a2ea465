# SPDX-License-Identifier: Apache-2.0
"""check_layers.py: finds each kind of forbidden include and call, and lets the allowed ones pass."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "check_layers.py"


class CheckLayersTest(unittest.TestCase):

    def check(self, files):
        """Findings about a tree of these files (name -> text)."""
        with tempfile.TemporaryDirectory() as folder:
            for name, text in ({"src/core/time.h": ""} | files).items():
                path = Path(folder) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            result = subprocess.run([sys.executable, "-B", SCRIPT, folder], capture_output=True, text=True, check=False)
        self.assertEqual(result.stderr, "")
        self.assertEqual(result.returncode, 1 if result.stdout else 0)
        return result.stdout.splitlines()

    def test_allowed(self):
        self.assertEqual(self.check({
            "src/track/a.cpp": '#include "core/time.h"\n#include "track/a.h"\n#include <Eigen/Core>\n#include <vector>\n#include <sys/stat.h>\n',
            "src/eval/a.cpp": "#include <Eigen/SVD>\n",
            "src/runtime/a.cpp": '#include "track/a.h"\n#include "drivers/rgbd_driver.h"\n#include <spdlog/spdlog.h>\n',
            "src/app/main.cpp": '#include "runtime/run.h"\n#include <CLI/CLI.hpp>\nvoid f() { std::printf("x"); }\n',
            "src/detect/a.cpp": "#include <opencv2/dnn.hpp>\n#include <opencv2/core.hpp>\n// std::mutex would sleep(1) here\n",
            "src/stream/a.cpp": '#include "foxglove.pb.h"\nvoid f(char* s) { std::snprintf(s, 1, ""); std::fprintf(stderr, ""); }\n',
            "drivers/tum_log/a.cpp": '#include "drivers/tum_log/a.h"\n#include "drivers/rgbd_driver.h"\n#include "drivers/pictures/png.h"\n',
        }), [])

    def test_each_finding(self):
        for name, text, expected in (
            ("src/track/a.cpp", '#include "map/voxel.h"', "track must not know map"),
            ("src/core/a.h", '#include "track/a.h"', "core must not know track"),
            ("src/map/a.cpp", '#include "runtime/run.h"', "map must not know runtime"),
            ("src/runtime/a.cpp", '#include "app/commands.h"', "runtime must not know app"),
            ("drivers/tum_log/a.cpp", '#include "detect/a.h"', "drivers must not know detect"),
            ("drivers/tum_log/a.cpp", '#include "drivers/v4l2/a.h"', "a driver must not know another"),
            ("src/track/a.cpp", '#include "../map/voxel.h"', "does not begin with a room"),
            ("src/track/a.cpp", '#include "a.h"', "does not begin with a room"),
            ("src/track/a.cpp", '#include "tests/support/a.h"', "does not begin with a room"),
            ("src/new/a.cpp", "", "no room"),
            ("src/map/a.cpp", "#include <opencv2/core.hpp>", "OpenCV stays out of map"),
            ("src/detect/a.h", "#include <opencv2/core.hpp>", "belongs into a .cpp"),
            ("src/map/a.cpp", "#include <Eigen/Core>", "Eigen stays in core, track, eval"),
            ("src/stream/a.cpp", "#include <nlohmann/json.hpp>", "nlohmann-json stays in runtime"),
            ("src/map/a.cpp", "#include <boost/any.hpp>", "no library that"),
            ("src/runtime/a.cpp", "#include <mutex>", "locks and sleeps"),
            ("src/runtime/a.cpp", "std::condition_variable_any v;", "locks and sleeps"),
            ("drivers/tum_log/a.cpp", "std::this_thread::sleep_for(x);", "locks and sleeps"),
            ("src/map/a.cpp", "const std::scoped_lock l(m);", "locks and sleeps"),
            ("src/map/a.cpp", "usleep(3);", "locks and sleeps"),
            ("src/map/a.cpp", "std::cout << 1;", "only app writes to stdout"),
            ("src/map/a.cpp", 'std::printf("x");', "only app writes to stdout"),
        ):
            with self.subTest(name=name, text=text):
                findings = self.check({name: "\n" + text + "\n"})
                self.assertEqual(len(findings), 1, findings)
                self.assertIn(expected, findings[0])
                self.assertTrue(findings[0].startswith(f"{name}:{2 if text else 1}: "), findings[0])

    def test_library_in_two_files(self):
        findings = self.check({"src/detect/a.cpp": "#include <opencv2/dnn.hpp>\n", "src/detect/b.cpp": "#include <opencv2/core.hpp>\n"})
        self.assertEqual(len(findings), 1)
        self.assertIn("src/detect/b.cpp:1: OpenCV is also included by src/detect/a.cpp", findings[0])


if __name__ == "__main__":
    unittest.main()
