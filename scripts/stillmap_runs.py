# SPDX-License-Identifier: Apache-2.0
"""What the scripts that run `stillmap` share; imported, never run."""
import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


class RunFailed(Exception):
    """One line that says what went wrong."""


def read_report(path):
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunFailed(f"cannot read the report {path}: {error}") from error


def run_stillmap(binary, log, configs, out, *arguments):
    """Runs over the log in folder `log`; leaves trajectory.txt, map.ply and log.txt in the folder `out`, returns the report."""
    out.mkdir(parents=True, exist_ok=True)
    command = [binary, "run", "--source", f"tum:{log}", "--listen", "off", "--report", out / "report.json",
               "--trajectory", out / "trajectory.txt", "--map", out / "map.ply"]
    for config in configs:
        command += ["--config", config]
    if (Path(log) / "groundtruth.txt").is_file():
        command += ["--groundtruth", Path(log) / "groundtruth.txt"]
    command = [str(word) for word in [*command, *arguments]]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    (out / "log.txt").write_text(result.stdout + result.stderr, encoding="utf-8")
    if result.returncode != 0:
        words = result.stderr.strip().splitlines()
        raise RunFailed(f"{words[-1] if words else 'no word'} (exit code {result.returncode} of: {' '.join(command)})")
    return read_report(out / "report.json")


def print_table(rows, head):
    """Columns as wide as they need to be, the first to the left, numbers to the right."""
    rows = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for number, row in enumerate(rows):
        print("  ".join(cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths))).rstrip())
        if number == 0:
            print("  ".join("-" * w for w in widths))
