#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the demo network: an int8 ONNX file with hand-made weights that finds people by their safety vests.

    make_demo_model.py OUT.onnx

It has NanoDet-Plus's interface (input `data`, outputs cls_{8,16,32,64} and reg_{8,16,32,64}, here with the one class
"person"), so that the runtime treats it as it treats the real network, but it needs neither training nor a download.
The same bytes every time. Needs python3-numpy and python3-onnx.

How it sees: each pixel's colour becomes "vestness", cells of 8 x 8 px of it become occupied or not, and around each
cell of stride 32 the occupied columns to the left and right and the occupied rows above and below are counted, which
is how far the vest reaches. A person reaches farther: by a head above and by the legs below. Every layer is one
quantized convolution; what is said below as clip(x, 0, max) is the saturation of its 8-bit output.
"""
import os
import sys

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

WIDTH, HEIGHT = 320, 256
MEAN = np.array([103.53, 116.28, 123.675])  # b, g, r, as NanoDet-Plus has them
STD = np.array([57.375, 57.12, 58.395])
STRIDES = (8, 16, 32, 64)
BINS = 8  # a distance is the mean of softmax over 0..7, in strides
NEVER = -8.0  # a logit: score 0.0003

# Vest pixels: yellow-green is far more red than blue, and at least as green as red. In grey levels 0..255, the measure
# (r - b) + 2 (g - r), with g - r counted up to CLIP only (else teal would pass), starts at LOW.
LOW, FULL, CLIP = 90.0, 120.0, 20.0
# A cell of 8 x 8 pixels is empty below EMPTY of its pixels, and fully occupied from OCCUPIED on. Reflective stripes
# are no vest colour, so the latter is well below 1.
EMPTY, OCCUPIED = 0.15, 0.45
RIM = 0.5  # what an occupied cell outside the window takes from the logit
REACH = 17  # cells looked at to each side


class Network:
    """Quantized layers, one after the other. Tensors are int8 with one scale and zero point each."""

    def __init__(self):
        self.nodes, self.constants, self.ranges = [], {}, {}

    def constant(self, name, array):
        self.constants[name] = np.asarray(array)
        return name

    def tensor(self, name, low, high):
        """Declares the range of a tensor's values. OpenCV's importer goes by these name endings."""
        scale = np.float32((high - low) / 255)
        zero_point = np.int8(np.clip(round(-128 - low / scale), -128, 127))
        self.ranges[name] = (float(scale), int(zero_point))
        self.constant(name + "_scale", scale)
        self.constant(name + "_zero_point", zero_point)
        return name

    @staticmethod
    def parts(name):
        return [name + "_quantized", name + "_scale", name + "_zero_point"]

    def quantize(self, name, low, high):
        self.tensor(name, low, high)
        self.nodes.append(helper.make_node("QuantizeLinear", [name] + self.parts(name)[1:], self.parts(name)[:1], name="quant_" + name))

    def conv(self, source, name, low, high, weights, bias, stride=1, pad=0):
        """name = clip(conv(source), low, high)."""
        self.tensor(name, low, high)
        weights = np.asarray(weights, np.float64)
        channels = len(weights)
        w_scale = np.maximum(np.abs(weights).reshape(channels, -1).max(1) / 127, 1e-6).astype(np.float32)
        w = np.clip(np.round(weights / w_scale.reshape(-1, 1, 1, 1)), -127, 127).astype(np.int8)
        b = np.round(np.broadcast_to(np.asarray(bias, np.float64), channels) / (self.ranges[source][0] * w_scale)).astype(np.int32)
        inputs = self.parts(source) + [
            self.constant(name + ".w", w),
            self.constant(name + ".w_scale", w_scale),
            self.constant(name + ".w_zero_point", np.zeros(channels, np.int8)),
        ] + self.parts(name)[1:] + [self.constant(name + ".b", b)]
        size = list(weights.shape[2:])
        self.nodes.append(helper.make_node("QLinearConv", inputs, self.parts(name)[:1], name=name, kernel_shape=size,
                                           strides=[stride] * 2, pads=[pad] * 4, dilations=[1, 1], group=1))

    def output(self, name):
        # The real network's file has this prefix, too.
        self.nodes.append(helper.make_node("DequantizeLinear", self.parts(name), [name], name="deq_" + name))


def colour_layers(net):
    """Input picture to `cells`: occupancy 0..1 at stride 8."""
    net.quantize("data", *(float(f((np.array([0.0, 255.0])[:, None] - MEAN) / STD)) for f in (np.min, np.max)))

    def on_grey_levels(coefficients, bias):
        coefficients = np.array(coefficients, np.float64)  # for b, g, r; net input is (grey level - mean) / std
        return coefficients * STD, bias + coefficients @ MEAN

    rows = [on_grey_levels([-1, 2, -1], 0), on_grey_levels([0, 1, -1], -CLIP)]
    net.conv("data", "colour", 0, 255, np.array([r[0] for r in rows]).reshape(2, 3, 1, 1), [r[1] for r in rows])
    gain = 1 / (FULL - LOW)
    net.conv("colour", "vest", 0, 1, np.array([gain, -2 * gain]).reshape(1, 2, 1, 1), -LOW * gain)
    gain = 1 / (OCCUPIED - EMPTY)
    # 9 x 9, so that the cell's middle is at a whole multiple of the stride, where the decoder has it.
    net.conv("vest", "cells", 0, 1, np.full((1, 1, 9, 9), gain / 81), -EMPTY * gain, stride=8, pad=4)


def reach_layer(net):
    """`reach` at stride 32: px from the cell's middle over occupied columns left, right and rows up, down."""
    crossing = np.zeros((2, 1, 5, 5))
    crossing[0, 0, :, 2] = 1  # this column is occupied within two cells above or below
    crossing[1, 0, 2, :] = 1  # this row is, within two cells to the left or right
    net.conv("cells", "lines", 0, 1, crossing, 0, pad=2)
    count = np.zeros((4, 2, 2 * REACH + 1, 2 * REACH + 1))
    before = np.zeros(2 * REACH + 1)
    before[:REACH] = 8
    before[REACH] = 4  # the middle cell is half before and half after
    count[0, 0, REACH, :], count[1, 0, REACH, :] = before, before[::-1]
    count[2, 1, :, REACH], count[3, 1, :, REACH] = before, before[::-1]
    net.conv("lines", "reach", 0, 255, count, 0, stride=4, pad=REACH)


