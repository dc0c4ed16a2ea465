# SPDX-License-Identifier: Apache-2.0
"""The program that ships is hardened as CMakeLists.txt asks, read back from its headers and symbols."""
import os
import subprocess
import unittest

BIN = os.environ["STILLMAP_BIN"]


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


if __name__ == "__main__":
    unittest.main()
