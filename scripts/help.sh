# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What the scripts that a person runs share: --help and building; sourced by them, never run.

# answer_help "$@": where -h or --help is among the arguments, prints the comment at the script's head and ends the script.
answer_help() {
  local word
  for word in "$@"; do
    case $word in
      -h | --help)
        sed -n '3,/^[^#]/ { /^# shellcheck/d; s/^# \{0,1\}//p; }' "$0"
        exit 0
        ;;
    esac
  done
}

# build PRESET TARGET...: in the project's root.
build() {
  cmake --preset "$1" && cmake --build --preset "$1" --target "${@:2}"
}

# build_quietly PRESET TARGET...: says something only where it fails, and then ends the script.
build_quietly() {
  local words
  words=$(build "$@" 2>&1) || {
    tail -n 30 <<<"$words" >&2
    echo "$(basename "$0"): the build failed" >&2
    exit 1
  }
}
