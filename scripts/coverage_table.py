#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Lines and branches that were run, of a build with gcov's counters; prints a table by folder and writes what was not.

    coverage_table.py [BUILD]

A line of several compilations (templates, headers, sources that are joined) is covered where one of them ran it. Branches
that only exceptions take are left out: the compiler makes them at every call. BUILD/uncovered.txt names lines by file.
"""
import argparse
import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

from stillmap_runs import ROOT, print_table

FOLDERS = ("src", "drivers")


class Counts:
    """Of one source: how often each line and each of its branches was run."""

    def __init__(self):
        self.lines = defaultdict(int)
        self.branches = defaultdict(int)

    def add(self, lines):
        for line in lines:
            number = line["line_number"]
            self.lines[number] += line["count"]
            taken = [branch["count"] for branch in line["branches"] if not branch["throw"]]
            for at, count in enumerate(taken):
                self.branches[number, len(taken), at] += count

    def uncovered(self):
        return sorted(number for number, count in self.lines.items() if count == 0)


def read(build):
    """{path from the project's root: Counts} of our own sources."""
    sources = defaultdict(Counts)
    for data in sorted(build.rglob("*.gcda")):
        said = subprocess.run(["gcov", "--json-format", "--branch-probabilities", "--stdout", str(data)], capture_output=True, check=True)
        for text in said.stdout.splitlines():
            told = json.loads(text)
            for file in told["files"]:
                path = Path(told["current_working_directory"], file["file"]).resolve()
                if path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in FOLDERS:
                    sources[path.relative_to(ROOT)].add(file["lines"])
    return sources


def spans(numbers):
    """[3, 4, 5, 9] as "3-5, 9"."""
    parts = []
    for number in numbers:
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in parts)


def share(reached):
    reached = list(reached)
    return f"{100 * sum(count > 0 for count in reached) / len(reached):.1f} %" if reached else "-"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("build", type=Path, nargs="?", default=ROOT / "build/coverage")
    args = parser.parse_args()
    sources = read(args.build)
    if not sources:
        sys.exit(f"coverage_table.py: no counters in {args.build}; scripts/coverage.sh makes them")
    by_folder = defaultdict(list)
    for path, counts in sources.items():
        by_folder["/".join(path.parts[:2])].append(counts)
    rows = []
    for folder, group in [*sorted(by_folder.items()), ("all", list(sources.values()))]:
        rows.append((folder, sum(len(c.lines) for c in group), share(n for c in group for n in c.lines.values()),
                     sum(len(c.branches) for c in group), share(n for c in group for n in c.branches.values())))
    print_table(rows, ("folder", "lines", "run", "branches", "taken"))
    words = [f"{path}: {spans(counts.uncovered())}" for path, counts in sorted(sources.items()) if counts.uncovered()]
    (args.build / "uncovered.txt").write_text("\n".join(words) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
