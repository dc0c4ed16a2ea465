# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# Sourced. private_apt ARCHITECTURE FOLDER reads Debian 12's package list for another architecture into FOLDER; "${private[@]}"
# are then apt's options to work with that list. The host's package state stays as it is.
private_apt() {
  local keyring=/usr/share/keyrings/debian-archive-keyring.gpg
  [ -r "$keyring" ] || { echo "no $keyring to check Debian's signatures with; install debian-archive-keyring" >&2; return 1; }
  mkdir -p "$2"/{state/lists/partial,cache/archives/partial}
  : >"$2/status"
  # Without the security archive: its index has been in disagreement with itself, and its versions change all the time. What
  # runs on a robot links to that robot's own, updated libraries.
  echo "deb [signed-by=$keyring] ${STILLMAP_DEBIAN_MIRROR:-http://deb.debian.org/debian} bookworm main" >"$2/sources"
  private=(
    -o APT::Architecture="$1" -o APT::Architectures="$1" -o Dir::State="$2/state" -o Dir::State::status="$2/status"
    -o Dir::Cache="$2/cache" -o Dir::Etc::SourceList="$2/sources" -o Dir::Etc::SourceParts=/dev/null
    -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null -o APT::Sandbox::User=root
    -o Acquire::Languages=none -o Acquire::Retries=3 -o APT::Get::List-Cleanup=false -o APT::Update::Error-Mode=any
  )
  apt-get -qq "${private[@]}" update || { echo "Debian's package list for $1 could not be read (apt's words are above)" >&2; return 1; }
}
