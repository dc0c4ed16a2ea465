#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks everything: set-up, build, form, tests, tests under sanitizers, the whole pipeline against its bounds, the demo.
#
#   test.sh          in under 25 minutes on two cores
#   test.sh --full   the slow tests, too, all of them under address and UB sanitizer and on emulated ARM, the rooms' under the
#                    thread sanitizer, and the packages
#
# One line for each step; what a failed one said follows it. Ends with "N passed, N failed": tests and steps together.
# Tests with recorded logs find them in $STILLMAP_SHARED or ../shared, and are skipped where they are missing.
# shellcheck disable=SC2317  # the functions that `step` calls
set -uo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1

full=no
case "$*" in
  "") ;;
  --full) full=yes ;;
  *) echo "test.sh: unknown argument $*; usage: test.sh [--full]" >&2; exit 1 ;;
esac

logs=build/test-logs
mkdir -p "$logs"
passed=0 failed=0 skipped=0 number=0

# step NAME COMMAND...: a step is one test, unless the command closes with the counts of several.
step() {
  local name=$1 start=$SECONDS code=0 log counts
  shift
  number=$((number + 1))
  log=$logs/$(printf '%02d' "$number")-${name//[^a-z0-9]/-}.txt
  "$@" >"$log" 2>&1 || code=$?
  counts=$(sed -nE 's/^([0-9]+) passed, ([0-9]+) failed(, ([0-9]+) skipped)?$/\1 \2 \4/p
    s/^[0-9]+% tests passed, ([0-9]+) tests? failed out of ([0-9]+)$/ctest \1 \2/p' "$log" | tail -n 1)
  local good=0 bad=0 skips=0
  case $counts in
    ctest\ *)
      skips=$(grep -cE '^ +[0-9]+ - .*\(Skipped\)$' "$log")
      read -r _ bad good <<<"$counts"
      good=$((good - bad - skips)) ;;
    ?*) read -r good bad skips <<<"$counts" ;;
  esac
  # Whatever was counted, a command that fails is a failure.
  if [ "$code" -ne 0 ]; then bad=$((bad > 0 ? bad : 1)); elif [ -z "$counts" ]; then good=1; fi
  passed=$((passed + good)) failed=$((failed + bad)) skipped=$((skipped + ${skips:-0}))
  printf '%-7s %4d s  %s' "$([ "$code" -eq 0 ] && echo ok || echo FAILED)" $((SECONDS - start)) "$name"
  [ -z "$counts" ] || printf ' (%d passed, %d failed, %d skipped)' "$good" "$bad" "${skips:-0}"
  echo
  if [ "$code" -ne 0 ]; then
    # Without the lines about what went well.
    grep -vE '^\[[0-9]+/[0-9]+\] (Building|Linking|Generating)|^ +Start +[0-9]+: | Passed +[0-9.]+ sec$|^ok ' "$log" |
      tail -n 200 | sed 's/^/    /'
    echo "    (the last of $log)"
  fi
  return "$code"
}

finish() {
  echo "$((SECONDS / 60)) min $((SECONDS % 60)) s, $skipped skipped"
  echo "$passed passed, $failed failed"
  [ "$failed" -eq 0 ]
  exit
}

check_format() {
  git ls-files -z '*.cpp' '*.h' '*.h.in' | xargs -0 clang-format-14 --dry-run -Werror
}

# As the sanitized build joins the sources, so that headers are read once for ten of them; that sources are included is
# meant there. What sanitizers leave out is looked at, too.
check_tidy() {
  run-clang-tidy-14 -quiet -p build/asan -j "$(nproc)" -extra-arg=-USTILLMAP_SANITIZED -checks=-bugprone-suspicious-include \
    "$PWD/(build/asan/(src|drivers)/.*_cxx\.cxx|src/|drivers/)" 2>/dev/null |
    sed 's/\x1b\[[0-9;]*m//g' | grep -vE '^(clang-tidy-14 |$)'
  return "${PIPESTATUS[0]}"
}

# Views of pictures and vectors of three numbers are passed by value on purpose: they travel in registers.
check_cppcheck() {
  cppcheck -q --error-exitcode=1 -j "$(nproc)" --std=c++20 --enable=warning,performance,portability --inline-suppr \
    --suppress=passedByValue -Isrc -I. src drivers
}

