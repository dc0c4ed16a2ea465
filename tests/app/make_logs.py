# SPDX-License-Identifier: Apache-2.0
"""Renders the log that the other tests replay, once, and makes the demo's network."""
import shutil
import subprocess
import sys

from program import FRAMES, LOGS, LOG, MODEL, SOURCE, SYNTH

shutil.rmtree(LOGS, ignore_errors=True)
LOGS.mkdir(parents=True)
subprocess.run([SYNTH, "--out", LOG, "--seed", "3", "--frames", str(FRAMES)], check=True)
subprocess.run([sys.executable, SOURCE / "scripts/make_demo_model.py", MODEL], check=True)
