# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What the download scripts share; sourced, never run.

# Known checksums, in the form that `sha256sum -c` reads.
PINS=${STILLMAP_PINS:-$(dirname "${BASH_SOURCE[0]}")/pins.sha256}

fail() {
  echo "$(basename "$0"): $*" >&2
  exit 1
}

# download URL FILE
download() {
  command -v curl >/dev/null || fail "curl is missing; apt-get install curl"
  curl --fail --location --silent --show-error --connect-timeout 20 --retry 2 --output "$2" "$1" 2>"$2.error" ||
    fail "cannot fetch $1 ($(tail -n 1 "$2.error")); is there an internet connection?"
}

# check_pin FILE NAME: refuses a file whose checksum is not the known one; the first of its name becomes the known one.
check_pin() {
  local found known
  found=$(sha256sum "$1" | cut -d ' ' -f 1)
  known=$(awk -v name="$2" '$2 == name { print $1 }' "$PINS")
  if [ -z "$known" ]; then
    echo "$2: sha256 $found (first fetch, noted in $PINS)"
    echo "$found  $2" >>"$PINS" || fail "cannot write $PINS; make it writable"
  elif [ "$found" != "$known" ]; then
    fail "$2 has sha256 $found, expected $known; nothing was installed, get the file anew"
  fi
}
