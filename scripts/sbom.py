#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Lists what a built program is made of, as a CycloneDX 1.5 document on standard output.

    sbom.py [PROGRAM]      build/release/bin/stillmap

Each shared library that the loader takes (as `ldd` says, the driver modules beside the program included) with the package
that it came from and its version, asked of dpkg; what the program names itself is marked as direct. Needs binutils.
"""
import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

from stillmap_runs import ROOT


def fail(message):
    sys.exit(f"sbom.py: {message}")


def output_of(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        words = getattr(error, "stderr", None) or str(error)
        return fail(f"{' '.join(map(str, command))}: {words.strip().splitlines()[-1]}")


def libraries(program):
    """Real paths of the shared libraries, with whether the program asks for each by name."""
    asked = set(re.findall(r"\(NEEDED\).*\[(.+)\]", output_of("readelf", "--dynamic", "--wide", program)))
    found = re.findall(r"(\S+) => (/\S+)|^\s*(/\S+)", output_of("ldd", program), re.M)
    return {Path(path or loader).resolve(): name in asked for name, path, loader in found}


def packages_of(libraries):
    """For each library name, version, architecture and source of the package that it is of."""
    # Where /lib is a link to /usr/lib, dpkg knows a file by the name that its package gave it.
    names = {str(alias): library for library in libraries for alias in (library, Path("/", *library.parts[2:]))}
    found = subprocess.run(["dpkg-query", "--search", *names], capture_output=True, text=True, check=False).stdout
    owners = {names[path]: owner.split(",")[0] for owner, path in (line.split(": ", 1) for line in found.splitlines()) if path in names}
    for library in libraries:
        if library not in owners:
            fail(f"{library} is of no package; list it by hand")
    shown = output_of("dpkg-query", "--show", "--showformat", "${binary:Package}\t${Package}\t${Version}\t${Architecture}\t${source:Package}\n",
                      *sorted(set(owners.values())))
    facts = {name.split(":")[0]: tuple(rest) for name, *rest in (line.split("\t") for line in shown.splitlines())}
    return {library: facts[owner.split(":")[0]] for library, owner in owners.items()}


def component(package, version, architecture, source, files, direct):
    return {"type": "library", "name": package, "version": version, "purl": f"pkg:deb/debian/{package}@{version}?arch={architecture}",
            "properties": [{"name": "stillmap:source", "value": source},
                           {"name": "stillmap:direct", "value": str(direct).lower()},
                           *({"name": "stillmap:file", "value": str(file)} for file in sorted(files))]}


def main():
    if len(sys.argv) > 2:
        sys.exit("usage: sbom.py [PROGRAM]")
    program = Path(sys.argv[1]) if len(sys.argv) == 2 else ROOT / "build/release/bin/stillmap"
    if not program.is_file():
        fail(f"{program} is not there; build it, or name another")
    direct = {}
    for built in (program, *sorted(program.parent.glob("libstillmap_driver_*.so"))):
        for library, asked in libraries(built).items():
            direct[library] = direct.get(library, False) or asked
    packages = {}
    for library, package in packages_of(direct).items():
        packages.setdefault(package, []).append(library)
    version = re.match(r"stillmap (\S+) \((\S+)\)", output_of(program, "--version"))
    print(json.dumps({
        "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
        "metadata": {"component": {
            "type": "application", "name": "stillmap", "version": version[1],
            "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(program.read_bytes()).hexdigest()}],
            "properties": [{"name": "stillmap:git_revision", "value": version[2]}]}},
        "components": [component(*package, files, any(direct[file] for file in files)) for package, files in sorted(packages.items())]}, indent=2))


if __name__ == "__main__":
    main()
