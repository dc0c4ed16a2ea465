#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fuzzes what bytes of strangers reach (tests/fuzz), with address and UB sanitizer; two targets at a time.
#
#   fuzz.sh [SECONDS [TARGET...]]      10 s each, all targets
#
# What it learns stays in build/fuzz/corpus. The input of a crash is named; once it is mended, that file belongs into
# tests/fuzz/corpus/TARGET, which is a test in every build. Ends with "N passed, N failed".
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds=${1:-10}
[[ $seconds =~ ^[1-9][0-9]*$ ]] || { echo "fuzz.sh: $seconds is no number of seconds; usage: fuzz.sh [SECONDS [TARGET...]]" >&2; exit 1; }
targets=("${@:2}")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cd tests/fuzz/corpus && ls)

build_quietly asan stillmap_fuzz

fuzz() { # TARGET
  local learned=build/fuzz/corpus/$1 log=build/fuzz/$1.log
  mkdir -p "$learned"
  if build/asan/bin/stillmap_fuzz "--target=$1" "-max_total_time=$seconds" -timeout=10 -rss_limit_mb=1024 -max_len=16384 -print_final_stats=1 \
    "-artifact_prefix=build/fuzz/$1-" "$learned" "tests/fuzz/corpus/$1" >"$log" 2>&1; then
    echo "ok      $1: $(sed -n 's/^stat::number_of_executed_units: *//p' "$log") inputs"
  else
    echo "FAILED  $1: $(grep -m 1 -E 'runtime error|ERROR:|no such' "$log" || tail -n 1 "$log") ($(grep -oE "build/fuzz/$1-[a-z]+-[0-9a-f]+" "$log" | tail -n 1))"
  fi
}
export -f fuzz
export seconds
results=$(printf '%s\n' "${targets[@]}" | xargs -P 2 -I{} bash -c 'fuzz {}')
echo "$results"
failed=$(grep -c '^FAILED' <<<"$results" || true)
echo "$((${#targets[@]} - failed)) passed, $failed failed"
[ "$failed" -eq 0 ]
