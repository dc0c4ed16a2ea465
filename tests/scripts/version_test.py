# SPDX-License-Identifier: Apache-2.0
"""src/runtime/version.cmake: each build notes the revision that it is of, and is made anew only where that is another."""
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

RUNTIME = Path(os.environ["STILLMAP_SCRIPTS"]).parent / "src/runtime"

class VersionTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.sources, self.made = Path(folder.name) / "sources", Path(folder.name) / "version.cpp"
        self.sources.mkdir()
        (self.sources / "file").write_text("one")

    def git(self, *args):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *args], cwd=self.sources, check=True, capture_output=True)

    def build(self, git="git"):
        """The revision that one build notes, and whether it wrote the file."""
        before = self.made.stat().st_mtime_ns if self.made.exists() else 0
        subprocess.run(["cmake", f"-DGIT={git}", "-DVERSION=1.2.3", f"-DINPUT={RUNTIME}/version.cpp.in", f"-DOUTPUT={self.made}",
                        "-P", RUNTIME / "version.cmake"], cwd=self.sources, check=True, capture_output=True)
        text = self.made.read_text()
        self.assertIn('kVersion = "1.2.3"', text)
        return text.split('kGitRevision = "')[1].split('"')[0], self.made.stat().st_mtime_ns != before

    def test_the_revision_is_the_builds_own(self):
        self.git("init")
        self.git("add", "file")
        self.git("commit", "-m", "one")
        first, _ = self.build()
        self.assertRegex(first, "^[0-9a-f]{12}$")
        self.assertEqual(self.build(), (first, False))
        (self.sources / "file").write_text("two")
        self.assertEqual(self.build(), (first + "-dirty", True))
        self.git("commit", "-am", "two")
        second, written = self.build()
        self.assertRegex(second, "^[0-9a-f]{12}$")
        self.assertTrue(written and second != first)

    def test_without_git_it_is_unknown(self):
        self.assertEqual(self.build()[0], "unknown")
        self.assertEqual(self.build(git="")[0], "unknown")


if __name__ == "__main__":
    unittest.main()
