#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Accuracy on recorded logs in TUM format, with each rule for what moves and without rejection.
#
#   evaluate.sh DIR... [--seeds 5] [--camera FILE] [--model FILE] [--detector-delay N] [--detector-every N] [--out DIR]
#
# Builds what is missing; evaluate.py --help says the rest.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
"$root/scripts/setup.sh"
build() { (cd "$root" && cmake --preset release && cmake --build --preset release --target stillmap); }
words=$(build 2>&1) || {
  tail -n 30 <<<"$words" >&2
  echo "evaluate.sh: the build failed" >&2
  exit 1
}
exec "$root/scripts/evaluate.py" "$@"
