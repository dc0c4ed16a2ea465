#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that nothing on a frame's way is linked with a lock, a sleep or a wait without an end.

    check_symbols.py [BUILD]

Reads what the objects of the hot stages leave undefined, as the linker will; BUILD is build/release.
"""
import re
import subprocess
import sys
from pathlib import Path

HOT_ROOMS = ("core", "segment", "track", "map", "stream")
HOT_OBJECTS = ("capture", "capture_threads", "map_stage", "run_context", "threaded", "track_stage")  # of runtime
FORBIDDEN = re.compile(r"pthread_(mutex|cond|rwlock|spin|barrier)_|\bsem_(wait|timedwait|post)|\b(nanosleep|clock_nanosleep|usleep|sleep)\b|"
                       r"std::(mutex|timed_mutex|recursive_mutex|condition_variable|this_thread|future|promise)")


def undefined(file):
    """(object, symbol) of all undefined symbols in an object or archive."""
    result = subprocess.run(["nm", "--undefined-only", "--demangle", file], capture_output=True, text=True, check=True)
    where = Path(file).name
    for line in result.stdout.splitlines():
        if line.endswith(":"):
            where = line[:-1]
        elif match := re.match(r"\s+U (.*)", line):
            yield where, match[1]


def main():
    build = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent / "build/release"
    files = [build / "src" / room / f"libstillmap_{room}.a" for room in HOT_ROOMS]
    files += [build / "src/runtime/CMakeFiles/stillmap_runtime.dir" / f"{name}.cpp.o" for name in HOT_OBJECTS]
    if missing := [file for file in files if not file.is_file()]:
        sys.exit(f"check_symbols.py: {missing[0]} is not there; build first, or name the build folder")
    found = [f"{where}: {symbol}: locks and sleeps stay off a frame's way" for file in files for where, symbol in undefined(file) if FORBIDDEN.search(symbol)]
    print("\n".join(found), end="\n" if found else "")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
