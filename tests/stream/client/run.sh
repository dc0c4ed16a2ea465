#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh SERVER: installs the client's packages once, then runs its tests against the server program.
set -eu
server=$(realpath "$1")
cd "$(dirname "$0")"
if ! command -v npm >/dev/null; then
  echo "skipped: node and npm are missing; install nodejs and npm"
  exit 77
fi
[ -d node_modules ] || npm ci --no-audit --no-fund --ignore-scripts
exec node client_test.mjs "$server"
