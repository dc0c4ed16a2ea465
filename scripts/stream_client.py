# SPDX-License-Identifier: Apache-2.0
"""A viewer that takes everything and shows nothing: for measuring with a client attached. Imported, never run."""
import base64
import json
import os
import socket
import struct
import threading


class StreamClient(threading.Thread):
    """Subscribes to every channel of the server at HOST:PORT; `bytes` and `messages` count what came.

    `query` is what follows the address, such as `?token=...`; `timeout_s` is how long the server may be silent."""

    def __init__(self, host, port, query="", timeout_s=10):
        super().__init__(daemon=True)
        self.bytes = self.messages = 0
        self.error = None
        self.socket = socket.create_connection((host, port), timeout=timeout_s)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /{query} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                             f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: foxglove.websocket.v1\r\n\r\n").encode())
        self.stream = self.socket.makefile("rb")
        status = self.stream.readline()
        if b" 101 " not in status:
            raise OSError(f"the server answered {status!r}")
        while self.stream.readline() not in (b"\r\n", b""):
            pass

    def send(self, opcode, payload):
        """A frame as a client sends it: masked."""
        mask = os.urandom(4)
        length = struct.pack("!B", 0x80 | len(payload)) if len(payload) < 126 else struct.pack("!BH", 0xFE, len(payload))
        self.socket.sendall(bytes([0x80 | opcode]) + length + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload)))

    def frame(self):
        """(opcode, payload) of the next frame; pieces of a message are counted one by one."""
        first, length = self.stream.read(2)
        length &= 0x7F
        if length >= 126:
            length = int.from_bytes(self.stream.read(2 if length == 126 else 8), "big")
        return first & 0x0F, self.stream.read(length)

    def run(self):
        try:
            while True:
                opcode, payload = self.frame()
                self.bytes += len(payload)
                self.messages += 1
                if opcode == 9:
                    self.send(10, payload)
                elif opcode == 8:
                    return
                elif opcode == 1 and (message := json.loads(payload))["op"] == "advertise":
                    wanted = [{"id": c["id"], "channelId": c["id"]} for c in message["channels"]]
                    self.send(1, json.dumps({"op": "subscribe", "subscriptions": wanted}).encode())
        except (OSError, ValueError) as error:  # the server has gone
            self.error = error
