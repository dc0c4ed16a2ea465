# SPDX-License-Identifier: Apache-2.0
"""get_model.sh and get_tum.sh: what is right is installed whole, what is wrong leaves nothing behind."""
import hashlib
import os
import shutil
import subprocess
import tarfile
import tempfile
import tomllib
import unittest
import zipfile
from pathlib import Path

import cv2
import numpy as np

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
SHARED = Path(os.environ["STILLMAP_SHARED"]) if os.environ.get("STILLMAP_SHARED") else None
MODEL, MANIFEST = "nanodet_plus_m_int8.onnx", "nanodet_plus_m_int8.toml"
PARAM, BIN, ARCHIVE = "nanodet-plus-m_416.param", "nanodet-plus-m_416.bin", "nanodet-plus-m_416_ncnn.zip"
NOWHERE = "http://127.0.0.1:9"  # the discard port: refuses at once, as a machine without a network does


class FetchTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        self.models, self.pins = self.path / "models", self.path / "pins"
        self.pins.write_text("")

    def run_script(self, name, *arguments, code, **environment):
        defaults = {"STILLMAP_MODELS": self.models, "STILLMAP_PINS": self.pins, "STILLMAP_NANODET_URL": NOWHERE, "STILLMAP_TUM_URL": NOWHERE}
        result = subprocess.run([SCRIPTS / name, *arguments], capture_output=True, text=True, cwd=self.path,
                                env=os.environ | {k: str(v) for k, v in (defaults | environment).items()})
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        if code != 0:
            self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        return result

    def pin(self, name, content):
        with self.pins.open("a") as file:
            file.write(f"{hashlib.sha256(content).hexdigest()}  {name}\n")

    def left(self, folder):
        return sorted(p.name for p in folder.iterdir()) if folder.exists() else []

    def test_model_from_a_local_folder(self):
        (self.path / MODEL).write_bytes(b"weights")
        self.pin(MODEL, b"weights")
        self.run_script("get_model.sh", "--from", self.path, code=0)
        self.assertEqual((self.models / MODEL).read_bytes(), b"weights")
        self.assert_installed()

    def assert_installed(self):
        self.assertEqual(self.left(self.models), [MODEL, MANIFEST])
        manifest = tomllib.loads((self.models / MANIFEST).read_text())["detector"]
        self.assertEqual(manifest["sha256"], hashlib.sha256((self.models / MODEL).read_bytes()).hexdigest())
        self.assertEqual(manifest["decoder"], "nanodet_plus")

    def test_wrong_model_is_refused(self):
        (self.path / MODEL).write_bytes(b"weights, tampered with")
        self.models.mkdir()
        (self.models / MODEL).write_bytes(b"the old one")
        result = self.run_script("get_model.sh", "--from", self.path, code=1, STILLMAP_PINS=SCRIPTS / "pins.sha256")
        self.assertIn("expected b38dc42b22951ae5001d2b4ba0e1c49c9e47a6f7712cd31f20fc97c656fb478e", result.stderr)
        self.assertEqual((self.models / MODEL).read_bytes(), b"the old one")
        self.assertEqual(self.left(self.models), [MODEL])

    def test_folder_without_a_model(self):
        error = self.run_script("get_model.sh", "--from", self.path, code=1).stderr
        self.assertIn(f"holds no {PARAM} and no {MODEL}", error)
        self.run_script("get_model.sh", "--from", self.path / "none", code=1)

    def test_wrong_arguments(self):
        self.assertIn("usage", self.run_script("get_model.sh", "--form", self.path, code=1).stderr)
        self.assertIn("--log needs a folder", self.run_script("get_model.sh", "--log", code=1).stderr)
        self.assertIn("usage", self.run_script("get_tum.sh", code=1).stderr)
        for name in ("walking_xyz", "fr4_xyz", "fr1_../../x", ""):
            self.assertIn("no sequence name", self.run_script("get_tum.sh", name, code=1).stderr)

    def test_no_internet(self):
        for script in (["get_model.sh"], ["get_tum.sh", "fr3_walking_xyz"]):
            error = self.run_script(*script, code=1).stderr
            self.assertIn("cannot fetch " + NOWHERE, error)
            self.assertIn("internet connection", error)
        self.assertEqual(self.left(self.models), [])
        self.assertEqual(self.left(self.path / "data"), [])
        self.assertEqual(self.pins.read_text(), "")

    def release(self, param, weights):
        with zipfile.ZipFile(self.path / ARCHIVE, "w") as archive:
            archive.writestr("inside/" + PARAM, param)
            archive.writestr("inside/" + BIN, weights)
        return {"STILLMAP_NANODET_URL": self.path.as_uri()}

    def log(self):
        """Pictures to quantize with, in a folder that is no TUM log."""
        (self.path / "pictures").mkdir()
        for i in range(2):
            cv2.imwrite(str(self.path / f"pictures/{i}.png"), np.random.default_rng(i).integers(0, 255, (48, 64, 3), np.uint8))
        return self.path / "pictures"

    def test_fetched_weights_that_differ_are_refused(self):
        self.pin(PARAM, b"layers")
        self.pin(BIN, b"weights")
        self.run_script("get_model.sh", "--log", self.log(), code=1, **self.release("layers", "other weights"))
        self.assertEqual(self.left(self.models), [])

    def test_weights_that_are_no_network_are_refused(self):
        log, release = self.log(), self.release("layers", "weights")
        (self.path / PARAM).write_text("layers")
        (self.path / BIN).write_text("weights")
        for source in ([], ["--from", self.path]):
            error = self.run_script("get_model.sh", *source, "--log", log, code=1, **release).stderr
            self.assertIn("is no .param file of ncnn", error)
            self.assertEqual(self.left(self.models), [])

    @unittest.skipUnless(SHARED, "needs the published weights: STILLMAP_SHARED")
    def test_the_published_weights_become_a_network(self):
        folder, log = SHARED / "models/nanodet_plus_m", self.log()
        pins = {"STILLMAP_PINS": SCRIPTS / "pins.sha256"}
        release = self.release((folder / PARAM).read_bytes(), (folder / BIN).read_bytes())
        fetched = self.run_script("get_model.sh", "--log", log, code=0, **pins, **release)
        self.assertIn("boxes on 1 other frames", fetched.stdout)
        self.assert_installed()
        self.assertLess((self.models / MODEL).stat().st_size, 1_500_000)
        cv2.dnn.readNetFromONNX(str(self.models / MODEL))
        self.run_script("get_model.sh", "--from", folder, code=0, **pins)
        self.assertEqual((self.models / MODEL).read_bytes(), (folder / MODEL).read_bytes())
        self.assert_installed()

    def tum_archive(self):
        name = "rgbd_dataset_freiburg3_walking_xyz"
        (self.path / name).mkdir()
        (self.path / name / "groundtruth.txt").write_text("# ground truth\n")
        (self.path / "mirror/freiburg3").mkdir(parents=True)
        archive = self.path / "mirror/freiburg3" / (name + ".tgz")
        with tarfile.open(archive, "w:gz") as tar:
            tar.add(self.path / name, name)
        return archive

    def get_tum(self, code):
        return self.run_script("get_tum.sh", "fr3_walking_xyz", "logs", code=code, STILLMAP_TUM_URL=(self.path / "mirror").as_uri())

    def test_tum_sequence_is_installed_and_pinned(self):
        archive = self.tum_archive()
        digest = hashlib.sha256(archive.read_bytes()).hexdigest()
        self.assertIn(digest, self.get_tum(code=0).stdout)
        self.assertEqual(self.left(self.path / "logs"), ["fr3_walking_xyz"])
        self.assertTrue((self.path / "logs/fr3_walking_xyz/groundtruth.txt").is_file())
        self.assertEqual(self.pins.read_text(), f"{digest}  {archive.name}\n")
        self.assertIn("there already", self.get_tum(code=0).stdout)

    def test_changed_tum_sequence_is_refused(self):
        self.pin(self.tum_archive().name, b"what it was")
        self.assertIn("nothing was installed", self.get_tum(code=1).stderr)
        self.assertEqual(self.left(self.path / "logs"), [])

    def test_cut_off_tum_sequence_is_refused_and_not_pinned(self):
        archive = self.tum_archive()
        archive.write_bytes(archive.read_bytes()[:-40])
        self.assertIn("no complete archive", self.get_tum(code=1).stderr)
        self.assertEqual(self.left(self.path / "logs"), [])
        self.assertEqual(self.pins.read_text(), "")

    @unittest.skipUnless(shutil.which("shellcheck"), "needs shellcheck")
    def test_shellcheck(self):
        files = sorted(str(p.relative_to(SCRIPTS.parent)) for p in SCRIPTS.glob("*.sh"))
        result = subprocess.run(["shellcheck", "-x", *files], cwd=SCRIPTS.parent, capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stdout)


if __name__ == "__main__":
    unittest.main()
