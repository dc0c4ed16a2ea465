# SPDX-License-Identifier: Apache-2.0
"""The demo network finds the people of rendered logs, in the OpenCV that the runtime uses."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import cv2
import numpy as np

SCRIPTS, SYNTH = Path(os.environ["STILLMAP_SCRIPTS"]), os.environ["STILLMAP_SYNTH"]
WIDTH, HEIGHT, BINS = 320, 256, 8
MEAN, STD = np.array([103.53, 116.28, 123.675]), np.array([57.375, 57.12, 58.395])
STRIDES = (8, 16, 32, 64)
SCORE, NMS_IOU = 0.5, 0.6  # as firmware-config/demo.toml and the default have it


def make_model(out):
    subprocess.run([sys.executable, SCRIPTS / "make_demo_model.py", out], check=True)
    return out


def overlap(a, b):
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    common = max(0, width) * max(0, height)
    return common / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - common)


class Detector:
    """The runtime's way from picture to boxes, written a second time and simply."""

    def __init__(self, file):
        self.net = cv2.dnn.readNetFromONNX(str(file))
        names = self.net.getLayerNames()
        self.names = {f"{kind}_{s}": next(n for n in names if n.endswith(f"deq_{kind}_{s}")) for kind in ("cls", "reg") for s in STRIDES}

    def outputs(self, picture):
        scale = min(WIDTH / picture.shape[1], HEIGHT / picture.shape[0])
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        left, top = (WIDTH - small.shape[1]) // 2, (HEIGHT - small.shape[0]) // 2
        box = np.zeros((HEIGHT, WIDTH, 3))
        box[top:top + small.shape[0], left:left + small.shape[1]] = small
        self.net.setInput(((box - MEAN) / STD).transpose(2, 0, 1)[None].astype(np.float32))
        return dict(zip(self.names, self.net.forward(list(self.names.values())))), scale, left, top

    def boxes(self, picture):
        outputs, scale, left, top = self.outputs(picture)
        found = []
        for s in STRIDES:
            score = 1 / (1 + np.exp(-outputs[f"cls_{s}"][0, 0]))
            bins = np.exp(outputs[f"reg_{s}"][0].reshape(4, BINS, *score.shape))
            distance = s * (bins * np.arange(BINS)[:, None, None]).sum(1) / bins.sum(1)
            for y, x in zip(*np.where(score > SCORE)):
                l, t, r, b = distance[:, y, x]
                box = (np.array([x * s - l, y * s - t, x * s + r, y * s + b]) - [left, top, left, top]) / scale
                found.append((score[y, x], box.clip(0, [picture.shape[1], picture.shape[0]] * 2)))
        kept = []
        for _, box in sorted(found, key=lambda f: -f[0]):
            if all(overlap(box, other) <= NMS_IOU for other in kept):
                kept.append(box)
        return kept


class DemoModelTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = Path(cls.folder.name)
        cls.model = make_model(cls.path / "demo.onnx")
        cls.detector = Detector(cls.model)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_same_bytes_every_time(self):
        self.assertEqual(make_model(self.path / "again.onnx").read_bytes(), self.model.read_bytes())

    def test_outputs_have_the_layout_of_nanodet_plus(self):
        outputs = self.detector.outputs(np.zeros((480, 640, 3), np.uint8))[0]
        for s in STRIDES:
            self.assertEqual(outputs[f"cls_{s}"].shape, (1, 1, HEIGHT // s, WIDTH // s))
            self.assertEqual(outputs[f"reg_{s}"].shape, (1, 4 * BINS, HEIGHT // s, WIDTH // s))

    def test_nobody_in_plain_pictures(self):
        for colour in ((0, 0, 0), (255, 255, 255), (128, 128, 128), (0, 0, 255), (255, 0, 0), (95, 90, 20)):
            self.assertEqual(self.detector.boxes(np.full((480, 640, 3), colour, np.uint8)), [], colour)

    def test_box_grows_with_the_vest(self):
        heights = []
        for size in (40, 80, 160):
            picture = np.full((480, 640, 3), 120, np.uint8)
            picture[150:150 + size, 300:300 + size * 6 // 10] = (36, 236, 196)
            boxes = self.detector.boxes(picture)
            self.assertTrue(boxes, size)
            top, bottom = min(b[1] for b in boxes), max(b[3] for b in boxes)
            self.assertLess(top, 150 - 0.2 * size)  # a head above
            self.assertGreater(bottom, min(480, 150 + 2 * size) - 1)  # legs below
            heights.append(np.mean([b[3] - b[1] for b in boxes]))
        self.assertTrue(heights[0] * 1.4 < heights[1] < heights[2] / 1.3, heights)

    def test_finds_people_of_rendered_logs(self):
        figures = covered = frames = frames_with_false = 0
        for seed, path in ((1, "orbit"), (2, "walk"), (3, "rotate")):
            log = self.path / path
            subprocess.run([SYNTH, "--out", log, "--seed", str(seed), "--path", path, "--frames", "60"], check=True)
            for file in sorted((log / "rgb").iterdir())[::3]:
                mask = cv2.imread(str(log / "mask" / (file.stem + ".png")), cv2.IMREAD_UNCHANGED)
                boxes = self.detector.boxes(cv2.imread(str(file)))
                inside = np.zeros(mask.shape, bool)
                for x0, y0, x1, y1 in boxes:
                    inside[int(y0):int(np.ceil(y1)), int(x0):int(np.ceil(x1))] = True
                people = []
                for k in np.unique(mask[mask > 0]):
                    ys, xs = np.where(mask == k)
                    people.append((xs.min(), ys.min(), xs.max() + 1, ys.max() + 1))
                    if len(xs) > 6000:
                        figures += 1
                        covered += inside[ys, xs].mean() >= 0.6
                frames += 1
                frames_with_false += any(all(overlap(b, p) < 0.1 for p in people) for b in boxes)
        print(f"recall {covered}/{figures}, frames with a false box {frames_with_false}/{frames}")
        self.assertGreater(figures, 40)
        self.assertGreaterEqual(covered, 0.85 * figures)
        self.assertLess(frames_with_false, 0.05 * frames)


if __name__ == "__main__":
    unittest.main()