def head_layers(net):
    # A standing person, in heights of the vest's coloured part: a head above, legs below, arms and stride aside.
    head, legs, aside = 0.5, 1.35, 0.2
    left, right, up, down = np.eye(4)
    tall = up + down
    distances_px = [1.1 * left + aside * tall, 1.1 * right + aside * tall, 1.1 * up + head * tall, 1.1 * down + legs * tall]
    margin_px = 6
    # Logits k d / sigma^2 - k^2 / (2 sigma^2) are a Gaussian's around d (but for a constant), so that their softmax has
    # the mean d, and they are linear in d.
    sigma_sq = 0.4
    weights, bias = [], []
    for distance in distances_px:
        for k in range(BINS):
            weights.append(k * distance / 32 / sigma_sq)
            bias.append((k * margin_px / 32 - k * k / 2) / sigma_sq)
    net.conv("reach", "reg_32", -62, 66, np.array(weights).reshape(4 * BINS, 4, 1, 1), bias)
    # A person is where a few cells around are occupied: the logit rises from -6 by 4 a cell, up to 4. The window of
    # 5 x 5 cells is wider than the stride, or a far vest would slip between two of them. Occupied cells around the
    # window count against it: at a big vest's rim there are others that see the whole of it better.
    here = np.full((1, 1, 13, 13), -RIM)
    here[:, :, 4:9, 4:9] = 4
    net.conv("cells", "cls_32", NEVER, 4, here, -6, stride=4, pad=6)
    for stride in STRIDES:
        if stride != 32:
            net.conv("cells", f"cls_{stride}", NEVER, 4, np.zeros((1, 1, 1, 1)), NEVER, stride=stride // 8)
            net.conv("cells", f"reg_{stride}", -1, 1, np.zeros((4 * BINS, 1, 1, 1)), 0, stride=stride // 8)


def make_model():
    net = Network()
    colour_layers(net)
    reach_layer(net)
    head_layers(net)
    outputs = []
    for kind, channels in (("cls", 1), ("reg", 4 * BINS)):
        for stride in STRIDES:
            name = f"{kind}_{stride}"
            net.output(name)
            outputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, HEIGHT // stride, WIDTH // stride]))
    data = helper.make_tensor_value_info("data", TensorProto.FLOAT, [1, 3, HEIGHT, WIDTH])
    constants = [numpy_helper.from_array(array, name) for name, array in net.constants.items()]
    graph = helper.make_graph(net.nodes, "stillmap-demo", [data], outputs, constants)
    model = helper.make_model(graph, producer_name="stillmap", opset_imports=[helper.make_opsetid("", 11)])
    model.ir_version = 7
    onnx.checker.check_model(model)
    return model


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit("usage: make_demo_model.py OUT.onnx")
    out = sys.argv[1]
    part = out + ".part"
    try:
        with open(part, "wb") as file:
            file.write(make_model().SerializeToString())
        os.replace(part, out)
    except OSError as error:
        sys.exit(f"make_demo_model.py: cannot write {out}: {error.strerror}; name a file in a folder that you may write to")


if __name__ == "__main__":
    main()
