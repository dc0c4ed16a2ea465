#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which lines and branches of src/ and drivers/ the tests reach: builds with gcov's counters, runs the tests, prints a table.
#
#   coverage.sh [CTEST OPTION...]      all tests, or those that the options choose, e.g. -R '^core_test'
#
# The table is build/coverage/summary.txt, beside it uncovered.txt: the lines that no test reached.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
cd "$(dirname "${BASH_SOURCE[0]}")/.."

build coverage all
find build/coverage -name '*.gcda' -delete
# Some tests limit the size of files: the counters' are there before, at full length, and what gcov says is not the program's word.
export GCOV_ERROR_FILE=/dev/null
build/coverage/bin/stillmap --version >/dev/null
# A test that fails has covered lines nevertheless; that it fails is told by the build without counters.
# Left out: what kills the program while it may be writing counters, which spoils those of all tests, and what looks at how the
# shipped program is compiled.
ctest --preset coverage --parallel "$(nproc)" --quiet --exclude-regex '^app_test\.(power_cut|signals|hostile_world|hardening)$' "$@" || echo "coverage.sh: some tests failed; the table counts what they reached" >&2
scripts/coverage_table.py build/coverage | tee build/coverage/summary.txt
