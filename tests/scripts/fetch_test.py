# SPDX-License-Identifier: Apache-2.0
"""get_model.sh and get_tum.sh: what is right is installed whole, what is wrong leaves nothing behind."""
import hashlib
import os
import shutil
import subprocess
import tarfile
import tempfile
import unittest
import zipfile
from pathlib import Path

SCRIPTS = Path(os.environ["STILLMAP_SCRIPTS"])
MODEL, PARAM, BIN = "nanodet_plus_m_int8.onnx", "nanodet-plus-m_416.param", "nanodet-plus-m_416.bin"
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
        self.assertEqual(self.left(self.models), [MODEL])

    def test_wrong_model_is_refused(self):
        (self.path / MODEL).write_bytes(b"weights, tampered with")
        self.models.mkdir()
        (self.models / MODEL).write_bytes(b"the old one")
        result = self.run_script("get_model.sh", "--from", self.path, code=1, STILLMAP_PINS=SCRIPTS / "pins.sha256")
        self.assertIn("expected b38dc42b22951ae5001d2b4ba0e1c49c9e47a6f7712cd31f20fc97c656fb478e", result.stderr)
        self.assertEqual((self.models / MODEL).read_bytes(), b"the old one")
        self.assertEqual(self.left(self.models), [MODEL])

    def test_folder_without_a_model(self):
        self.assertIn("holds no " + MODEL, self.run_script("get_model.sh", "--from", self.path, code=1).stderr)

    def test_wrong_arguments(self):
        self.assertIn("usage", self.run_script("get_model.sh", "--form", self.path, code=1).stderr)
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

    def test_fetched_weights(self):
        with zipfile.ZipFile(self.path / "nanodet-plus-m_416_ncnn.zip", "w") as archive:
            archive.writestr("inside/" + PARAM, "layers")
            archive.writestr("inside/" + BIN, "weights")
        self.pin(PARAM, b"layers")
        self.pin(BIN, b"weights")
        result = self.run_script("get_model.sh", code=1, STILLMAP_NANODET_URL=self.path.as_uri())
        self.assertIn("conversion to " + MODEL + " comes with a later version", result.stderr)
        self.assertEqual(self.left(self.models), [BIN, PARAM])

    def test_fetched_weights_that_differ_are_refused(self):
        with zipfile.ZipFile(self.path / "nanodet-plus-m_416_ncnn.zip", "w") as archive:
            archive.writestr(PARAM, "layers")
            archive.writestr(BIN, "other weights")
        self.pin(PARAM, b"layers")
        self.pin(BIN, b"weights")
        self.run_script("get_model.sh", code=1, STILLMAP_NANODET_URL=self.path.as_uri())
        self.assertEqual(self.left(self.models), [])

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
