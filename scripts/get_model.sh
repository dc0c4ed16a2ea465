#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the detector's network, NanoDet-Plus-m (int8), as models/nanodet_plus_m_int8.onnx with its manifest beside it.
#
#   get_model.sh [--from FOLDER] [--log DIR]
#
# The float weights (RangiLyu/nanodet, Apache-2.0) come from their release page, or from FOLDER, and are quantized with
# pictures of the log DIR, which is TUM's fr1_xyz unless given. A FOLDER that holds the quantized network itself needs no
# log, and nothing is computed; with --log its weights are quantized anew.
#
# STILLMAP_MODELS names another folder than models/ of the checkout.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=scripts/fetch.sh
. "$here/fetch.sh"

name=nanodet_plus_m_int8
weights=nanodet-plus-m_416
models=${STILLMAP_MODELS:-$here/../models}
release=${STILLMAP_NANODET_URL:-https://github.com/RangiLyu/nanodet/releases/download/v1.0.0-alpha-1}

from=
log=
while [ $# -gt 0 ]; do
  case $1 in
    --from) from=${2:-} ;;
    --log) log=${2:-} ;;
    *) fail "unknown argument $1; usage: get_model.sh [--from FOLDER] [--log DIR]" ;;
  esac
  [ -n "${2:-}" ] || fail "$1 needs a folder; usage: get_model.sh [--from FOLDER] [--log DIR]"
  shift 2
done

mkdir -p "$models" || fail "cannot write $models; set STILLMAP_MODELS to a folder that you may write to"
work=$(mktemp -d "$models/.get_model.XXXXXX") || fail "cannot write $models; set STILLMAP_MODELS to a folder that you may write to"
trap 'rm -rf "$work"' EXIT

install_network() {
  mv "$work/$name.onnx" "$models/$name.onnx"
  mv "$work/$name.toml" "$models/$name.toml"
  echo "installed $models/$name.onnx with its manifest $name.toml"
}

if [ -n "$from" ] && [ -z "$log" ] && [ -f "$from/$name.onnx" ]; then
  cp "$from/$name.onnx" "$work/$name.onnx"
  check_pin "$work/$name.onnx" "$name.onnx"
  sum=$(sha256sum "$work/$name.onnx" | cut -d ' ' -f 1)
  sed "s/^sha256 = .*/sha256 = \"$sum\"/" "$here/../firmware-config/models/nanodet_plus_m.toml" >"$work/$name.toml"
  install_network
  exit 0
fi

source=$from
if [ -z "$from" ]; then
  archive=${weights}_ncnn.zip
  download "$release/$archive" "$work/$archive"
  source=$work/unpacked
  python3 -m zipfile -e "$work/$archive" "$source" || fail "$release/$archive is no zip archive; nothing was installed"
fi
for part in "$weights.param" "$weights.bin"; do
  file=$(find "$source" -type f -name "$part" -print -quit 2>/dev/null) || true
  [ -n "$file" ] || fail "${from:-$archive} holds no $part${from:+ and no $name.onnx}; nothing was installed"
  cp "$file" "$work/$part"
  check_pin "$work/$part" "$part"
done
if [ -z "$log" ]; then
  "$here/get_tum.sh" fr1_xyz "$here/../data"
  log=$here/../data/fr1_xyz
fi
"$here/quantize_model.py" "$work/$weights.param" --log "$log" --out "$work/$name.onnx"
install_network
