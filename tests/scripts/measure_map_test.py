# SPDX-License-Identifier: Apache-2.0
"""measure_map.py: what it counts, on points whose ghosts are known."""
import os
import sys
import tempfile
import unittest
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, os.environ["STILLMAP_SCRIPTS"])
import measure_map  # noqa: E402

EDGE_M = 0.04


def cells(x, y, z):
    """The centres of the cells with these indices."""
    return (np.stack(np.meshgrid(x, y, z), -1).reshape(-1, 3) + 0.5) * EDGE_M


class MeasureMapTest(unittest.TestCase):
    def setUp(self):
        self.wall = cells(np.arange(50), np.arange(50), [0])
        self.walkers = cKDTree(cells([10, 11], np.arange(20), [3, 4, 20]))

    def measure(self, points):
        names = measure_map.HEAD[2:9]
        truth = cKDTree(self.wall)
        return {name: float(value) for name, value in zip(names, measure_map.measure(points, self.walkers, truth, truth, EDGE_M))}

    def test_a_perfect_map(self):
        found = self.measure(self.wall)
        self.assertEqual((found["voxels"], found["ghosts"], found["recall %"], found["F %"]), (2500, 0, 100, 100))

    def test_only_what_is_at_a_person_and_away_from_the_wall_is_a_ghost(self):
        ghosts, at_the_wall, noise = cells([10], np.arange(20), [20]), cells([10], [3], [2]), cells([40], [40], [20])
        found = self.measure(np.concatenate([self.wall, ghosts, at_the_wall, noise]))
        self.assertEqual(found["ghosts"], 20)
        self.assertAlmostEqual(found["litres"], 20 * 0.064, 2)
        self.assertAlmostEqual(found["share %"], 100 * 20 / 2522, 2)
        self.assertAlmostEqual(found["precision %"], 100 * 2500 / 2522, 1)

    def test_what_is_missing_costs_recall(self):
        found = self.measure(self.wall[self.wall[:, 0] < 1])
        self.assertAlmostEqual(found["recall %"], 52, delta=0.1)  # half, and the column within 5 cm of it

    def test_a_camera_that_only_turns_is_aligned(self):
        angles = np.linspace(0, 1, 11)
        turn = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in angles])
        offset = turn[7] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        own = (angles, turn, np.zeros((11, 3)))
        true = (angles, offset @ turn, np.full((11, 3), 2.0))
        rotation, position = measure_map.alignment(own, true)
        np.testing.assert_allclose(rotation, offset, atol=1e-9)
        np.testing.assert_allclose(position, [2, 2, 2], atol=1e-9)

    def test_hidden_is_what_people_and_the_shadows_of_their_depth_cover(self):
        with tempfile.TemporaryDirectory() as folder:
            empty, walkers = Path(folder) / "empty", Path(folder) / "walkers"
            for log, depth in ((empty, [[10, 20, 30, 0]]), (walkers, [[5, 0, 30, 0]])):
                for part in ("rgb", "depth", "mask"):
                    (log / part).mkdir(parents=True)
                (log / "associations.txt").write_text("1.5 rgb/1.5.png 1.6 depth/1.6.png\n", encoding="utf-8")
                cv2.imwrite(str(log / "depth/1.6.png"), np.array(depth, np.uint16))
                cv2.imwrite(str(log / "mask/1.5.png"), np.array([[1, 0, 0, 0]], np.uint8))
            hidden = measure_map.hide_people(empty, walkers, Path(folder) / "hidden")
            left = cv2.imread(str(hidden / "depth/1.6.png"), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(left, [[0, 0, 30, 0]])


if __name__ == "__main__":
    unittest.main()
