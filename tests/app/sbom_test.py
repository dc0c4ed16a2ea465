# SPDX-License-Identifier: Apache-2.0
"""scripts/sbom.py on the program: each library that the loader takes is there, with the version that dpkg knows."""
import json
import os
import re
import subprocess
import sys
import unittest
from pathlib import Path

BIN = os.environ["STILLMAP_BIN"]
SCRIPT = Path(os.environ["STILLMAP_SOURCE_DIR"]) / "scripts/sbom.py"


def output_of(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


class Sbom(unittest.TestCase):
    def test_every_library_has_its_package_and_version(self):
        document = json.loads(output_of(sys.executable, SCRIPT, BIN))
        self.assertEqual((document["bomFormat"], document["specVersion"]), ("CycloneDX", "1.5"))
        listed, direct = set(), set()
        for part in document["components"]:
            files = {p["value"] for p in part["properties"] if p["name"] == "stillmap:file"}
            listed |= files
            if {"name": "stillmap:direct", "value": "true"} in part["properties"]:
                direct.add(part["name"])
            self.assertTrue(files, part)
            self.assertIn(f"{part['name']}@{part['version']}", part["purl"])
        loaded = {str(Path(path).resolve()) for path in re.findall(r"(/\S+) \(0x", output_of("ldd", BIN))}
        self.assertLessEqual(loaded, listed)
        self.assertLess(len(loaded), 25, "libraries that start with the program")
        for name in ("libwebsockets17", "libspng0"):
            self.assertIn(name, direct)
        self.assertNotIn("libblas3", direct)
        web = next(part for part in document["components"] if part["name"] == "libwebsockets17")
        self.assertEqual(web["version"], output_of("dpkg-query", "--show", "--showformat", "${Version}", "libwebsockets17"))

    def test_what_is_no_program_is_refused(self):
        for words, expected in ((["/nowhere/stillmap"], "/nowhere/stillmap is not there"), ([str(SCRIPT)], "readelf"), (["a", "b"], "usage")):
            result = subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True, check=False)
            self.assertEqual((result.returncode, result.stdout), (1, ""))
            self.assertIn(expected, result.stderr)
            self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)


if __name__ == "__main__":
    unittest.main()
