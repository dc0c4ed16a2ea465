#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures the runtime on two cores of this machine and prints a table, then each part beside a baseline.
#
#   bench.sh [--log DIR --camera FILE --model FILE] [--seconds 60] [--runs 5]
#
# Without a log, one is rendered. STILLMAP_BENCH_MODELS="int8.onnx fp32.onnx" names networks to time side by side.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Wrong arguments are told before minutes of building; without python3 (setup.sh brings it), after it.
[ ! -x /usr/bin/python3 ] || scripts/bench.py --only-parse "$@"
scripts/setup.sh --bench
cmake --preset release -DSTILLMAP_BENCHES=ON >/dev/null
build_quietly release stillmap stillmap_synth stillmap_bench
scripts/bench.py "$@"
build/release/bin/stillmap_bench --benchmark_min_time=0.3
