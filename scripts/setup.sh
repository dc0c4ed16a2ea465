#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what Stillmap is built from, on Debian 12.
#
#   setup.sh           to build it and to run the demo
#   setup.sh --arm     also the compilers for ARM (toolchains/sysroot.sh starts this)
#   setup.sh --tests   also what scripts/test.sh checks it with, ARM's compilers among it
#   setup.sh --full    also what scripts/test.sh --full adds: packages in a clean root, a virtual board
#   setup.sh --bench   also what scripts/bench.sh measures with
#
# Only what is missing is installed; where nothing is, nothing happens.
set -euo pipefail
# shellcheck source=scripts/help.sh
. "$(dirname "${BASH_SOURCE[0]}")/help.sh"
answer_help "$@"

fail() {
  echo "setup.sh: $*" >&2
  exit 1
}

packages=(
  build-essential cmake ninja-build git
  # What the runtime links against. OpenCV by modules: libopencv-dev would bring everything that OpenCV has.
  libopencv-core-dev libopencv-imgproc-dev libopencv-features2d-dev libopencv-dnn-dev libeigen3-dev libspdlog-dev
  nlohmann-json3-dev libspng-dev libjpeg-dev libtomlplusplus-dev libcli11-dev libssl-dev
  # The stream's server, and its messages, whose code is generated while building.
  libwebsockets-dev libnanopb-dev nanopb protobuf-compiler libprotobuf-dev
  # Cameras; the drivers are modules that the program runs without.
  libopenni2-dev libcamera-dev
  # The tests are built with everything else, and so is the renderer of the demo's log.
  libgtest-dev libgmock-dev
  # The demo's network and pictures.
  python3 python3-numpy python3-onnx python3-opencv python3-matplotlib
  # import_calibration.py
  python3-yaml
  # get_tum.sh and get_model.sh
  curl ca-certificates
)
arm=(g++-aarch64-linux-gnu g++-arm-linux-gnueabihf qemu-user debian-archive-keyring)
case "$*" in
  "") ;;
  --arm) packages+=("${arm[@]}") ;;
  --tests|--full)
    packages+=("${arm[@]}")
    [ "$*" = --tests ] || packages+=(lintian debootstrap cppcheck
      # A virtual ARM board, and what makes its disk.
      qemu-system-arm busybox-static e2fsprogs)
    packages+=(clang-14 libclang-rt-14-dev clang-format clang-tidy shellcheck openssl python3-scipy systemd)
    # The exported OctoMap tree is read back with it.
    packages+=(liboctomap-dev)
    # The camera driver is tested on a kernel with a virtual camera, in a virtual machine.
    case $(uname -m) in
      x86_64) packages+=(qemu-system-x86 busybox-static) kernel=amd64 ;;
      aarch64) packages+=(qemu-system-arm busybox-static) kernel=arm64 ;;
      *) kernel= ;;
    esac
    # libcamera is tested on the kernel's virtual media device, which only the kernel's sources have.
    [ "$*" = --tests ] || [ -z "$kernel" ] || packages+=(libcamera-ipa linux-source-6.1 "linux-headers-$kernel")
    # The stream is tested with its protocol's official client. Any Node.js will do, also one that is not Debian's.
    command -v node >/dev/null || packages+=(nodejs)
    command -v npm >/dev/null || packages+=(npm)
    # The built-in page is looked at by a real browser.
    command -v chromium >/dev/null || packages+=(chromium)
    ;;
  --bench) packages+=(libbenchmark-dev) ;;
  *) fail "unknown argument $*; usage: setup.sh [--arm|--tests|--full|--bench]" ;;
esac

missing=()
for package in "${packages[@]}"; do
  case $(dpkg-query --show --showformat '${db:Status-Status}' "$package" 2>/dev/null) in
    installed) ;;
    *) missing+=("$package") ;;
  esac
done
[ ${#missing[@]} -gt 0 ] || exit 0

install="apt-get install --no-install-recommends ${missing[*]}"
release=${STILLMAP_OS_RELEASE:-/etc/os-release}
grep -qs '^VERSION_CODENAME=bookworm$' "$release" ||
  fail "this is not Debian 12, where the packages are: ${missing[*]}; install what they are called here, or use a Debian 12 container"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || fail "needs root to install packages, and there is no sudo; run as root: $install"
  as_root=(sudo)
fi

echo "installing ${#missing[@]} packages: ${missing[*]}"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# A list that cannot be updated (a third party's) may not be needed; if it is, the installation says so.
"${as_root[@]}" apt-get -qq update >"$log" 2>&1 || true
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes --no-install-recommends "${missing[@]}" >>"$log" 2>&1 || {
  tail -n 20 "$log" >&2
  fail "apt-get could not install the packages (its words are above); mend it and run again, or by hand: $install"
}
