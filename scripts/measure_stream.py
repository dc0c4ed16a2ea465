#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""How long a pose takes to a client on loopback, and what each topic costs on the wire.

    measure_stream.py [--clients 8] [--seconds 20] [--without /map,...] [--log DIR --camera FILE] [--model FILE]

Without a log, a stream server as the tests have it publishes a pose every 10 ms, stamped with the clock, beside a full
cloud (200,000 points a second), map blocks, pictures and objects. Each client is a process of its own that takes every
topic but those of --without; a pose's latency is from its publication to its reading there. Needs stream_test_server,
which the tests' build makes.

With a log, the runtime plays it in realtime, forwards and backwards: stamps are then the log's, so only bytes are told.
Close other programs first.
"""
import argparse
import json
import multiprocessing
import os
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from stillmap_runs import ROOT, print_table
from stream_client import StreamClient


def watch(port, without, seconds, results):
    """One client: latencies of poses (ms) and bytes per topic, from the first pose on for so many seconds."""
    client, topics, latencies, sizes = StreamClient("127.0.0.1", port), {}, [], Counter()
    end, topic = None, None
    try:
        while end is None or time.monotonic() < end:
            opcode, payload = client.frame()
            now_ns = time.time_ns()
            if opcode == 9:
                client.send(10, payload)
            elif opcode == 1 and (message := json.loads(payload))["op"] == "advertise":
                wanted = {c["id"]: c["topic"] for c in message["channels"] if c["topic"] not in without}
                topics |= wanted
                if wanted:
                    client.send(1, json.dumps({"op": "subscribe", "subscriptions": [{"id": i, "channelId": i} for i in wanted]}).encode())
            elif opcode in (0, 2):  # a message, or the next piece of one
                if opcode == 2:
                    topic = topics[int.from_bytes(payload[1:5], "little")]
                if topic == "/pose":
                    end = end or time.monotonic() + seconds
                    latencies.append((now_ns - int.from_bytes(payload[5:13], "little")) / 1e6)
                if end:
                    sizes[topic] += len(payload)
    except (OSError, ValueError, KeyError) as error:
        results.put(f"a client lost the server: {error!r}")
    else:
        results.put((latencies, sizes))


def measure(args, port):
    results = multiprocessing.Queue()
    clients = [multiprocessing.Process(target=watch, args=(port, args.without.split(","), args.seconds, results)) for _ in range(args.clients)]
    for client in clients:
        client.start()
    answers = [results.get(timeout=args.seconds + 60) for _ in clients]
    for answer in answers:
        if isinstance(answer, str):
            sys.exit(f"measure_stream.py: {answer}")
    return np.concatenate([a[0] for a in answers]), sum((a[1] for a in answers), Counter())


def print_bytes(args, sizes):
    per_client = args.seconds * args.clients
    print_table([(topic, f"{size / per_client / 1000:.1f}") for topic, size in sizes.most_common()] +
                [("all", f"{sizes.total() / per_client / 1000:.1f}")], ("topic", "kB a second and client"))


def from_test_server(args):
    server = subprocess.Popen([args.bin / "stream_test_server", "--stamps", "clock"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    latencies, sizes = measure(args, int(server.stdout.readline()))
    stats = json.loads(server.communicate("quit\n")[0].splitlines()[-1])
    p50, p99 = np.percentile(latencies, (50, 99))
    print(f"{args.clients} clients, {len(latencies)} poses: p50 {p50:.2f} ms, p99 {p99:.2f} ms, most {latencies.max():.2f} ms; {stats['dropped']} messages missed")
    print_bytes(args, sizes)


def from_runtime(args):
    command = [args.bin / "stillmap", "run", "--mode", "realtime", "--loop", "1000", "--source", f"tum:{args.log}", "--config", args.camera,
               "--config", ROOT / "firmware-config/boards/two-core.toml", "--listen", "127.0.0.1:0"]
    if args.model:
        command += ["--set", f"detector.model={args.model}"]
    runtime = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        for line in runtime.stderr:
            if match := re.search(r"http://127\.0\.0\.1:(\d+)", line):
                break
        else:
            sys.exit(f"measure_stream.py: the run ended: {line.strip()}")
        print_bytes(args, measure(args, int(match[1]))[1])
    finally:
        runtime.terminate()
        runtime.communicate()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--without", default="", metavar="TOPICS", help="not subscribed to, with commas between")
    parser.add_argument("--log", type=Path, metavar="DIR", help="in TUM format")
    parser.add_argument("--camera", type=Path, metavar="FILE", default=ROOT / "firmware-config/cameras/tum-fr1.toml", help="the log's camera")
    parser.add_argument("--model", metavar="FILE", help="ONNX network; default: the installed one")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/release/bin", help="folder of the programs")
    args = parser.parse_args()
    load = os.getloadavg()[0]
    if args.log:
        from_runtime(args)
    else:
        from_test_server(args)
    print(f"load average of the machine before: {load:.1f}")


if __name__ == "__main__":
    main()
