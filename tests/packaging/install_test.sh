#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# install_test.sh: makes the packages of the release build, and of the ARM builds that there are, and holds them against lintian;
# installs the release build's in a Debian 12 that has nothing else, replays a log there, has udev read the cameras' rules, and
# builds the example of the library there. Needs root, debootstrap, the network.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=$(mktemp -d /var/tmp/stillmap-install-XXXXXX)
root=$work/root
clean_up() {
  for folder in proc sys; do ! mountpoint -q "$root/$folder" || umount "$root/$folder"; done
  rm -rf --one-file-system "$work"
}
trap clean_up EXIT

for build in release aarch64 armhf; do
  [ -x "build/$build/bin/stillmap" ] || continue
  cpack --config "build/$build/CPackConfig.cmake" -B "$work/$build" >"$work/cpack.txt" || { cat "$work/cpack.txt"; exit 1; }
  ls -l "$work/$build"/*.deb
  lintian --fail-on error,warning "$work/$build"/*.deb
done
packages=("$work"/release/*.deb)

debootstrap --variant=minbase bookworm "$root" "${STILLMAP_DEBIAN_MIRROR:-http://deb.debian.org/debian}" >"$work/debootstrap.txt" ||
  { tail -n 20 "$work/debootstrap.txt"; exit 1; }
cp /etc/resolv.conf "$root/etc/"
# As every system has it: the loader asks it where the program is, and looks for modules beside that.
mount -t proc proc "$root/proc"
mount -t sysfs -o ro sys "$root/sys"
cp "${packages[@]}" "$root/tmp/"
build/release/bin/stillmap-synth --out "$root/tmp/log" --seed 3 --frames 20
in_root() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive LC_ALL=C "$@"; }
refuses() { # WORDS COMMAND...: the command fails in the root, and says so
  local words=$1 said
  shift
  if said=$(in_root "$@" 2>&1); then return 1; fi
  grep -F "$words" <<<"$said"
}
in_root sh -c 'apt-get -qq update && apt-get -qq install --yes --no-install-recommends /tmp/stillmap_*.deb' >"$work/install.txt" 2>&1 ||
  { tail -n 20 "$work/install.txt"; exit 1; }
# The program without its modules says what is missing; with them it asks each library for cameras.
refuses 'install the package stillmap-openni2' stillmap run --source openni2: --listen off --set detector.model=none
in_root sh -c 'apt-get -qq install --yes --no-install-recommends /tmp/stillmap-*.deb' >"$work/install.txt" 2>&1 ||
  { tail -n 20 "$work/install.txt"; exit 1; }
in_root stillmap devices
refuses 'openni2:: ' stillmap run --source openni2: --listen off --set detector.model=none
profiles=/usr/share/stillmap/firmware-config
if in_root ldd /usr/bin/stillmap | grep 'not found'; then exit 1; fi
in_root stillmap check --config $profiles/boards/raspberry-pi-5.toml --config $profiles/cameras/tum-fr1.toml
in_root stillmap run --config $profiles/cameras/synthetic.toml --set detector.model=none --listen off --mode lockstep \
  --source tum:/tmp/log --trajectory /tmp/poses.txt
poses=$(grep -vc '^#' "$root/tmp/poses.txt")
echo "$poses poses from the installed program, $(in_root ldd /usr/bin/stillmap | wc -l) libraries"
[ "$poses" -eq 20 ]
# Whatever udev has to say of the file but that it reads it is about a mistake.
in_root apt-get -qq install --yes --no-install-recommends udev >"$work/install.txt" 2>&1 || { tail -n 20 "$work/install.txt"; exit 1; }
said=$(in_root udevadm test /sys/devices/virtual/net/lo 2>&1 | grep -F 60-stillmap.rules || true)
[ "$said" = 'Reading rules file: /usr/lib/udev/rules.d/60-stillmap.rules' ] || { echo "udev: $said"; exit 1; }
# A folder is all that enabling needs; starting it needs a machine.
systemctl --root="$root" enable stillmap
[ -L "$root/etc/systemd/system/multi-user.target.wants/stillmap.service" ]

in_root sh -c 'apt-get -qq install --yes --no-install-recommends cmake g++ make /tmp/libstillmap-dev_*.deb' >"$work/install.txt" 2>&1 ||
  { tail -n 20 "$work/install.txt"; exit 1; }
in_root sh -c 'cmake -S /usr/share/doc/libstillmap-dev/example -B /tmp/example && cmake --build /tmp/example' >"$work/example.txt" 2>&1 ||
  { cat "$work/example.txt"; exit 1; }
poses=$(in_root /tmp/example/example $profiles/cameras/synthetic.toml /tmp/log | wc -l)
echo "$poses poses from the example"
[ "$poses" -eq 20 ]
in_root apt-get -qq remove --yes stillmap >"$work/remove.txt" 2>&1
[ ! -e "$root/usr/bin/stillmap" ]
