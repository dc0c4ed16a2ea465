#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Accuracy on recorded logs in TUM format, with each rule for what moves and without rejection.
#
#   evaluate.sh DIR... [--seeds 5] [--rules silhouette,paper,off] [--modes lockstep] [--starts 0] [--camera FILE] [--model FILE]
#               [--detector-delay N] [--detector-every N] [--out DIR]
#
# Builds what is missing. Every log is replayed under each rule in each mode, once from each start (frames left out at the
# beginning) for each seed; tables go to the screen, everything else to OUT.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# Wrong arguments are told before minutes of building; without python3 (setup.sh brings it), after it.
[ ! -x /usr/bin/python3 ] || "$root/scripts/evaluate.py" --only-parse "$@"
"$root/scripts/setup.sh"
(cd "$root" && build_quietly release stillmap)
exec "$root/scripts/evaluate.py" "$@"
