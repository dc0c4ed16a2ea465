# SPDX-License-Identifier: Apache-2.0
"""Load from outside: eight clients, of which one never reads and one is hostile, and a process that eats a core. Nobody else is
disturbed."""
import os
import re
import socket
import subprocess
import sys
import threading
import time
import unittest

from program import DONE
from running import RunningTest

sys.path.insert(0, os.environ["STILLMAP_SOURCE_DIR"] + "/scripts")
from stream_client import StreamClient  # noqa: E402


class Hostile(threading.Thread):
    """Garbage, half requests, messages without end; comes back whenever it is thrown out."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.port, self.visits, self.going = port, 0, True

    def run(self):
        while self.going:
            try:
                if self.visits % 3 == 0:
                    with socket.create_connection(("127.0.0.1", self.port), timeout=2) as raw:
                        raw.sendall(os.urandom(4096))
                        raw.recv(1)
                elif self.visits % 3 == 1:
                    with socket.create_connection(("127.0.0.1", self.port), timeout=2) as raw:
                        raw.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")  # and no more
                        time.sleep(0.3)
                else:
                    client = StreamClient("127.0.0.1", self.port)
                    try:
                        for _ in range(2000):
                            client.send(1, b'{"op":"subscribe","subscriptions":[{"id":4294967295,"channelId":99}]}')
                    finally:
                        client.stream.close()
                        client.socket.close()
            except (OSError, ValueError):
                time.sleep(0.01)
            self.visits += 1


class Load(RunningTest):
    def test_eight_clients_one_slow_one_hostile_and_a_busy_process(self):
        process = self.start(*self.outputs())
        port = int(re.search(r":(\d+)/", self.metrics)[1])
        busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
        self.addCleanup(busy.wait)
        self.addCleanup(busy.kill)
        slow = StreamClient("127.0.0.1", port)
        slow.send(1, b'{"op":"subscribe","subscriptions":[%s]}' % b",".join(b'{"id":%d,"channelId":%d}' % (i, i) for i in range(1, 11)))
        hostile = Hostile(port)
        hostile.start()
        good = [StreamClient("127.0.0.1", port) for _ in range(6)]
        for client in good:
            client.start()
        self.wait_for(lambda: hostile.visits >= 6)
        before, seen = self.frames(), [client.messages for client in good]
        self.wait_for(lambda: self.frames() > before + 60)
        # All six are served on, alike, and none was thrown out.
        self.wait_for(lambda: all(client.messages > count + 30 for client, count in zip(good, seen)))
        self.assertEqual([client.error for client in good], [None] * 6)
        hostile.going = False
        self.wait_for(lambda: not hostile.is_alive())
        code, said = self.stop(process)
        self.assertEqual(code, DONE, said)
        facts = self.report()
        self.assertEqual(facts["tracking"]["lost"], 0)
        self.assertEqual(facts["frames"]["dropped"].get("no_free_slot", 0), 0)
        self.assertEqual(set(facts["memory"]["heap_allocations_after_start"][stage] for stage in ("capture", "track", "map")), {0})


if __name__ == "__main__":
    unittest.main()
