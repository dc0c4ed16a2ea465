#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the detector's network, NanoDet-Plus-m (int8), as models/nanodet_plus_m_int8.onnx.
#
#   get_model.sh --from FOLDER   from a folder that holds nanodet_plus_m_int8.onnx
#   get_model.sh                 fetches the weights that it is made from (RangiLyu/nanodet, Apache-2.0)
#
# STILLMAP_MODELS names another folder than models/ of the checkout.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=scripts/fetch.sh
. "$here/fetch.sh"

name=nanodet_plus_m_int8.onnx
models=${STILLMAP_MODELS:-$here/../models}
release=${STILLMAP_NANODET_URL:-https://github.com/RangiLyu/nanodet/releases/download/v1.0.0-alpha-1}

from=
case $# in
  0) ;;
  2) [ "$1" = --from ] || fail "unknown argument $1; usage: get_model.sh [--from FOLDER]"
     from=$2 ;;
  *) fail "usage: get_model.sh [--from FOLDER]" ;;
esac

mkdir -p "$models" || fail "cannot write $models; set STILLMAP_MODELS to a folder that you may write to"
work=$(mktemp -d "$models/.get_model.XXXXXX") || fail "cannot write $models; set STILLMAP_MODELS to a folder that you may write to"
trap 'rm -rf "$work"' EXIT

if [ -n "$from" ]; then
  [ -f "$from/$name" ] || fail "$from holds no $name; name the folder that does"
  cp "$from/$name" "$work/$name"
  check_pin "$work/$name" "$name"
  mv "$work/$name" "$models/$name"
  echo "installed $models/$name"
  exit 0
fi

archive=nanodet-plus-m_416_ncnn.zip
download "$release/$archive" "$work/$archive"
python3 -m zipfile -e "$work/$archive" "$work/unpacked" || fail "$release/$archive is no zip archive; nothing was installed"
for part in nanodet-plus-m_416.param nanodet-plus-m_416.bin; do
  file=$(find "$work/unpacked" -type f -name "$part" -print -quit)
  [ -n "$file" ] || fail "$archive holds no $part; nothing was installed"
  mv "$file" "$work/$part"
  check_pin "$work/$part" "$part"
done
for part in nanodet-plus-m_416.param nanodet-plus-m_416.bin; do
  mv "$work/$part" "$models/$part"
  echo "fetched $models/$part (float16 weights in ncnn's format, from $release/$archive)"
done
fail "the weights are here, but their conversion to $name comes with a later version; until then get_model.sh --from FOLDER"
