#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Downloads one sequence of the TUM RGB-D benchmark (CC BY 4.0, https://cvg.cit.tum.de/data/datasets/rgbd-dataset).
#
#   get_tum.sh NAME [DIR]   e.g. get_tum.sh fr3_walking_xyz; DIR defaults to data/ and gets a folder NAME
#
# STILLMAP_TUM_URL names a mirror of https://cvg.cit.tum.de/rgbd/dataset.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
# shellcheck source=scripts/fetch.sh
. "$(dirname "${BASH_SOURCE[0]}")/fetch.sh"

case $# in
  1 | 2) ;;
  *) fail "usage: get_tum.sh NAME [DIR], e.g. get_tum.sh fr3_walking_xyz" ;;
esac
name=$1
folder=${2:-data}
[[ $name =~ ^fr([123])_([a-z0-9_]+)$ ]] || fail "$name is no sequence name; they are like fr1_xyz, fr2_desk or fr3_walking_halfsphere"
camera=freiburg${BASH_REMATCH[1]}
sequence=rgbd_dataset_${camera}_${BASH_REMATCH[2]}
url=${STILLMAP_TUM_URL:-https://cvg.cit.tum.de/rgbd/dataset}/$camera/$sequence.tgz

if [ -e "$folder/$name" ]; then
  echo "$folder/$name is there already"
  exit 0
fi
mkdir -p "$folder" || fail "cannot write $folder; name a folder that you may write to"
work=$(mktemp -d "$folder/.get_tum.XXXXXX") || fail "cannot write $folder; name a folder that you may write to"
trap 'rm -rf "$work"' EXIT

download "$url" "$work/$sequence.tgz"
# Unpacked before it is pinned, so that a broken or cut-off answer never becomes the known checksum.
tar -xzf "$work/$sequence.tgz" -C "$work" 2>/dev/null || fail "$url is no complete archive; nothing was installed, try again"
[ -f "$work/$sequence/groundtruth.txt" ] || fail "$url holds no $sequence/groundtruth.txt; nothing was installed"
check_pin "$work/$sequence.tgz" "$sequence.tgz"
mv "$work/$sequence" "$folder/$name"
echo "installed $folder/$name; a run takes it as --source tum:$folder/$name"
