# SPDX-License-Identifier: Apache-2.0
"""How far a quantized network is from its float one: boxes, scores, layers, time; imported by quantize_model.py."""
import statistics
import time

import cv2
import numpy as np

from network_quantize import layers_net, run_layers

MEAN, DEVIATION = np.array([103.53, 116.28, 123.675], np.float32), np.array([57.375, 57.12, 58.395], np.float32)
BINS = 8
SAME = 0.5  # overlap of two boxes that are one


def input_blob(picture, width, height):
    """[1, 3, height, width] with the picture in the middle of black, and input px per picture px, as the runtime makes it."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    whole = np.zeros((height, width, 3), np.uint8)
    whole[top:top + size[1], left:left + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR if scale > 0.5 else cv2.INTER_AREA)
    return np.ascontiguousarray(((whole.astype(np.float32) - MEAN) / DEVIATION).transpose(2, 0, 1)[None])


def overlaps(box, others):
    low, high = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
    both = np.prod(np.clip(high - low, 0, None), axis=1)
    return both / (np.prod(box[2:] - box[:2]) + np.prod(others[:, 2:] - others[:, :2], axis=1) - both)


def decode(outputs, threshold, iou=0.6):
    """Boxes in the input, their scores and classes, of the planar outputs by name."""
    boxes, scores, classes = [], [], []
    for name in outputs:
        if not name.startswith("cls_"):
            continue
        stride, logits, bins = int(name[4:]), outputs[name][0], outputs["reg_" + name[4:]][0]
        ys, xs = np.nonzero(logits.max(0) > -np.log(1 / threshold - 1))
        weights = bins[:, ys, xs].reshape(4, BINS, -1)
        weights = np.exp(weights - weights.max(1, keepdims=True))
        left, top, right, bottom = (weights * np.arange(BINS)[:, None]).sum(1) / weights.sum(1) * stride
        boxes.append(np.stack([xs * stride - left, ys * stride - top, xs * stride + right, ys * stride + bottom], 1))
        scores.append(1 / (1 + np.exp(-logits[:, ys, xs].max(0))))
        classes.append(logits[:, ys, xs].argmax(0))
    boxes, scores, classes = (np.concatenate(part) for part in (boxes, scores, classes))
    kept = []
    for i in np.argsort(-scores, kind="stable"):
        same = [k for k in kept if classes[k] == classes[i]]
        if not same or overlaps(boxes[i], boxes[same]).max() <= iou:
            kept.append(i)
    return boxes[kept], scores[kept], classes[kept]


def matched(one, other):
    """For each box of `one` the score of the same thing in `other`, or None."""
    for box, _, kind in zip(*one):
        of_kind = np.flatnonzero(other[2] == kind)
        found = overlaps(box, other[0][of_kind]) if len(of_kind) else np.zeros(1)
        yield float(other[1][of_kind[found.argmax()]]) if found.max() >= SAME else None


def outputs_of(net, names, blob):
    net.setInput(blob)
    return dict(zip(names, net.forward(list(names.values()))))


def time_ms(model_bytes, blob, threads, runs):
    """Median of the wall times on the OpenCV that is here; its own int8 kernels are not the runtime's."""
    cv2.setNumThreads(threads)
    net = cv2.dnn.readNetFromONNX(np.frombuffer(model_bytes, np.uint8))
    names, times = net.getUnconnectedOutLayersNames(), []
    for _ in range(runs + 1):
        start = time.perf_counter()
        net.setInput(blob)
        net.forward(names)
        times.append(1e3 * (time.perf_counter() - start))
    cv2.setNumThreads(1)
    return round(statistics.median(times[1:]), 2)


def share(count, of):
    return round(count / of, 4) if of else None


def same_count(wanted, found, threshold):
    """The score above which `found` has as many cells as `wanted` has above `threshold`."""
    logits = [np.sort(np.concatenate([o[name][0].max(0).ravel() for o in outputs for name in o if name.startswith("cls_")])) for outputs in (wanted, found)]
    count = int((logits[0] > -np.log(1 / threshold - 1)).sum())
    return round(float(1 / (1 + np.exp(-logits[1][-count - 1:][0]))), 3) if count else threshold


def compare_boxes(models, outputs, blobs, threshold):
    nets = [layers_net(m.SerializeToString()) for m in models]
    names = [{o: "onnx_node!" + prefix + o + suffix for o in outputs} for prefix, suffix in (("", "_n"), ("deq_", ""))]
    seen = [[outputs_of(net, n, blob) for blob in blobs] for net, n in zip(nets, names)]
    thresholds = (threshold, same_count(*seen, threshold))
    boxes, both, shifts = [0, 0], [0, 0], []
    for frame in zip(*seen):
        found = [decode(o, t) for o, t in zip(frame, thresholds)]
        for i in range(2):
            pairs = list(zip(found[i][1], matched(found[i], found[1 - i])))
            boxes[i] += len(pairs)
            both[i] += sum(there is not None for _, there in pairs)
            if i == 0:
                shifts += [there - here for here, there in pairs if there is not None]
    return {"frames": len(blobs), "threshold_float": thresholds[0], "threshold_int8": thresholds[1], "boxes_float": boxes[0], "boxes_int8": boxes[1],
            "of_float_in_int8": share(both[0], boxes[0]), "of_int8_in_float": share(both[1], boxes[1]),
            "score_shift_mean": round(float(np.mean(shifts)), 4) if shifts else None,
            "score_shift_worst": round(float(np.abs(shifts).max()), 4) if shifts else None}


def compare_layers(models, parameters, blobs):
    """By convolution: RMS of the difference over RMS of the float values."""
    convs = [node for node in models[0].graph.node if node.op_type == "Conv"]
    nets = [layers_net(m.SerializeToString()) for m in models]
    error, power = dict.fromkeys((n.output[0] for n in convs), 0.0), dict.fromkeys((n.output[0] for n in convs), 0.0)
    for blob in blobs:
        wanted, found = (run_layers(net, convs, blob) for net in nets)
        for name, values in wanted.items():
            scale, zero = parameters[name]
            error[name] += float((((found[name].astype(np.float32) - zero) * scale - values) ** 2).sum())
            power[name] += float((values ** 2).sum())
    return {name: round((error[name] / max(power[name], 1e-12)) ** 0.5, 4) for name in error}


def compare(float_model, int8_model, parameters, blobs, threshold, runs=30):
    models, outputs = (float_model, int8_model), [o.name for o in float_model.graph.output]
    data = [m.SerializeToString() for m in models]
    return {"boxes": compare_boxes(models, outputs, blobs, threshold), "layers": compare_layers(models, parameters, blobs),
            "latency_ms": {kind: {str(threads): time_ms(d, blobs[0], threads, runs) for threads in (1, 2)} for kind, d in zip(("float", "int8"), data)},
            "bytes": dict(zip(("float", "int8"), map(len, data)))}
