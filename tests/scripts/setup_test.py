# SPDX-License-Identifier: Apache-2.0
"""setup.sh: what it asks apt-get for, and its words where it cannot, with stand-ins for the system's commands."""
import os
import stat
import subprocess
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(os.environ["STILLMAP_SCRIPTS"]) / "setup.sh"


class SetupTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        for tool in ("bash", "env", "dirname", "mktemp", "rm", "tail", "grep"):
            (self.path / tool).symlink_to(f"/usr/bin/{tool}")
        (self.path / "release").write_text("ID=debian\nVERSION_CODENAME=bookworm\n")
        self.command("id", "echo 0")
        self.command("uname", "echo x86_64")
        self.installed()
        self.command("apt-get", f'echo "$*" >> {self.path}/asked')

    def command(self, name, text):
        path = self.path / name
        path.write_text(f"#!/usr/bin/bash\n{text}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def installed(self, *without):
        """All packages are there but these; None: none is."""
        wanted = " | ".join(without) or "-"
        self.command("dpkg-query", f'case ${{!#}} in {wanted}) exit 1 ;; esac; echo installed')

    def setup(self, *arguments):
        return subprocess.run(["/usr/bin/bash", SCRIPT, *arguments], capture_output=True, text=True, check=False,
                              env={"PATH": str(self.path), "STILLMAP_OS_RELEASE": str(self.path / "release")})

    def asked(self):
        return (self.path / "asked").read_text().splitlines() if (self.path / "asked").exists() else []

    def refused(self, result, words):
        self.assertEqual(result.returncode, 1)
        self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)
        self.assertIn(words, result.stderr)
        self.assertEqual(self.asked(), [])

    def test_nothing_missing_is_quiet(self):
        self.command("id", "echo 1000")  # nothing to install needs no root
        result = self.setup()
        self.assertEqual((result.returncode, result.stdout, result.stderr), (0, "", ""))
        self.assertEqual(self.asked(), [])

    def test_only_the_missing(self):
        self.installed("libspng-dev", "ninja-build", "shellcheck")
        result = self.setup()
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(self.asked(), ["-qq update", "-qq install --yes --no-install-recommends ninja-build libspng-dev"])

    def test_tests_need_more(self):
        self.installed("shellcheck", "nodejs", "npm", "chromium")
        self.assertEqual(self.setup("--tests").returncode, 0)
        self.assertTrue(self.asked()[1].endswith("recommends shellcheck nodejs npm chromium"), self.asked())
        (self.path / "asked").unlink()
        for tool in ("node", "npm", "chromium"):
            self.command(tool, "")
        self.assertEqual(self.setup("--tests").returncode, 0)
        self.assertTrue(self.asked()[1].endswith("recommends shellcheck"), self.asked())

    def test_virtual_machine_is_the_machines_own_kind(self):
        self.installed("qemu-system-x86", "qemu-system-arm")
        for machine, asked in (("x86_64", "qemu-system-x86"), ("aarch64", "qemu-system-arm")):
            self.command("uname", f"echo {machine}")
            self.assertEqual(self.setup("--tests").returncode, 0)
            self.assertTrue(self.asked()[-1].endswith(f"recommends {asked}"), self.asked())

    def test_the_full_tests_need_most(self):
        self.installed("shellcheck", "lintian", "qemu-user", "linux-source-6.1")
        for tool in ("node", "npm", "chromium"):
            self.command(tool, "")
        self.assertEqual(self.setup("--full").returncode, 0)
        self.assertTrue(self.asked()[1].endswith("recommends qemu-user lintian shellcheck linux-source-6.1"), self.asked())

    def test_arm_needs_its_compilers(self):
        self.installed("g++-arm-linux-gnueabihf", "shellcheck")
        self.assertEqual(self.setup("--arm").returncode, 0)
        self.assertTrue(self.asked()[1].endswith("recommends g++-arm-linux-gnueabihf"), self.asked())

    def test_sudo_where_not_root(self):
        self.installed("cmake")
        self.command("id", "echo 1000")
        self.command("sudo", '"$@"')
        self.assertEqual(self.setup().returncode, 0)
        self.assertEqual(len(self.asked()), 2)

    def test_refusals(self):
        self.refused(self.setup("--all"), "usage: setup.sh [--arm|--tests|--full|--bench]")
        self.installed("cmake")
        self.command("id", "echo 1000")
        self.refused(self.setup(), "there is no sudo; run as root: apt-get install --no-install-recommends cmake")
        (self.path / "release").write_text("ID=ubuntu\nVERSION_CODENAME=noble\n")
        self.refused(self.setup(), "this is not Debian 12")
        (self.path / "release").unlink()
        self.refused(self.setup(), "this is not Debian 12")

    def test_failing_installation(self):
        self.installed("cmake")
        self.command("apt-get", "echo E: no such host; exit 100")
        result = self.setup()
        self.assertEqual(result.returncode, 1)
        self.assertIn("E: no such host", result.stderr)
        self.assertIn("apt-get could not install", result.stderr.splitlines()[-1])

    def test_failing_update_is_no_reason(self):
        self.installed("cmake")
        self.command("apt-get", '[ "$2" != update ]')
        self.assertEqual(self.setup().returncode, 0)


if __name__ == "__main__":
    unittest.main()
