#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the folder of ARM headers and libraries that the cross builds are built against, from Debian 12's packages.
#
#   sysroot.sh aarch64|armhf            makes build/sysroot/<name>; where it is made already, nothing happens
#   sysroot.sh --update aarch64|armhf   pins what Debian has now: rewrites packages-<name>.txt
#
# The host's package state stays as it is: apt works in a state of its own, and the packages are only unpacked.
# Every package must have the pinned version and checksum. The compilers for ARM are installed where they are missing.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

fail() {
  echo "sysroot.sh: $*" >&2
  exit 1
}

# What the runtime links against (apt adds what these depend on), and what only compiling needs (taken alone: the
# dependencies of OpenCV's headers would bring a desktop).
libraries=(
  libc6 libstdc++6 libopencv-core406 libopencv-imgproc406 libopencv-features2d406 libopencv-dnn406 libspdlog1.10 libspng0
  libjpeg62-turbo libssl3 libwebsockets17 zlib1g libopenni2-0 libcamera0.0.3
)
headers=(
  libc6-dev linux-libc-dev libcrypt-dev libopencv-core-dev libopencv-imgproc-dev libopencv-features2d-dev libopencv-flann-dev
  libopencv-dnn-dev libeigen3-dev libspdlog-dev libfmt-dev nlohmann-json3-dev libspng-dev libjpeg62-turbo-dev libjpeg-dev
  libtomlplusplus-dev libcli11-dev libssl-dev libwebsockets-dev libnanopb-dev libprotobuf-dev zlib1g-dev libgtest-dev
  libgmock-dev libopenni2-dev libcamera-dev libcap-dev
)

update=no
if [ "${1-}" = --update ]; then
  update=yes
  shift
fi
case "$*" in
  aarch64) architecture=arm64 triplet=aarch64-linux-gnu ;;
  armhf) architecture=armhf triplet=arm-linux-gnueabihf ;;
  *) fail "unknown argument '$*'; usage: sysroot.sh [--update] aarch64|armhf" ;;
esac
name=$1
pins=$here/packages-$name.txt
sysroot=${STILLMAP_SYSROOTS:-$here/../build/sysroot}/$name

"$here/../scripts/setup.sh" --arm
[ "$update" = yes ] || ! cmp -s "$pins" "$sysroot/pins.txt" || exit 0

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work"/{debs,root}
# shellcheck source=toolchains/private_apt.sh
. "$here/private_apt.sh"
private_apt "$architecture" "$work" || fail "nothing was made"

if [ "$update" = yes ]; then
  {
    apt-get -qq "${private[@]}" --no-install-recommends --print-uris --yes install "${libraries[@]}" |
      sed -nE "s/^'[^']*' ([^_]+)_.*/\1/p"
    printf '%s\n' "${headers[@]}"
  } | sort -u >"$work/names"
  # OpenCV draws in the OpenGL interface's libraries; their drivers are nothing that a program links to.
  grep -vE '^(gcc-12-base|libgl1-mesa-dri|libglx-mesa0|libglapi-mesa|libllvm15|libz3-4|libdrm.*|libsensors.*|libx11-data|libicu72)$' \
    "$work/names" >"$work/wanted"
  xargs apt-cache "${private[@]}" --no-all-versions show <"$work/wanted" |
    awk '/^Package: / {p = $2} /^Version: / {v = $2} /^SHA256: / {print p, v, $2}' | sort >"$work/pins"
  [ "$(wc -l <"$work/pins")" -eq "$(wc -l <"$work/wanted")" ] || fail "Debian has not all of these packages: $(tr '\n' ' ' <"$work/wanted")"
  mv "$work/pins" "$pins"
  echo "pinned $(wc -l <"$pins") packages in $pins"
  exit 0
fi

(cd "$work/debs" && awk '{print $1 "=" $2}' "$pins" | xargs apt-get -qq "${private[@]}" download) >"$work/log" 2>&1 || {
  cat "$work/log" >&2
  fail "not all pinned packages could be had; if Debian has newer ones, take those with: toolchains/sysroot.sh --update $name"
}
while read -r package version checksum; do
  # apt writes a version's colon as %3a.
  deb=$(echo "$work/debs/${package}_${version//:/%3a}"_*.deb)
  echo "$checksum  $deb" | sha256sum --check --status ||
    fail "$package $version is not what was pinned (SHA-256 differs); if Debian has replaced it, run: toolchains/sysroot.sh --update $name"
  dpkg-deb --fsys-tarfile "$deb" |
    tar -x -C "$work/root" --keep-directory-symlink --exclude=./usr/share/doc --exclude=./usr/share/man --exclude=./usr/bin
done <"$pins"

# A link to an absolute path would lead out of the folder.
find "$work/root" -type l -lname '/*' | while read -r link; do
  ln -sfn --relative "$work/root$(readlink "$link")" "$link"
done
# Debian's alternatives make these two on a real system.
for algebra in blas lapack; do
  ln -sf "$algebra/lib$algebra.so.3" "$work/root/usr/lib/$triplet/lib$algebra.so.3"
done
cp "$pins" "$work/root/pins.txt"
mkdir -p "$(dirname "$sysroot")"
rm -rf "$sysroot"
mv "$work/root" "$sysroot"
echo "made $sysroot from $(wc -l <"$pins") packages"
