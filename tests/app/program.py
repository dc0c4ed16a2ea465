# SPDX-License-Identifier: Apache-2.0
"""The program under test, and what its tests share."""
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(os.environ["STILLMAP_SOURCE_DIR"])
LOGS = Path(os.environ["STILLMAP_TEST_LOGS"])
PROGRAM, SYNTH = os.environ["STILLMAP_BIN"], os.environ["STILLMAP_SYNTH"]
LOG, MODEL, FRAMES = LOGS / "log", LOGS / "demo.onnx", 45
GROUNDTRUTH = LOG / "groundtruth.txt"
CAMERA = ["--config", SOURCE / "firmware-config/cameras/synthetic.toml"]
NO_DETECTOR = ["--set", "detector.model=none"]
DETECTOR = ["--config", SOURCE / "firmware-config/demo.toml", "--set", f"detector.model={MODEL}"]
QUIET = ["--listen", "off"]
DONE, RUN_FAILED, WRONG_CONFIG, UNREADABLE_INPUT = 0, 1, 2, 3


def stillmap(*args, timeout=600):
    return subprocess.run([PROGRAM, *args], capture_output=True, text=True, timeout=timeout, errors="replace")


def run_args(*args, log=LOG, detector=NO_DETECTOR, listen=QUIET):
    return ["run", *CAMERA, *detector, *listen, "--source", f"tum:{log}", *args]


def link_log(folder, frames=FRAMES):
    """A log of the first frames of the rendered one, whose files can be replaced one by one."""
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    lines = [l for l in (LOG / "associations.txt").read_text().splitlines() if not l.startswith("#")][:frames]
    for line in lines:
        for name in line.split()[1::2]:
            (folder / name).symlink_to(LOG / name)
    (folder / "associations.txt").write_text("\n".join(lines) + "\n")
    return folder


class ProgramTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def outputs(self, folder=None):
        folder = folder or self.path
        folder.mkdir(exist_ok=True)
        names = {"--trajectory": "t.txt", "--trajectory-final": "f.txt", "--map": "m.ply", "--report": "r.json"}
        return [a for option, name in names.items() for a in (option, folder / name)]

    def assert_error(self, result, code, *words, lines=None):
        """One line for the user comes last on stderr and names the thing and the mend; stdout is silent."""
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertEqual(result.stdout, "")
        said = result.stderr.splitlines()
        if lines is not None:
            self.assertEqual(len(said), lines, result.stderr)
        self.assertTrue(said[-1].startswith("stillmap: "), result.stderr)
        self.assertEqual(sum(line.startswith("stillmap: ") for line in said), 1)
        for word in words:
            self.assertIn(word, said[-1])
