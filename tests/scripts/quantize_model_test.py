# SPDX-License-Identifier: Apache-2.0
"""quantize_model.py on a small network made here: with the blocks of NanoDet-Plus, and random weights."""
import hashlib
import json
import os
import struct
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import cv2
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
sys.path.insert(0, str(SCRIPTS))
import network_import  # noqa: E402
import network_quantize  # noqa: E402
from network_compare import compare_layers, input_blob, matched, same_count  # noqa: E402

WIDTH, HEIGHT, CLASSES, MIDDLE = 128, 96, 2, 16


class SmallNetwork:
    """The same layers as ONNX nodes and as ncnn's lines: a stem, a shuffled unit, a pyramid of two strides, two heads."""

    def __init__(self):
        self.random = np.random.default_rng(5)
        self.nodes, self.constants, self.lines, self.weights = [], [], ["Input data 0 1 data"], b""
        stem = self.conv("stem", "data", 3, MIDDLE, 3, stride=4, act=True)
        pool = self.layer("MaxPool", "pool", [stem], "Pooling {} 1=3 2=2 3=1 5=1", kernel_shape=[3, 3], strides=[2, 2], pads=[1] * 4)
        left, right = self.split("parts", pool, MIDDLE // 2)
        right = self.conv("r1", right, MIDDLE // 2, MIDDLE // 2, 1, act=True)
        right = self.conv("r2", right, MIDDLE // 2, MIDDLE // 2, 3, groups=MIDDLE // 2)
        right = self.conv("r3", right, MIDDLE // 2, MIDDLE // 2, 1, act=True)
        fine = self.shuffle("shuffled", self.layer("Concat", "unit", [left, right], "Concat {}", axis=1))
        coarse = self.conv("down", fine, MIDDLE, MIDDLE, 3, stride=2, act=True)
        scales = self.constant("scales", np.array([1, 1, 2, 2], np.float32))
        up = self.layer("Resize", "up", [coarse, self.constant("roi", np.zeros(0, np.float32)), scales], "Interp {} 0=2 1=2.0 2=2.0", mode="linear",
                        coordinate_transformation_mode="pytorch_half_pixel")
        fine = self.layer("Add", "sum", [fine, up], "BinaryOp {} 0=0")
        self.heads = [self.head(8, fine), self.head(16, coarse)]

    def constant(self, name, array):
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def line(self, text, name, inputs, outputs):
        kind, _, values = text.partition(" {}")
        self.lines.append(f"{kind} {name} {len(inputs)} {len(outputs)} {' '.join(inputs + outputs)}{values}")

    def layer(self, kind, name, inputs, text, **attributes):
        self.nodes.append(helper.make_node(kind, inputs, [name], name=name, **attributes))
        self.line(text, name, inputs[:2] if kind in ("Concat", "Add") else inputs[:1], [name])
        return name

    def conv(self, name, source, channels, outputs, size, stride=1, groups=1, act=False):
        weights = self.random.normal(0, (channels // groups * size * size) ** -0.5, (outputs, channels // groups, size, size)).astype(np.float16)
        weights *= np.exp(self.random.normal(0, 1, (outputs, 1, 1, 1))).astype(np.float16)  # channels of unlike loudness
        bias = self.random.normal(0, 0.3, outputs).astype(np.float32)
        before = name + "_before" if act else name
        self.nodes.append(helper.make_node("Conv", [source, self.constant(name + "_w", weights.astype(np.float32)), self.constant(name + "_b", bias)], [before],
                                           name=name + "_conv", kernel_shape=[size] * 2, strides=[stride] * 2, pads=[size // 2] * 4, group=groups))
        if act:
            self.nodes.append(helper.make_node("LeakyRelu", [before], [name], name=name, alpha=0.1))
        self.line(f"{'ConvolutionDepthWise' if groups > 1 else 'Convolution'} {{}} 0={outputs} 1={size} 3={stride} 4={size // 2} 5=1 6={weights.size}"
                  + (f" 7={groups}" if groups > 1 else "") + (" 9=2 -23310=1,0.1" if act else ""), name, [source], [name])
        halves = weights.tobytes()
        self.weights += struct.pack("<I", 0x01306B47) + halves + b"\0" * (-len(halves) % 4) + bias.tobytes()
        return name

    def split(self, name, source, first):
        outputs = [name + "_0", name + "_1"]
        self.nodes.append(helper.make_node("Split", [source], outputs, name=name, axis=1, split=[first, MIDDLE - first]))
        self.line(f"Slice {{}} -23300=2,{first},-233", name, [source], outputs)
        return outputs

    def shuffle(self, name, source):
        shapes = [self.constant(f"{name}_shape{len(s)}", np.array(s, np.int64)) for s in ([1, 2, MIDDLE // 2, HEIGHT // 8, WIDTH // 8], [1, MIDDLE, HEIGHT // 8, WIDTH // 8])]
        self.nodes += [helper.make_node("Reshape", [source, shapes[0]], [name + "_5"], name=name + "_5"),
                       helper.make_node("Transpose", [name + "_5"], [name + "_t"], name=name + "_t", perm=[0, 2, 1, 3, 4]),
                       helper.make_node("Reshape", [name + "_t", shapes[1]], [name], name=name)]
        self.line("ShuffleChannel {} 0=2", name, [source], [name])
        return name

    def head(self, stride, source):
        name, channels = f"head{stride}", CLASSES + 32
        self.conv(name, source, MIDDLE, channels, 1)
        parts = [name + "_scores", name + "_bins"]
        self.nodes += [helper.make_node("Split", [name], parts, name=name + "_split", axis=1, split=[CLASSES, 32]),
                       helper.make_node("Sigmoid", parts[:1], [name + "_sure"], name=name + "_sure"),
                       helper.make_node("Concat", [name + "_sure", parts[1]], [name + "_out"], name=name + "_out", axis=1)]
        self.line(f"Slice {{}} -23300=2,{CLASSES},-233", name + "_split", [name], parts)
        self.line("Sigmoid {}", name + "_sure", parts[:1], [name + "_sure"])
        self.line("Concat {}", name + "_out", [name + "_sure", parts[1]], [name + "_out"])
        return name + "_out"

    def onnx(self):
        outputs = [helper.make_tensor_value_info(h, TensorProto.FLOAT, [1, CLASSES + 32, HEIGHT // s, WIDTH // s]) for h, s in zip(self.heads, (8, 16))]
        data = helper.make_tensor_value_info("data", TensorProto.FLOAT, [1, 3, HEIGHT, WIDTH])
        model = helper.make_model(helper.make_graph(self.nodes, "small", [data], outputs, self.constants), opset_imports=[helper.make_opsetid("", 11)])
        model.ir_version = 7
        return model

    def write_ncnn(self, folder):
        (folder / "small.param").write_text("\n".join(["7767517", f"{len(self.lines)} 0", *self.lines]) + "\n")
        (folder / "small.bin").write_bytes(self.weights)
        return folder / "small.param"


def run(model, blob, names):
    net = network_quantize.layers_net(model.SerializeToString())
    net.setInput(blob)
    return [np.array(o) for o in net.forward(["onnx_node!" + n for n in names])]


def pictures(folder, count):
    """A log in TUM format of smooth pictures."""
    (folder / "rgb").mkdir()
    random, lines = np.random.default_rng(2), ["# timestamp filename"]
    for i in range(count):
        picture = cv2.resize(random.integers(0, 255, (6, 8, 3), np.uint8), (160, 120), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"rgb/{i}.png"), picture)
        lines.append(f"{i}.0 rgb/{i}.png")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    return folder


class QuantizeModelTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.path = Path(folder.name)
        cls.network = SmallNetwork()
        cls.log = pictures(cls.path, 12)
        cls.blobs = [input_blob(cv2.imread(str(cls.log / f"rgb/{i}.png")), WIDTH, HEIGHT) for i in range(6)]
        cls.float_model = network_import.read_network(cls.network.write_ncnn(cls.path))

    def quantize(self, *arguments, code=0):
        result = subprocess.run([sys.executable, SCRIPTS / "quantize_model.py", *arguments], capture_output=True, text=True, check=False)
        self.assertEqual(result.returncode, code, result.stderr)
        if code:
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        return result

    def arguments(self, out):
        return self.path / "small.param", "--log", self.log, "--size", str(WIDTH), str(HEIGHT), "--frames", "6", "--out", self.path / out

    def test_both_formats_become_the_network_that_they_are(self):
        wanted = run(self.network.onnx(), self.blobs[0], self.network.heads)
        onnx.save(self.network.onnx(), self.path / "small.onnx")
        for model in (self.float_model, network_import.read_network(self.path / "small.onnx")):
            self.assertEqual([o.name for o in model.graph.output], ["cls_8", "reg_8", "cls_16", "reg_16"])
            self.assertFalse({n.op_type for n in model.graph.node} - {"Conv", "LeakyRelu", "MaxPool", "Resize", "Add", "Concat", "Slice"})
            found = run(model, self.blobs[0], ["cls_8_n", "reg_8_n", "cls_16_n", "reg_16_n"])
            for i in range(2):
                np.testing.assert_allclose(1 / (1 + np.exp(-found[2 * i])), wanted[i][:, :CLASSES], atol=1e-4)
                np.testing.assert_allclose(found[2 * i + 1], wanted[i][:, CLASSES:], atol=1e-3)

    def test_its_own_float_network_can_be_read_again(self):
        onnx.save(self.float_model, self.path / "own.onnx")
        again = network_import.read_network(self.path / "own.onnx")
        names = ["cls_8_n", "reg_16_n"]
        for one, other in zip(run(self.float_model, self.blobs[0], names), run(again, self.blobs[0], names)):
            np.testing.assert_array_equal(one, other)

    def test_like_ranges_leave_the_network_as_it_is(self):
        equal = network_quantize.equalize(self.float_model, self.blobs)
        self.assertNotEqual(equal.SerializeToString(), self.float_model.SerializeToString())
        for name in ("cls_8_n", "reg_16_n"):
            one, other = (run(m, self.blobs[0], [name])[0] for m in (self.float_model, equal))
            np.testing.assert_allclose(one, other, atol=1e-3)

    def test_int8_is_near_float_and_each_step_helps(self):
        def error(model, biases=True):
            quantizer = network_quantize.Quantizer(model, self.blobs)
            if biases:
                quantizer.correct_biases()
            errors = compare_layers((model, quantizer.build()), quantizer.parameters, self.blobs)
            return float(np.mean(list(errors.values())))
        equal = network_quantize.equalize(self.float_model, self.blobs)
        best = error(equal)
        self.assertLess(best, 0.06)
        self.assertLess(best, error(self.float_model))
        self.assertLess(best, error(equal, biases=False))

    def test_scales_are_shared_where_the_graph_needs_it_and_weights_have_one_for_each_channel(self):
        model, _, parameters = network_quantize.quantize(self.float_model, self.blobs)
        for node in self.float_model.graph.node:
            if node.op_type in ("Concat", "Slice", "MaxPool", "Resize"):
                sources = node.input if node.op_type == "Concat" else node.input[:1]
                for name in sources:
                    self.assertEqual(parameters[name], parameters[node.output[0]], node.name)
        constants = {i.name: numpy_helper.to_array(i) for i in model.graph.initializer}
        for node in model.graph.node:
            if node.op_type == "QLinearConv":
                weights, scales = constants[node.input[3]], constants[node.input[4]]
                self.assertEqual(weights.dtype, np.int8)
                self.assertEqual(len(scales), len(weights))
                self.assertTrue((np.abs(weights.reshape(len(weights), -1).astype(int)).max(1) == 127).all(), "each channel uses the whole range")

    def test_the_script_end_to_end(self):
        for out in ("one.onnx", "two.onnx"):
            self.quantize(*self.arguments(out), "--float", self.path / "float.onnx", "--report", self.path / "report.json")
        network = (self.path / "one.onnx").read_bytes()
        self.assertEqual(network, (self.path / "two.onnx").read_bytes(), "same input, same bytes")
        self.assertTrue((self.path / "float.onnx").is_file())
        report = json.loads((self.path / "report.json").read_text())
        self.assertEqual(set(report), {"boxes", "layers", "latency_ms", "bytes"})
        self.assertGreater(report["boxes"]["boxes_float"], 10)
        self.assertGreater(report["boxes"]["of_float_in_int8"], 0.7)
        self.assertGreater(report["boxes"]["of_int8_in_float"], 0.7)
        self.assertLess(abs(report["boxes"]["score_shift_mean"]), 0.02)
        self.assertEqual({k: set(v) for k, v in report["latency_ms"].items()}, {"float": {"1", "2"}, "int8": {"1", "2"}})
        manifest = tomllib.loads((self.path / "one.toml").read_text())["detector"]
        self.assertEqual(manifest["sha256"], hashlib.sha256(network).hexdigest())
        self.assertEqual((manifest["input_width"], manifest["input_height"]), (WIDTH, HEIGHT))
        self.assertEqual(manifest["score_threshold"], report["boxes"]["threshold_int8"])
        self.assertAlmostEqual(manifest["confirm_score"] / manifest["score_threshold"], 1.6, delta=0.01)

    def test_refusals_name_the_thing_and_the_mend(self):
        out = ["--log", self.log, "--out", self.path / "no.onnx"]
        self.assertIn("cannot read", self.quantize(self.path / "none.param", "--frames", "6", *out, code=1).stderr)
        empty = self.path / "empty"
        empty.mkdir()
        self.assertIn("holds 0 pictures", self.quantize(self.path / "small.param", "--log", empty, *out[2:], code=1).stderr)
        self.assertIn("multiples of 32", self.quantize(self.path / "small.param", "--frames", "2", "--size", "100", "96", *out, code=1).stderr)
        short = self.path / "short.param"
        short.write_bytes((self.path / "small.param").read_bytes())
        (self.path / "short.bin").write_bytes(self.network.weights[:-8])
        self.assertIn("short.param", self.quantize(short, "--frames", "6", *out, code=1).stderr)
        (self.path / "short.bin").write_bytes(self.network.weights + b"\0" * 8)
        self.assertIn("not of one network", self.quantize(short, "--frames", "6", *out, code=1).stderr)
        strange = self.path / "strange.onnx"
        model = self.network.onnx()
        model.graph.node[0].op_type = "ConvTranspose"
        onnx.save(model, strange)
        self.assertIn("the operator ConvTranspose is not known", self.quantize(strange, "--frames", "6", *out, code=1).stderr)
        self.assertFalse((self.path / "no.onnx").exists())

    def test_what_the_report_counts(self):
        boxes = np.array([[0, 0, 10, 10], [20, 20, 40, 40]], float)
        one = boxes, np.array([0.9, 0.8]), np.array([0, 1])
        other = boxes + 1, np.array([0.6, 0.5]), np.array([0, 0])
        self.assertEqual(list(matched(one, other)), [0.6, None], "another class is another thing")
        logits = [[{"cls_8": np.array([[[[-3.0, 0.0, 1.0, 2.0]]]]) - shift}] for shift in (0, 1)]
        self.assertAlmostEqual(same_count(*logits, 0.4), 1 / (1 + np.e ** 4), 3)


if __name__ == "__main__":
    unittest.main()
