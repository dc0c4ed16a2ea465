# SPDX-License-Identifier: Apache-2.0
"""Decodes detectors' outputs with numpy, written from the networks' descriptions and not from our code.

reference_decode.py FAMILY FILE CLASSES PICTURE_W PICTURE_H INPUT_W INPUT_H SCORE IOU
FILE: float32, by FAMILY:
  planar        NanoDet-Plus: for strides 8, 16, 32, 64 the class logits [CLASSES, h, w], then the distances [32, h, w]
  nanodet_plus  [cells of strides 8, 16, 32, 64; CLASSES scores + 32 bins]
  nanodet       [cells of strides 8, 16, 32; CLASSES scores + 32 bins]
  yolov5        [3 x cells of strides 8, 16, 32; cx cy w h object + CLASSES scores]
  yolov8        [cx cy w h + CLASSES scores; cells of strides 8, 16, 32]
  yolox         [cells of strides 8, 16, 32; dx dy log(w) log(h) object + CLASSES scores]
Prints one line a box, the best first: class score x0 y0 x1 y1.
"""
import sys

import numpy as np


def iou(a, b):
    w = min(a[2], b[2]) - max(a[0], b[0])
    h = min(a[3], b[3]) - max(a[1], b[1])
    if w <= 0 or h <= 0:
        return 0.0
    return w * h / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - w * h)


def grid(strides, width, height):
    """Column, row and stride of every cell."""
    cells = [np.stack([*np.meshgrid(np.arange(-(-width // s)), np.arange(-(-height // s))), np.full((-(-height // s), -(-width // s)), s)], -1)
             for s in strides]
    return np.concatenate([c.reshape(-1, 3) for c in cells])


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def boxes_of_distances(bins, at, stride):
    probability = np.exp(bins.reshape(-1, 4, 8))
    probability /= probability.sum(-1, keepdims=True)
    left, top, right, bottom = ((probability * np.arange(8)).sum(-1) * stride[:, None]).T
    return np.stack([at[:, 0] - left, at[:, 1] - top, at[:, 0] + right, at[:, 1] + bottom], -1)


def boxes_of_centres(x, y, w, h):
    return np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], -1)


def outputs(family, data, classes, width, height):
    """Scores [cells, CLASSES] and boxes [cells, 4] in the input."""
    if family == "planar":
        rows = []
        for s in (8, 16, 32, 64):
            n = (width // s) * (height // s)
            part, data = data[:(classes + 32) * n].reshape(-1, n).T, data[(classes + 32) * n:]
            rows.append(np.concatenate([sigmoid(part[:, :classes]), part[:, classes:]], 1))
        data, family = np.concatenate(rows), "nanodet_plus"
    if family in ("nanodet_plus", "nanodet"):
        cells = grid((8, 16, 32, 64) if family == "nanodet_plus" else (8, 16, 32), width, height)
        data = data.reshape(len(cells), classes + 32)
        middle = (cells[:, :2] + (0.5 if family == "nanodet" else 0)) * cells[:, 2:]
        return data[:, :classes], boxes_of_distances(data[:, classes:], middle, cells[:, 2])
    if family == "yolov8":
        data = data.reshape(4 + classes, -1)
        return data[4:].T, boxes_of_centres(*data[:4])
    data = data.reshape(-1, 5 + classes)
    scores = data[:, 4:5] * data[:, 5:]
    if family == "yolov5":
        return scores, boxes_of_centres(*data[:, :4].T)
    cells = grid((8, 16, 32), width, height)
    centre = (data[:, :2] + cells[:, :2]) * cells[:, 2:]
    size = np.exp(data[:, 2:4]) * cells[:, 2:]
    return scores, boxes_of_centres(*centre.T, *size.T)


def main():
    data = np.fromfile(sys.argv[2], np.float32).astype(np.float64)
    classes, picture_w, picture_h, input_w, input_h = map(int, sys.argv[3:8])
    score_threshold, iou_threshold = map(float, sys.argv[8:10])
    scale = min(input_w / picture_w, input_h / picture_h)
    left = (input_w - round(picture_w * scale)) // 2
    top = (input_h - round(picture_h * scale)) // 2
    scores, boxes = outputs(sys.argv[1], data, classes, input_w, input_h)
    boxes = np.clip((boxes - [left, top, left, top]) / scale, 0, [picture_w, picture_h, picture_w, picture_h])
    found = [(scores[i].max(), int(scores[i].argmax()), boxes[i]) for i in np.flatnonzero(scores.max(1) > score_threshold)
             if boxes[i, 2] > boxes[i, 0] and boxes[i, 3] > boxes[i, 1]]
    found.sort(key=lambda f: -f[0])
    kept = []
    for f in found:
        if all(k[1] != f[1] or iou(k[2], f[2]) <= iou_threshold for k in kept):
            kept.append(f)
    for score, which, box in kept[:64]:
        print(which, "%.6f" % score, *("%.4f" % v for v in box))


main()
