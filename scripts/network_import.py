# SPDX-License-Identifier: Apache-2.0
"""Reads NanoDet-Plus weights, ncnn's .param/.bin or ONNX, into a float ONNX network that OpenCV runs well.

Imported by quantize_model.py. A blob is a list of channels, each of them (tensor, index), so that channel shuffles, slices
and concatenations are only lists in another order. They are folded into the weights that read them: a 5-D transpose is very
slow in OpenCV. The outputs become planar: logits cls_8, cls_16 ... and distance bins reg_8, reg_16 ... by stride.
"""
import struct
from dataclasses import dataclass, field

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


class ImportFailed(Exception):
    """One line that says what the network has that cannot be read."""


@dataclass
class Op:
    kind: str  # conv, depthwise, pool, resize or add
    inputs: list  # blobs
    output: str
    channels: int
    stride_px: float  # input px from cell to cell of the output
    attributes: dict = field(default_factory=dict)
    weights: np.ndarray = None
    bias: np.ndarray = None
    slope: float = None  # of the leaky ReLU that follows, 0 for ReLU


class Graph:
    """What both readers build."""

    def __init__(self):
        self.ops, self.stride_px, self.scores = [], {"data": 1.0}, {}

    @staticmethod
    def input():
        return [("data", c) for c in range(3)]

    def add(self, kind, inputs, name, channels, scale=1.0, **values):
        self.stride_px[name] = self.stride_px[inputs[0][0][0]] * scale
        self.ops.append(Op(kind, inputs, name, channels, self.stride_px[name], **values))
        return [(name, c) for c in range(channels)]

    def conv(self, name, blob, weights, bias, stride, pad, groups, slope=None):
        if groups not in (1, len(blob)):
            raise ImportFailed(f"{name}: a convolution of {groups} groups of {len(blob)} channels; only 1 or all are known")
        kind = "conv" if groups == 1 else "depthwise"
        attributes = {"kernel_shape": list(weights.shape[2:]), "strides": [stride] * 2, "pads": [pad] * 4}
        return self.add(kind, [blob], name, len(weights), stride, attributes=attributes, weights=weights, bias=bias, slope=slope)

    def pool(self, name, blob, size, stride, pad):
        attributes = {"kernel_shape": [size] * 2, "strides": [stride] * 2, "pads": [pad] * 4}
        return self.add("pool", [blob], name, len(blob), stride, attributes=attributes)

    def resize(self, name, blob, scales, linear):
        return self.add("resize", [blob], name, len(blob), 1 / scales[0], attributes={"scales": scales, "linear": linear})

    def sigmoid(self, blob):
        """Only the class scores have one; it is the decoder's work."""
        for tensor, channel in blob:
            self.scores.setdefault(tensor, set()).add(channel)
        return blob


def shuffled(blob, groups):
    each = len(blob) // groups
    return [blob[j * each + i] for i in range(each) for j in range(groups)]


