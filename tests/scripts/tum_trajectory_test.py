# SPDX-License-Identifier: Apache-2.0
"""tum_trajectory.py: the one reader of trajectories that the scripts share."""
import os
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["STILLMAP_SCRIPTS"])
from tum_trajectory import BadTrajectory, read_trajectory  # noqa: E402


class TumTrajectoryTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name) / "t.txt"

    def read(self, words, least=1):
        self.file.write_text(words)
        return read_trajectory(self.file, least)

    def test_lines_come_in_the_order_of_time_without_comments(self):
        rows = self.read("# header\n2.5 4 5 6 0 0 0 1\n\n1.5 1 2 3 0 0 1 0\n")
        self.assertEqual(rows.tolist(), [[1.5, 1, 2, 3, 0, 0, 1, 0], [2.5, 4, 5, 6, 0, 0, 0, 1]])

    def test_a_single_line_is_a_trajectory(self):
        self.assertEqual(self.read("1 2 3 4 0 0 0 1\n").shape, (1, 8))

    def test_what_is_none_is_refused_in_one_line_that_names_the_file(self):
        for words, least, expected in (("", 1, "holds no trajectory"), ("# only a header\n", 1, "holds no trajectory"),
                                       ("1 2 3 4\n", 1, "tx ty tz qx qy qz qw"), ("1 2 3 4 0 0 0 1\n" * 2, 3, "at least 3"),
                                       ("hello\n", 1, "cannot read"), ("1 2 3 4 0 0 0 1\n1 2\n", 1, "cannot read")):
            with self.subTest(words=words), self.assertRaisesRegex(BadTrajectory, expected) as raised:
                self.read(words, least)
            self.assertIn(str(self.file), str(raised.exception))
        with self.assertRaisesRegex(BadTrajectory, "cannot read"):
            read_trajectory(self.file.parent / "gone.txt")


if __name__ == "__main__":
    unittest.main()
