#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh TEST ARGUMENT...: installs the client's packages once, then runs TEST.mjs.
set -eu
cd "$(dirname "$0")"
if ! command -v npm >/dev/null; then
  echo "skipped: node and npm are missing; install nodejs and npm"
  exit 77
fi
# Two tests may be here at once; npm is not made for that.
(flock 9 && { [ -d node_modules/puppeteer-core ] || npm ci --fetch-retries 5 --no-audit --no-fund --ignore-scripts; }) 9>.install-lock
test=$1
shift
exec node "$test.mjs" "$@"
