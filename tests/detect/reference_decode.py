# SPDX-License-Identifier: Apache-2.0
"""Decodes NanoDet-Plus outputs with numpy, written from the network's description and not from our code.

reference_decode.py FILE CLASSES PICTURE_W PICTURE_H INPUT_W INPUT_H SCORE IOU
FILE: float32, for strides 8, 16, 32, 64 the class logits [CLASSES, h, w], then the distances [32, h, w].
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


def main():
    data = np.fromfile(sys.argv[1], np.float32).astype(np.float64)
    classes, picture_w, picture_h, input_w, input_h = map(int, sys.argv[2:7])
    score_threshold, iou_threshold = map(float, sys.argv[7:9])
    scale = min(input_w / picture_w, input_h / picture_h)
    left = (input_w - round(picture_w * scale)) // 2
    top = (input_h - round(picture_h * scale)) // 2
    found = []
    for stride in (8, 16, 32, 64):
        h, w = input_h // stride, input_w // stride
        logits, data = data[: classes * h * w].reshape(classes, h, w), data[classes * h * w:]
        bins, data = data[: 32 * h * w].reshape(4, 8, h, w), data[32 * h * w:]
        probability = np.exp(bins) / np.exp(bins).sum(axis=1, keepdims=True)
        distance = np.tensordot(np.arange(8.0), probability, axes=(0, 1)) * stride
        score = 1 / (1 + np.exp(-logits.max(axis=0)))
        for y, x in zip(*np.nonzero(score > score_threshold)):
            l, t, r, b = distance[:, y, x]
            box = np.array([x * stride - l, y * stride - t, x * stride + r, y * stride + b])
            box = (box - [left, top, left, top]) / scale
            box = np.clip(box, 0, [picture_w, picture_h, picture_w, picture_h])
            if box[2] > box[0] and box[3] > box[1]:
                found.append((score[y, x], int(logits[:, y, x].argmax()), box))
    found.sort(key=lambda f: -f[0])
    kept = []
    for f in found:
        if all(k[1] != f[1] or iou(k[2], f[2]) <= iou_threshold for k in kept):
            kept.append(f)
    for score, which, box in kept[:64]:
        print(which, "%.6f" % score, *("%.4f" % v for v in box))


main()
