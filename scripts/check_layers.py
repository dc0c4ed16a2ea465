#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that the folders of src/ and drivers/ keep to what they may know and use.

    check_layers.py [ROOT]

app -> runtime -> {detect, segment, track, map, stream, eval, drivers} -> core, and siblings never include each other.
An outside library is included by one .cpp, or stays in its folders; no locks or sleeps; only app writes to stdout.
"""
import re
import sys
from pathlib import Path

SIBLINGS = {"detect", "segment", "track", "map", "stream", "eval", "drivers"}
MAY_INCLUDE = {room: {"core"} for room in SIBLINGS} | {"core": set(), "runtime": SIBLINGS | {"core"}, "app": SIBLINGS | {"core", "runtime"}}
SHARED_BY_DRIVERS = "pictures"
GENERATED = {"foxglove.pb.h": "stream", "stillmap.pb.h": "stream"}  # beside those that have their room's folder in their name

# Outside libraries: what their headers begin with, and the folders that may include them. None: a single .cpp may.
LIBRARIES = {
    "OpenCV": (("opencv2/",), None),
    "Eigen": (("Eigen/",), ("core", "track", "eval")),
    "nlohmann-json": (("nlohmann/",), ("runtime",)),
    "spdlog": (("spdlog/", "fmt/"), ("runtime",)),
    "CLI11": (("CLI/",), ("app",)),
    "toml++": (("toml++/",), None),
    "libspng": (("spng.h",), None),
    "libjpeg": (("jpeglib.h", "jerror.h", "turbojpeg.h"), None),
    "libwebsockets": (("libwebsockets.h",), None),
    "nanopb": (("pb.h", "pb_encode.h", "pb_decode.h"), ("stream",)),
    "OpenSSL": (("openssl/",), None),
    "OpenNI2": (("OpenNI.h",), None),
    "libcamera": (("libcamera/",), None),
}
WITHOUT_OPENCV = {"core", "map", "stream", "eval"}
SYSTEM = re.compile(r"[a-z_0-9]+|(sys|linux|netinet|arpa)/[a-z_0-9-]+\.h|(arm_neon|dlfcn|errno|fcntl|immintrin|link|malloc|netdb|poll|pthread|sched|signal|time|unistd)\.h")
LOCKS = re.compile(r"<(mutex|shared_mutex|condition_variable|semaphore)>|\b(std::(\w*mutex|\w+_lock|lock_guard)\b|std::condition_variable|"
                   r"pthread_(mutex|cond|spin|rwlock)_|sleep_for\b|sleep_until\b|u?sleep\(|nanosleep\()")
STDOUT = re.compile(r"\bstd::cout\b|\bstdout\b|(?<![a-z_])(printf|puts|putchar)\(")
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


def without_comments(text):
    return COMMENT.sub(lambda m: "\n" * m.group().count("\n"), text)


def check_own_include(room, path, name):
    """Why `path` in `room` must not include "name", or None."""
    target = name.split("/")[0]
    if GENERATED.get(name) == room:
        return None
    if target not in MAY_INCLUDE or "/" not in name or ".." in name:
        return f'"{name}" does not begin with a room; write it from src/ on'
    if target != room and target not in MAY_INCLUDE[room]:
        return f'"{name}": {room} must not know {target}; meet in a type of core'
    if room == target == "drivers" and len(parts := name.split("/")) > 2 and parts[1] not in (path.parts[1], SHARED_BY_DRIVERS):
        return f'"{name}": a driver must not know another'
    return None


def check(root):
    """The findings, one line each: FILE:LINE: what and the mend."""
    findings, users = [], {}
    sources = [p.relative_to(root / "src") for p in (root / "src").rglob("*.*")] + [p.relative_to(root) for p in (root / "drivers").rglob("*.*")]
    for path in sorted(p for p in sources if p.suffix in (".h", ".cpp")):
        room = path.parts[0]
        shown = path if room == "drivers" else Path("src") / path
        if room not in MAY_INCLUDE:
            findings.append(f"{shown}:1: {room} is no room that check_layers.py knows")
            continue
        for number, line in enumerate(without_comments((root / shown).read_text(encoding="utf-8")).splitlines(), 1):
            def report(what):
                findings.append(f"{shown}:{number}: {what}")
            if own := re.match(r'\s*#\s*include\s*"([^"]+)"', line):
                if what := check_own_include(room, path, own[1]):
                    report(what)
                continue
            if LOCKS.search(line):
                report("locks and sleeps stay out; use rings, LatestValue and Waker")
            if room != "app" and STDOUT.search(line):
                report("only app writes to stdout; emit an Event or log with spdlog in runtime")
            if not (outside := re.match(r"\s*#\s*include\s*<([^>]+)>", line)) or SYSTEM.fullmatch(outside[1]):
                continue
            library = next((n for n, (headers, _) in LIBRARIES.items() if outside[1].startswith(headers)), None)
            if library is None:
                report(f"<{outside[1]}> is of no library that check_layers.py knows")
                continue
            folders = LIBRARIES[library][1]
            if library == "OpenCV" and room in WITHOUT_OPENCV:
                report(f"OpenCV stays out of {room}")
            if folders is not None and room not in folders:
                report(f"{library} stays in {', '.join(folders)}")
            if folders is None:
                if path.suffix != ".cpp":
                    report(f"{library} belongs into a .cpp, not into a header")
                users.setdefault(library, set()).add(str(shown))
    findings += [f"{sorted(files)[1]}:1: {library} is also included by {sorted(files)[0]}; one .cpp may" for library, files in users.items() if len(files) > 1]
    return findings


def main():
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent
    if not (root / "src").is_dir():
        sys.exit(f"check_layers.py: {root} has no src/; name the project's root")
    findings = check(root)
    print("\n".join(findings), end="\n" if findings else "")
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