# What is of configuration Full takes minutes. One more at once than there are cores: some mostly wait, for a second to pass
# or for a client.
run_ctest() { # PRESET OPTION...
  ctest --preset "$1" --parallel $(($(nproc) + 1)) --build-config "$([ "$full" = yes ] && echo Full || echo Release)" "${@:2}"
}

# The part of the ARM tests that says most for its time; --full has all of them.
check_arm() { # ARCHITECTURE
  toolchains/sysroot.sh "$1" && cmake --preset "$1-quick" && cmake --build --preset "$1-quick" &&
    ctest --preset "$1-quick" --parallel "$(nproc)"
}

step "set-up" scripts/setup.sh "--$([ "$full" = yes ] && echo full || echo tests)" || finish
step "build release" build release all || finish
step "format" check_format
step "folders and libraries" scripts/check_layers.py
step "no locks in hot objects" scripts/check_symbols.py
step "shellcheck" shellcheck -x scripts/*.sh toolchains/*.sh tests/packaging/*.sh .ci/run
# How often the program is stopped and killed at random moments; sanitized and emulated ones as often as in every run.
[ "$full" = no ] || export STILLMAP_SHUTDOWNS=200 STILLMAP_KILLS=60
step "tests" run_ctest release
unset STILLMAP_SHUTDOWNS STILLMAP_KILLS
step "pipeline within its bounds" scripts/ci_gates.py
step "demo" scripts/demo.sh --frames 60 --out build/demo
if [ "$full" = no ]; then
  step "part of the tests on aarch64" check_arm aarch64
  step "part of the tests on armhf" check_arm armhf
fi

# Under sanitizers, scripts and the program's black-box tests say little more than the rooms' tests and take much longer.
# What takes bytes or indices from elsewhere is in; track, segment, eval and paired only calculate. Threads meet in core,
# stream and runtime only.
asan_programs=(core_test detect_test map_test stream_test pictures_test tum_log_test recorder_test fuzz_test stillmap_fuzz)
asan_tests=(-R '^(core_test|detect_test|map_test|stream_test|pictures_test|tum_log_test|recorder_test|fuzz_test)\.')
tsan_programs=(core_test stream_test runtime_test)
# FastTracksEveryFrameInOrder plays without pauses, which takes this sanitizer a minute and a half; in lockstep one thread has
# most of the work, and the long ones of its tests take as much again.
tsan_tests=(-R '^(core_test\.|stream_test\.|runtime_test\.(Waker|Threads|Lockstep|Health|RunCounters))' -E 'FastTracksEveryFrameInOrder|Lockstep\.(IsTheSameTwice|NeverSheds|BoxesWithoutDelay|TheLongestDelay)')
if [ "$full" = yes ]; then
  asan_programs=(all) asan_tests=()
  # Black-box tests hold the program to the wall clock, of which it takes ten times as much here; and OpenNI2's library unlocks
  # what it has not locked.
  tsan_programs=(all) tsan_tests=(-E '^(app_test|scripts_test)\.')
fi
if step "build with address and UB sanitizer" build asan "${asan_programs[@]}"; then
  step "tests with address and UB sanitizer" run_ctest asan "${asan_tests[@]}"
  step "fuzzing" scripts/fuzz.sh "$([ "$full" = yes ] && echo 600 || echo 10)"
fi
step "clang-tidy" check_tidy
step "build with thread sanitizer" build tsan "${tsan_programs[@]}" &&
  step "tests with thread sanitizer" run_ctest tsan "${tsan_tests[@]}"

# Minutes each: ARM under emulation, and the packages.
if [ "$full" = yes ]; then
  step "cppcheck" check_cppcheck
  for arm in aarch64 armhf; do
    step "libraries of $arm" toolchains/sysroot.sh "$arm" && step "build $arm" build "$arm" all &&
      step "tests on $arm" run_ctest "$arm"
  done
  step "packages in a clean root" tests/packaging/install_test.sh
  step "boots as a robot" tests/packaging/boot_test.py build/boot
fi
finish
