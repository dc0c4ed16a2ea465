#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# example_test.sh BUILD CAMERA LOG FRAMES: installs into a folder what the package libstillmap-dev of a build holds, builds the
# example against that alone, as the library's users do, and expects a pose for each frame of the log.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
installed=$work/root/usr

quietly() { "$@" >"$work/said.txt" 2>&1 || { cat "$work/said.txt"; exit 1; }; }
DESTDIR=$work/root quietly cmake --install "$1" --component dev --prefix /usr
quietly cmake -S "$installed/share/doc/libstillmap-dev/example" -B "$work/build" -D CMAKE_PREFIX_PATH="$installed"
quietly cmake --build "$work/build"
poses=$("$work/build/example" "$2" "$3" | wc -l)
echo "$poses poses from the example"
[ "$poses" -eq "$4" ]
