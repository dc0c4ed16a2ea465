# SPDX-License-Identifier: Apache-2.0
"""Statically quantizes the float ONNX networks of network_import.py to 8 bits; imported by quantize_model.py.

The result has the form that OpenCV 4.6 reads: QLinearConv, and com.microsoft's QLinearAdd, QLinearConcat, QLinearLeakyRelu;
MaxPool, Resize and Slice on int8. Tensors of int8 end in `quantized`, with constants `<prefix>scale` and
`<prefix>zero_point`; one scale for each tensor, and one for each channel of the weights.
"""
import cv2
import numpy as np
import onnx
from onnx import helper, numpy_helper

BINS = 2048
# Shares of the observed range that are tried, below and above zero.
LOW_SHARES = (1, 0.8, 0.65, 0.5, 0.4, 0.3, 0.22, 0.16, 0.1, 0.05)
HIGH_SHARES = (1, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4)
# Logits that matter lie around the threshold; what is surely nothing may saturate.
LEAST_LOGIT, LOGIT_MARGIN = -9.0, 1.0
# A class score is corrected where it could become a box; elsewhere its mean says nothing.
NEAR_LOGIT = -2.5
# Channels may be made this much louder before quantization, and no more, since some are silent on any few frames.
LEAST_SHARE = 0.02
SAME_RANGE = ("Slice", "MaxPool", "Resize")  # what OpenCV computes without a change of scale


def layer_of(node):
    """OpenCV's name of a node."""
    return "onnx_node!" + node.name


def layers_net(model_bytes):
    net = cv2.dnn.readNetFromONNX(np.frombuffer(model_bytes, np.uint8))
    net.enableFusion(False)  # every layer's output can be looked at
    return net


def run_layers(net, nodes, blob):
    """The output of each of the nodes."""
    net.setInput(blob)
    names = [layer_of(node) for node in nodes]
    return dict(zip((node.output[0] for node in nodes), net.forward(names)))


def scale_and_zero(low, high):
    low, high = min(low, 0.0), max(high, 0.0)
    scale = max((high - low) / 255, 1e-8)
    return float(np.float32(scale)), int(np.clip(round(-128 - low / scale), -128, 127))


def leaky(values, slope):
    return np.where(values > 0, values, slope * values)


def best_range(counts, edges, slope):
    """The range whose quantization has the least squared error, seen through the activation that follows."""
    middle, share = (edges[:-1] + edges[1:]) / 2, counts / counts.sum()
    wanted, best = leaky(middle, slope), None
    for low in ([edges[0] * k for k in LOW_SHARES] if edges[0] < 0 else [0.0]):
        for high in ([edges[-1] * k for k in HIGH_SHARES] if edges[-1] > 0 else [0.0]):
            scale, zero = scale_and_zero(low, high)
            found = (np.clip(np.round(middle / scale) + zero, -128, 127) - zero) * scale
            error = float((share * (leaky(found, slope) - wanted) ** 2).sum())
            if best is None or error < best[0]:
                best = (error, low, high)
    return best[1:]


def equalize(model, blobs):
    """The same network with the channels between two convolutions brought to like ranges, since they share one scale
    (Nagel et al., ICCV 2019). Wholly where the second is depthwise, whose weights have a scale for each channel; else by
    half, in logarithms, since it has them for each output only."""
    model = onnx.ModelProto.FromString(model.SerializeToString())
    constants = {i.name: i for i in model.graph.initializer}
    arrays = {name: numpy_helper.to_array(i).copy() for name, i in constants.items()}
    readers, convs = {}, [n for n in model.graph.node if n.op_type == "Conv"]
    for node in model.graph.node:
        readers.setdefault(node.input[0], []).append(node)
        for name in node.input[1:]:
            readers.setdefault(name, []).append(node)
    net, loudest = layers_net(model.SerializeToString()), {}
    for conv, reader, slope in [(c, *follower(c, readers)) for c in convs]:
        if reader is not None:
            loudest[conv.output[0]] = (conv, reader, slope, 0.0)
    for blob in blobs:
        for name, values in run_layers(net, [c for c, *_ in loudest.values()], blob).items():
            conv, reader, slope, before = loudest[name]
            loudest[name] = (conv, reader, slope, np.maximum(before, np.abs(leaky(values, slope)).max((0, 2, 3))))
    for conv, reader, _, values in loudest.values():
        is_depthwise = arrays[reader.input[1]].shape[1] == 1
        share = np.maximum(values / values.max(), LEAST_SHARE).astype(np.float32) ** np.float32(1 if is_depthwise else 0.5)
        arrays[conv.input[1]] /= share.reshape(-1, 1, 1, 1)
        arrays[conv.input[2]] /= share
        arrays[reader.input[1]] *= share.reshape((-1, 1, 1, 1) if is_depthwise else (1, -1, 1, 1))
    for name, initializer in constants.items():
        initializer.CopyFrom(numpy_helper.from_array(arrays[name], name))
    return model