class NcnnWeights:
    def __init__(self, path):
        self.data, self.at = path.read_bytes(), 0

    def take(self, count, tagged):
        """`tagged`: four bytes before say in which type the numbers are."""
        kind, tag = "<f4", 0
        if tagged:
            tag, self.at = struct.unpack_from("<I", self.data, self.at)[0], self.at + 4
            if tag == 0x01306B47:
                kind = "<f2"
            elif tag != 0:
                raise ImportFailed(f"weights of the unknown type {tag:#x}; only float32 and float16 are known")
        values = np.frombuffer(self.data, kind, count, self.at).astype(np.float32)
        self.at += -(-count * int(kind[-1]) // 4) * 4
        return values


def ncnn_layers(path):
    """type, name, inputs, outputs, parameters of each line."""
    lines = path.read_text(encoding="utf-8").splitlines()
    if not lines or lines[0].strip() != "7767517":
        raise ImportFailed(f"{path} is no .param file of ncnn")
    for words in (line.split() for line in lines[2:] if line.strip()):
        inputs, outputs = int(words[2]), int(words[3])
        values = {}
        for word in words[4 + inputs + outputs:]:
            key, text = int(word.split("=")[0]), word.split("=")[1]
            values[key if key >= 0 else -23300 - key] = float(text) if key > -23300 else [float(v) for v in text.split(",")[1:]]
        yield words[0], words[1], words[4:4 + inputs], words[4 + inputs:4 + inputs + outputs], values


def read_ncnn(param, weights_file):
    graph, weights, blobs = Graph(), NcnnWeights(weights_file), {}
    for kind, name, inputs, outputs, values in ncnn_layers(param):
        def value(key, default=0):
            return int(values.get(key, default))
        first = blobs.get(inputs[0]) if inputs else None
        result = None
        if kind == "Input":
            result = Graph.input()
        elif kind in ("Convolution", "ConvolutionDepthWise"):
            if value(2, 1) != 1 or value(9) not in (0, 1, 2):
                raise ImportFailed(f"{name}: dilation {value(2, 1)}, activation {value(9)}; only 1 and none, ReLU or leaky ReLU are known")
            groups = value(7, 1) if kind == "ConvolutionDepthWise" else 1
            shape = (value(0), len(first) // groups, value(11, value(1)), value(1))
            kernel = weights.take(value(6), True).reshape(shape)
            bias = weights.take(value(0), False) if value(5) else np.zeros(value(0), np.float32)
            slope = {0: None, 1: 0.0}.get(value(9), values.get(10, [0])[0])
            result = graph.conv(name, first, kernel, bias, value(3, 1), value(4), groups, slope)
        elif kind == "Pooling":
            if value(0):
                raise ImportFailed(f"{name}: an average; only the maximum is known")
            result = graph.pool(name, first, value(1), value(2, 1), value(3))
        elif kind == "Interp":
            result = graph.resize(name, first, [values.get(1, 1.0), values.get(2, 1.0)], value(0) == 2)
        elif kind == "BinaryOp" and value(0) == 0:
            result = graph.add("add", [blobs[i] for i in inputs], name, len(first))
        elif kind == "Concat":
            result = [channel for i in inputs for channel in blobs[i]]
        elif kind == "ShuffleChannel":
            result = shuffled(first, value(0, 1))
        elif kind == "Crop":
            result = first[int(values[9][0]):int(values[10][0])]
        elif kind == "Sigmoid":
            result = graph.sigmoid(first)
        elif kind in ("Split", "Reshape", "Permute"):
            result = first
        elif kind == "Slice":
            at = 0
            for i, output in enumerate(outputs):
                size = int(values[0][i])
                size = size if size >= 0 else (len(first) - at) // (len(outputs) - i)
                blobs[output], at = first[at:at + size], at + size
            continue
        else:
            raise ImportFailed(f"{name}: the layer {kind} is not known")
        blobs.update((output, result) for output in outputs)
    if weights.at != len(weights.data):
        raise ImportFailed(f"{weights_file} has {len(weights.data)} bytes, but {param} needs {weights.at}; they are not of one network")
    return graph


class OnnxReader:
    """NanoDet-Plus as its own export writes it (constants folded: onnxsim), or as write_float() does."""

    def __init__(self, model):
        self.graph, self.blobs, self.groups = Graph(), {model.graph.input[0].name: Graph.input()}, {}
        self.constants = {i.name: numpy_helper.to_array(i) for i in model.graph.initializer}
        for node in model.graph.node:
            self.read(node)
        self.named = {o.name: self.blobs[o.name] for o in model.graph.output if o.name.startswith("cls_")}
        for blob in self.named.values():
            self.graph.sigmoid(blob)

    def read(self, node):
        attributes = {a.name: helper.get_attribute_value(a) for a in node.attribute}
        if node.op_type == "Constant":
            self.constants[node.output[0]] = numpy_helper.to_array(attributes["value"])
            return
        verb = getattr(self, "on_" + node.op_type.lower(), None)
        if verb is None:
            raise ImportFailed(f"{node.name or node.output[0]}: the operator {node.op_type} is not known")
        result = verb(node, attributes, self.blobs[node.input[0]])
        if len(node.output) == 1:
            result = [result]
        self.blobs.update(zip(node.output, result))

    def on_conv(self, node, attributes, blob):
        weights = self.constants[node.input[1]]
        bias = self.constants[node.input[2]] if len(node.input) > 2 else np.zeros(len(weights), np.float32)
        pads, strides = attributes.get("pads", [0] * 4), attributes.get("strides", [1, 1])
        if len(set(pads)) > 1 or len(set(strides)) > 1 or set(attributes.get("dilations", [1])) != {1}:
            raise ImportFailed(f"{node.name}: uneven pads or strides, or dilations, are not known")
        return self.graph.conv(node.output[0], blob, weights, bias, strides[0], pads[0], attributes.get("group", 1))

    def on_leakyrelu(self, node, attributes, blob, slope=None):
        op = next((o for o in self.graph.ops if blob == [(o.output, c) for c in range(o.channels)]), None)
        if op is None or op.weights is None or op.slope is not None:
            raise ImportFailed(f"{node.name or node.output[0]}: an activation of what is no convolution's whole output")
        op.slope = attributes.get("alpha", 0.01) if slope is None else slope
        return blob

    def on_relu(self, node, attributes, blob):
        return self.on_leakyrelu(node, attributes, blob, 0.0)

    def on_maxpool(self, node, attributes, blob):
        return self.graph.pool(node.output[0], blob, attributes["kernel_shape"][0], attributes["strides"][0], attributes.get("pads", [0])[0])

    def on_resize(self, node, attributes, blob):
        scales = self.constants.get(node.input[2], np.zeros(0))
        if len(scales) != 4:
            raise ImportFailed(f"{node.name}: resized to a size; only scales are known")
        return self.graph.resize(node.output[0], blob, [float(s) for s in scales[2:]], attributes.get("mode", b"nearest") == b"linear")

    def on_add(self, node, _, blob):
        return self.graph.add("add", [blob, self.blobs[node.input[1]]], node.output[0], len(blob))

    def on_concat(self, node, *_):
        return [channel for i in node.input for channel in self.blobs[i]]

    def on_split(self, node, attributes, blob):
        sizes = attributes.get("split") or [int(s) for s in self.constants[node.input[1]]]
        ends = np.cumsum(sizes)
        return [blob[end - size:end] for size, end in zip(sizes, ends)]

    def on_slice(self, node, _, blob):
        begin, end, axis = (int(self.constants[i][0]) for i in node.input[1:4])
        if axis != 1:
            raise ImportFailed(f"{node.name}: a slice of axis {axis}; only channels are known")
        return blob[begin:min(end, len(blob))]

    def on_reshape(self, node, _, blob):
        shape = self.constants.get(node.input[1], ())
        if len(shape) == 5:  # a shuffle's first step: [1, groups, channels of a group, rows, columns]
            self.groups[node.output[0]] = int(shape[1])
        return blob

    def on_transpose(self, node, attributes, blob):
        groups = self.groups.get(node.input[0])
        return shuffled(blob, groups) if groups and list(attributes["perm"])[:3] == [0, 2, 1] else blob

    def on_sigmoid(self, _, __, blob):
        return self.graph.sigmoid(blob)


def split_heads(graph):
    """The convolutions whose outputs are class scores and distances become two each, by stride."""
    ops = []
    for op in graph.ops:
        scores = sorted(graph.scores.get(op.output, ()))
        if not scores:
            ops.append(op)
            continue
        if op.kind != "conv" or op.slope is not None:
            raise ImportFailed(f"{op.output}: class scores of what is no plain convolution")
        rest = [c for c in range(op.channels) if c not in set(scores)]
        for kind, rows in (("cls", scores), ("reg", rest)):
            if rows:
                ops.append(Op("conv", op.inputs, f"{kind}_{op.stride_px:g}", len(rows), op.stride_px, op.attributes, op.weights[rows], op.bias[rows]))
    return ops


class Writer:
    def __init__(self, ops):
        self.ops, self.nodes, self.constants, self.made = ops, [], [], {}
        self.physical = {"data": [0, 1, 2]}  # tensor: the channels in the order that they lie
        self.readers = {}
        for number, op in enumerate(ops):
            for blob in op.inputs:
                for channel in blob:
                    self.readers.setdefault(channel, set()).add(number)

    def constant(self, name, array):
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def node(self, kind, inputs, output, **attributes):
        self.nodes.append(helper.make_node(kind, inputs, [output], name=output + "_n", **attributes))
        return output

    def piece(self, tensor, begin, end):
        """Physical channels of a tensor."""
        if (begin, end) == (0, len(self.physical[tensor])):
            return tensor
        name = f"{tensor}_{begin}_{end}"
        if name not in self.made:
            bounds = [self.constant(f"{name}_{what}", np.array([v], np.int64)) for what, v in (("begin", begin), ("end", end), ("axis", 1))]
            self.made[name] = self.node("Slice", [tensor, *bounds], name)
        return name

    def assemble(self, blob, in_order):
        """A tensor that holds a blob's channels, and their order in it: the blob's own, or whichever takes the fewest slices."""
        places = [(tensor, self.physical[tensor].index(channel)) for tensor, channel in blob]
        if not in_order:
            tensors = list(dict.fromkeys(tensor for tensor, _ in places))
            places.sort(key=lambda place: (tensors.index(place[0]), place[1]))
        runs = []
        for tensor, at in places:
            if runs and runs[-1][0] == tensor and runs[-1][2] == at:
                runs[-1][2] = at + 1
            else:
                runs.append([tensor, at, at + 1])
        names = [self.piece(*run) for run in runs]
        order = [(tensor, self.physical[tensor][at]) for tensor, at in places]
        if len(names) == 1:
            return names[0], order
        key = tuple(names)
        if key not in self.made:
            self.made[key] = self.node("Concat", names, f"joined_{len(self.made)}", axis=1)
        return self.made[key], order

    def write(self, op):
        blob = op.inputs[0]
        if op.kind == "add":
            self.physical[op.output] = list(range(op.channels))
            self.node("Add", [self.assemble(b, True)[0] for b in op.inputs], op.output)
            return
        source, order = self.assemble(blob, False)
        where = {channel: i for i, channel in enumerate(blob)}
        came_from = [where[channel] for channel in order]
        if op.kind == "pool":
            self.physical[op.output] = came_from
            self.node("MaxPool", [source], op.output, **op.attributes)
        elif op.kind == "resize":
            self.physical[op.output] = came_from
            how = {"mode": "linear", "coordinate_transformation_mode": "pytorch_half_pixel"} if op.attributes["linear"] else \
                {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
            scales = self.constant(op.output + "_scales", np.array([1, 1, *op.attributes["scales"]], np.float32))
            self.node("Resize", [source, self.constant(op.output + "_roi", np.zeros(0, np.float32)), scales], op.output, **how)
        else:
            self.write_conv(op, source, came_from)

    def write_conv(self, op, source, came_from):
        if op.kind == "depthwise":
            rows, weights = came_from, op.weights[came_from]
        else:
            # Channels that the same layers read lie beside each other.
            rows = sorted(range(op.channels), key=lambda c: (sorted(self.readers.get((op.output, c), ())), c))
            weights = op.weights[rows][:, came_from]
        self.physical[op.output] = rows
        inputs = [source, self.constant(op.output + "_w", weights), self.constant(op.output + "_b", op.bias[rows])]
        before = op.output if op.slope is None else op.output + "_linear"
        self.node("Conv", inputs, before, group=op.channels if op.kind == "depthwise" else 1, **op.attributes)
        if op.slope is not None:
            self.node("LeakyRelu", [before], op.output, alpha=op.slope)


def write_float(graph):
    """The float ONNX model of a graph."""
    ops = split_heads(graph)
    writer = Writer(ops)
    for op in ops:
        writer.write(op)
    heads = [op for op in ops if op.output.startswith(("cls_", "reg_"))]
    if not heads:
        raise ImportFailed("the network has no class scores: neither a sigmoid nor outputs cls_8, reg_8 ...")
    outputs = [helper.make_tensor_value_info(op.output, TensorProto.FLOAT, [1, op.channels, None, None]) for op in heads]
    data = helper.make_tensor_value_info("data", TensorProto.FLOAT, [1, 3, "height", "width"])
    model = helper.make_model(helper.make_graph(writer.nodes, "network", [data], outputs, writer.constants),
                              producer_name="stillmap", opset_imports=[helper.make_opsetid("", 11)])
    model.ir_version = 7
    onnx.checker.check_model(model)
    return model


def read_network(path, weights=None):
    """The float ONNX model of an .onnx file, or of a .param and its .bin."""
    try:
        if path.suffix == ".param":
            return write_float(read_ncnn(path, weights or path.with_suffix(".bin")))
        return write_float(OnnxReader(onnx.load(path)).graph)
    except OSError as error:
        raise ImportFailed(f"cannot read {error.filename}: {error.strerror}") from error
    except (KeyError, ValueError, IndexError, TypeError, struct.error) as error:
        raise ImportFailed(f"{path} is no network that is known ({error!r})") from error
