#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Boots a virtual 64-bit ARM board with the package of the aarch64 build, and treats it as a robot is treated.

    boot_test.py FOLDER

FOLDER keeps what boot_image.sh downloads. Needs the builds aarch64 (stillmap) and release (stillmap-synth). Minutes: the
processor is emulated.
"""
import base64
import json
import re
import socket
import struct
import subprocess
import sys
import time
import unittest
import urllib.error
import urllib.request
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "scripts"))
from stream_client import StreamClient  # noqa: E402

FOLDER = Path(sys.argv.pop(1) if len(sys.argv) > 1 else HERE.parents[1] / "build/boot")
MEMORY_MB = 1024  # of the smallest Raspberry Pi 4
PATIENCE_S = 1200  # others may use this machine, too
TOKEN = f"{FOLDER.name}-token-0123456789"  # boot_image.sh writes it
MAP = "/var/lib/stillmap/room.stillmap"


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Board:
    """The virtual machine, with two ports of the host for its stream and its root's shell."""

    def __init__(self, console):
        self.stream_port, self.shell_port = free_port(), free_port()
        self.started = time.monotonic()
        network = f"user,id=n,restrict=on,hostfwd=tcp:127.0.0.1:{self.stream_port}-:8765,hostfwd=tcp:127.0.0.1:{self.shell_port}-:2222"
        # Without waiting for what an emulated processor is too slow for: systemd's own limits are for real ones.
        options = "console=ttyAMA0 quiet panic=-1 systemd.default_timeout_start_sec=900 systemd.getty_auto=no"
        self.process = subprocess.Popen(
            ["qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72", "-accel", "tcg,thread=multi", "-smp", "2", "-m", str(MEMORY_MB), "-nographic",
             "-no-reboot", "-kernel", FOLDER / "vmlinuz", "-initrd", FOLDER / "initrd", "-append", options, "-drive", f"file={FOLDER / 'disk'},format=raw,if=virtio",
             "-netdev", network, "-device", "virtio-net-pci,netdev=n,romfile="],
            stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT)

    def wait_for(self, what, ask):
        """The first answer that is not None; a board that has not come so far refuses or hangs up."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end and self.process.poll() is None:
            try:
                if (answer := ask()) is not None:
                    return answer
            except (OSError, ValueError):
                pass
            time.sleep(1)
        raise AssertionError(f"waited in vain for {what}; {FOLDER / 'console.txt'} has the board's words")

    def shell(self, command):
        """What a command of the board's root says."""
        with socket.create_connection(("127.0.0.1", self.shell_port), timeout=PATIENCE_S) as s:
            s.sendall(command.encode() + b"\necho said $?\n")
            s.shutdown(socket.SHUT_WR)
            said = b"".join(iter(lambda: s.recv(65536), b"")).decode(errors="replace")
        text, ended, _ = said.rpartition("said ")
        if not ended:
            raise OSError("the shell has hung up")
        return text.strip()

    def get(self, path, query=f"?token={TOKEN}"):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.stream_port}{path}{query}", timeout=60) as answer:
            return answer.read().decode()


class Boot(unittest.TestCase):
    def setUp(self):
        print(subprocess.run([HERE / "boot_image.sh", FOLDER], check=True, capture_output=True, text=True).stdout, end="", flush=True)
        console = open(FOLDER / "console.txt", "w")  # pylint: disable=consider-using-with
        self.addCleanup(console.close)
        self.board = Board(console)
        self.addCleanup(self.board.process.wait)
        self.addCleanup(self.board.process.kill)

    def journal(self, *options):
        return self.board.shell(" ".join(["journalctl -u stillmap --no-pager", *options]))

    def tracking(self):
        health = json.loads(self.board.get("/health"))
        return health if health["state"] in ("tracking", "weak") else None

    def property(self, name):
        return self.board.shell(f"systemctl show -P {name} stillmap")

    def test_boots_streams_and_resumes_its_map_after_a_kill(self):
        board = self.board
        board.wait_for("the first pose", self.tracking)
        seconds = time.monotonic() - board.started
        began = re.search(r"\[ *([\d.]+)\].*tracking_started", self.journal("-o short-monotonic"))
        self.assertIsNotNone(began, self.journal())
        print(f"first pose {began[1]} s after the kernel's start, seen from outside {seconds:.0f} s after power on", flush=True)
        board.wait_for("systemd to be told READY", lambda: self.property("ActiveState") == "active" or None)
        self.assertIn("a new map begins", self.journal())

        with self.assertRaises(urllib.error.HTTPError) as refused:
            board.get("/health", query="")
        self.assertEqual(refused.exception.code, 401, "from outside only with the token")
        client = StreamClient("127.0.0.1", board.stream_port, f"?token={TOKEN}", timeout_s=PATIENCE_S)
        client.start()
        board.wait_for("poses and the map", lambda: client.bytes > 100_000 or None)

        # The end without warning, once a checkpoint holds keyframes to find the camera by.
        blocks = board.wait_for("a checkpoint", self.checkpointed_blocks)
        pid = self.property("MainPID")
        board.shell(f"kill -9 {pid}")
        board.wait_for("the restart", lambda: self.property("NRestarts") == "1" or None)
        board.wait_for("a pose after the restart", self.tracking)
        again = self.property("MainPID")
        self.assertNotIn(again, (pid, "0"))
        after = self.journal(f"_PID={again}")
        self.assertIn("relocalized", after)
        self.assertNotIn("a new map begins", after)
        held = re.search(r'high_water\{pool="map_blocks"\} (\d+)', board.get("/metrics"))
        self.assertGreaterEqual(int(held[1]), blocks)
        print(f"killed with {blocks} blocks checkpointed, went on with {held[1]}")
        print(board.shell(f"free -m; grep VmHWM /proc/{again}/status; systemctl show -p MemoryCurrent stillmap"))

    def checkpointed_blocks(self):
        """How many the newest checkpoint has, None while it has no keyframes: what the file ends with (docs/map.md)."""
        footer = base64.b64decode(self.board.shell(f"tail -c 24 {MAP} | base64"))
        blocks, keyframe_bytes, _ = struct.unpack("<3Q", footer) if len(footer) == 24 else (0, 0, 0)
        return blocks if keyframe_bytes > 0 else None


if __name__ == "__main__":
    unittest.main()