def follower(conv, readers):
    """The convolution that alone reads this one's output, or None, and the slope of the leaky ReLU between them."""
    slope, found = 1.0, readers.get(conv.output[0], [])
    if len(found) == 1 and found[0].op_type == "LeakyRelu":
        slope, found = found[0].attribute[0].f, readers.get(found[0].output[0], [])
    return (found[0] if len(found) == 1 and found[0].op_type == "Conv" else None), slope


class Groups:
    """Tensors that must have one scale."""

    def __init__(self):
        self.parent = {}

    def find(self, name):
        while self.parent.setdefault(name, name) != name:
            name = self.parent[name]
        return name

    def join(self, one, other):
        self.parent[self.find(one)] = self.find(other)


class Quantizer:
    def __init__(self, model, blobs):
        self.model, self.blobs = model, blobs
        self.nodes = list(model.graph.node)
        self.constants = {i.name: numpy_helper.to_array(i) for i in model.graph.initializer}
        self.outputs = [o.name for o in model.graph.output]
        self.convs = [node for node in self.nodes if node.op_type == "Conv"]
        self.readers = {}
        for node in self.nodes:
            for name in node.input:
                self.readers.setdefault(name, []).append(node)
        self.correction = {node.output[0]: 0.0 for node in self.convs}
        self.calibrate()

    def calibrate(self):
        net = layers_net(self.model.SerializeToString())
        extent = {}
        for blob in self.blobs:
            for name, values in run_layers(net, self.nodes, blob).items():
                low, high = extent.get(name, (np.inf, -np.inf))
                extent[name] = (min(low, float(values.min())), max(high, float(values.max())))
        counts = {name: np.zeros(BINS) for name in extent}
        edges = {name: np.linspace(low, high + 1e-6, BINS + 1) for name, (low, high) in extent.items()}
        for blob in self.blobs:
            for name, values in run_layers(net, self.nodes, blob).items():
                counts[name] += np.histogram(values, edges[name])[0]
        self.set_parameters(extent, counts, edges)
        # What the channels' means should be, as far as the ranges let them; of class scores, all values.
        self.wanted = {}
        for blob in self.blobs:
            for name, values in run_layers(net, self.convs, blob).items():
                self.wanted.setdefault(name, []).append(self.representable(name, values) if name.startswith("cls_") else
                                                        self.representable(name, values).mean((0, 2, 3)))

    def representable(self, name, values):
        scale, zero = self.parameters[name]
        return np.clip(values, (-128 - zero) * scale, (127 - zero) * scale)

    def set_parameters(self, extent, counts, edges):
        data = self.model.graph.input[0].name
        ranges = {data: (min(float(b.min()) for b in self.blobs), max(float(b.max()) for b in self.blobs))}
        groups = Groups()
        for node in self.nodes:
            name, readers = node.output[0], self.readers.get(node.output[0], [])
            low, high = extent[name]
            if name.startswith("cls_"):
                ranges[name] = (max(low, LEAST_LOGIT), high + LOGIT_MARGIN)
            elif name in self.outputs:
                ranges[name] = (low, high)
            else:
                slope = readers[0].attribute[0].f if len(readers) == 1 and readers[0].op_type == "LeakyRelu" else 1.0
                ranges[name] = best_range(counts[name], edges[name], slope)
            if node.op_type in SAME_RANGE:
                groups.join(name, node.input[0])
            if node.op_type == "Concat":
                for source in node.input:
                    groups.join(source, name)
        shared = {}
        for name, (low, high) in ranges.items():
            root = groups.find(name)
            least, most = shared.get(root, (low, high))
            shared[root] = (min(low, least), max(high, most))
        self.parameters = {name: scale_and_zero(*shared[groups.find(name)]) for name in ranges}

    def build(self):
        """The quantized model with the corrections so far."""
        return Writer(self).model()

    def correct_biases(self):
        """Makes each channel's mean what it is in float: layer after layer from the input on, each behind corrected ones."""
        for conv in self.convs:
            name, net = conv.output[0], layers_net(self.build().SerializeToString())
            scale, zero = self.parameters[name]
            found = [(run_layers(net, [conv], blob)[name].astype(np.float32) - zero) * scale for blob in self.blobs]
            if name.startswith("cls_"):
                wanted, found = np.stack(self.wanted[name]), np.stack(found)
                near = wanted > NEAR_LOGIT
                self.correction[name] = float((wanted - found)[near if near.any() else ...].mean())
            else:
                self.correction[name] = np.mean(self.wanted[name], 0) - np.mean([values.mean((0, 2, 3)) for values in found], 0)


