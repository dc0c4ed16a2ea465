# SPDX-License-Identifier: Apache-2.0
"""The program that ships is hardened as CMakeLists.txt asks, read back from its headers and symbols; its service is as exposed as
docs/threat-model.md says, and no more."""
import json
import os
import re
import shutil
import subprocess
import unittest
from pathlib import Path

BIN = os.environ["STILLMAP_BIN"]
SOURCE = Path(os.environ["STILLMAP_SOURCE_DIR"])


def readelf(*options):
    return subprocess.run(["readelf", "--wide", *options, BIN], check=True, capture_output=True, text=True).stdout


class HardeningTest(unittest.TestCase):
    def test_loads_anywhere(self):
        self.assertRegex(readelf("--file-header"), r"Type: +DYN \(Position-Independent Executable file\)")

    def test_no_memory_is_both_written_and_executed(self):
        segments = readelf("--segments")
        self.assertRegex(segments, r"GNU_STACK +(0x0+ ?)+ +(0x0+ +)+RW +")
        self.assertNotRegex(segments, r" RWE ")

    def test_library_addresses_are_read_only_before_main(self):
        self.assertIn("GNU_RELRO", readelf("--segments"))
        self.assertRegex(readelf("--dynamic"), r"\(FLAGS_1\) +Flags: .*\bNOW\b")

    def test_calls_check_their_bounds(self):
        symbols = readelf("--dyn-syms")
        self.assertIn("__stack_chk_fail", symbols)
        self.assertRegex(symbols, r"__(memcpy|memmove|snprintf|vsnprintf|read|recv|fread|strncpy)_chk")

    @unittest.skipUnless(shutil.which("systemd-analyze"), "no systemd-analyze")
    def test_the_service_is_exposed_as_its_threat_model_says(self):
        command = ["systemd-analyze", "security", "--offline=yes", SOURCE / "firmware-config/systemd/stillmap.service"]
        judged = json.loads(subprocess.run([*command, "--json=short"], check=True, capture_output=True, text=True).stdout)
        exposed = {item["name"]: item["exposure"] for item in judged if float(item["exposure"] or 0) > 0}
        page = (SOURCE / "docs/threat-model.md").read_text()
        self.assertEqual(exposed, {name.replace("\\", ""): score for name, score in re.findall(r"^\| (\S+=\S*) \| ([\d.]+) \|", page, re.M)})
        told = re.search(r"exposure of ([\d.]+) of 10", page)[1]
        subprocess.run([*command, f"--threshold={10 * float(told):.0f}"], check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    unittest.main()
