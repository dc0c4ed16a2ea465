# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# --help of the scripts that a person runs; sourced by them, never run.

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
