# SPDX-License-Identifier: Apache-2.0
"""What a person runs answers --help and refuses wrong arguments at once, before it installs or builds anything."""
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
RUN_BY_PEOPLE = [path for path in sorted(SCRIPTS.glob("*.sh")) if os.access(path, os.X_OK)]


class ArgumentsTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        for tool in ("bash", "dirname", "basename", "sed", "python3", "nproc", "ls"):
            (self.path / tool).symlink_to(f"/usr/bin/{tool}")
        for tool in ("cmake", "dpkg-query", "apt-get", "curl", "mkdir"):
            command = self.path / tool
            command.write_text(f"#!/usr/bin/bash\necho {tool} >>{self.path}/started\nexit 1\n")
            command.chmod(0o755)

    def run_script(self, script, *arguments):
        (self.path / "started").unlink(missing_ok=True)
        result = subprocess.run(["/usr/bin/bash", script, *arguments], capture_output=True, text=True, timeout=60, cwd=self.path,
                                env={"PATH": str(self.path), "HOME": str(self.path)})
        self.assertFalse((self.path / "started").exists(), f"{script.name} {arguments}: something was started")
        return result

    def test_help_is_the_head_of_the_script(self):
        self.assertGreater(len(RUN_BY_PEOPLE), 8)
        for script in RUN_BY_PEOPLE:
            for help_option in ("--help", "-h"):
                with self.subTest(script=script.name, option=help_option):
                    result = self.run_script(script, help_option)
                    self.assertEqual((result.returncode, result.stderr), (0, ""))
                    self.assertIn(f"\n  {script.name}", result.stdout)
                    self.assertNotIn("SPDX", result.stdout)
                    self.assertNotIn("shellcheck", result.stdout)

    def test_wrong_arguments_come_before_the_build(self):
        for name, arguments, words in (("evaluate.sh", ["--seeds", "0", "log"], "--seeds"), ("evaluate.sh", [], "DIR"),
                                       ("evaluate.sh", ["/none"], "/none holds no groundtruth.txt"), ("bench.sh", ["--fly"], "--fly"),
                                       ("bench.sh", ["--runs", "x"], "--runs"), ("test.sh", ["--fast"], "usage: test.sh [--full]"),
                                       ("demo.sh", ["--frames", "0"], "usage: demo.sh"), ("setup.sh", ["--all"], "usage: setup.sh"),
                                       ("fuzz.sh", ["soon"], "usage: fuzz.sh"), ("get_tum.sh", [], "usage: get_tum.sh")):
            with self.subTest(script=name, arguments=arguments):
                result = self.run_script(SCRIPTS / name, *arguments)
                self.assertNotEqual(result.returncode, 0)
                self.assertIn(words, result.stderr)


if __name__ == "__main__":
    unittest.main()