class Writer:
    def __init__(self, quantizer):
        self.q, self.nodes, self.constants = quantizer, [], {}

    def constant(self, name, array):
        self.constants[name] = np.asarray(array)
        return name

    def parts(self, name):
        """A tensor's int8 values, scale and zero point."""
        scale, zero = self.q.parameters[name]
        return [name + "_quantized", self.constant(name + "_scale", np.float32(scale)), self.constant(name + "_zero_point", np.int8(zero))]

    def node(self, kind, inputs, output, name, **attributes):
        self.nodes.append(helper.make_node(kind, inputs, [output], name=name, **attributes))

    def conv(self, node, attributes):
        source, output = self.parts(node.input[0]), self.parts(node.output[0])
        weights = self.q.constants[node.input[1]]
        scale = np.maximum(np.abs(weights).reshape(len(weights), -1).max(1) / 127, 1e-9).astype(np.float32)
        rounded = np.clip(np.round(weights / scale.reshape(-1, 1, 1, 1)), -127, 127).astype(np.int8)
        bias = self.q.constants[node.input[2]].astype(np.float64) + self.q.correction[node.output[0]]
        whole = np.clip(np.round(bias / (self.q.parameters[node.input[0]][0] * scale.astype(np.float64))), -2 ** 31 + 1, 2 ** 31 - 1)
        inputs = [*source, self.constant(node.name + ".w", rounded), self.constant(node.name + ".w_scale", scale),
                  self.constant(node.name + ".w_zero_point", np.zeros(len(weights), np.int8)), *output[1:],
                  self.constant(node.name + ".b", whole.astype(np.int32))]
        self.node("QLinearConv", inputs, output[0], node.name, **attributes)

    def quantized(self, node):
        attributes = {a.name: helper.get_attribute_value(a) for a in node.attribute}
        output = self.parts(node.output[0])
        if node.op_type == "Conv":
            self.conv(node, attributes)
        elif node.op_type in ("LeakyRelu", "Add"):
            inputs = [part for name in node.input for part in self.parts(name)]
            self.node("QLinear" + node.op_type, inputs + output[1:], output[0], node.name, domain="com.microsoft", **attributes)
        elif node.op_type == "Concat":
            inputs = [part for name in node.input for part in self.parts(name)]
            self.node("QLinearConcat", output[1:] + inputs, output[0], node.name, domain="com.microsoft", **attributes)
        else:
            inputs = [self.constant(name, self.q.constants[name]) for name in node.input[1:]]
            self.node(node.op_type, [self.parts(node.input[0])[0], *inputs], output[0], node.name, **attributes)

    def model(self):
        graph = self.q.model.graph
        data = graph.input[0].name
        values, *rest = self.parts(data)
        self.node("QuantizeLinear", [data, *rest], values, "quant_" + data)
        for node in self.q.nodes:
            self.quantized(node)
        for name in self.q.outputs:
            self.node("DequantizeLinear", self.parts(name), name, "deq_" + name)
        constants = [numpy_helper.from_array(array, name) for name, array in self.constants.items()]
        made = helper.make_graph(self.nodes, "quantized", list(graph.input), list(graph.output), constants)
        model = helper.make_model(made, producer_name="stillmap", opset_imports=[helper.make_opsetid("", 11), helper.make_opsetid("com.microsoft", 1)])
        model.ir_version = 7
        return model


def quantize(model, blobs):
    """The quantized model; the float one that it is made of, equal to `model` but for the loudness of channels; and, by tensor,
    scale and zero point. `blobs` are inputs [1, 3, h, w] to calibrate with."""
    quantizer = Quantizer(equalize(model, blobs), blobs)
    quantizer.correct_biases()
    return quantizer.build(), quantizer.model, quantizer.parameters
