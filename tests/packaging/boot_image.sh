#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# boot_image.sh FOLDER: makes what a virtual 64-bit ARM board boots from (FOLDER/vmlinuz, initrd, disk): Debian's kernel and
# systemd, the package `stillmap` of the aarch64 build with its service enabled, a rendered log as its camera, a token for its
# stream, and a root's shell on port 2222 for the test. Downloads about 80 MB once; they are kept in FOLDER.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
out=$1
work=$(mktemp -d /var/tmp/stillmap-boot-XXXXXX)
trap 'rm -rf "$work"' EXIT
root=$work/root initrd=$work/initrd
mkdir -p "$out" "$work/packages" "$root"/{usr/{bin,sbin,lib},etc/systemd/system/multi-user.target.wants,dev,proc,sys,run,tmp,var/lib/stillmap,srv} \
  "$initrd"/{bin,dev,proc,sys,disk}

if [ ! -d "$out/debs" ]; then
  # shellcheck source=toolchains/private_apt.sh
  . toolchains/private_apt.sh
  private_apt arm64 "$work"
  kernel=$(apt-cache "${private[@]}" depends linux-image-arm64 | sed -nE 's/^ *Depends: (linux-image-\S+)$/\1/p')
  apt-get -qq "${private[@]}" --no-install-recommends --download-only --yes install systemd busybox-static >"$work/apt.txt"
  (cd "$work/cache/archives" && apt-get -qq "${private[@]}" download "$kernel") >>"$work/apt.txt"
  mv "$work/cache/archives" "$out/debs"
fi

# Kernel, and of its modules those that find disk and network.
image=("$out"/debs/linux-image-*.deb)
dpkg-deb --fsys-tarfile "${image[0]}" | tar -x -C "$work" --wildcards './boot/vmlinuz-*' './lib/modules/*/kernel/drivers/virtio/*' \
  './lib/modules/*/kernel/drivers/block/virtio_blk.ko' './lib/modules/*/kernel/drivers/net/*' './lib/modules/*/kernel/net/core/failover.ko' \
  './lib/modules/*/kernel/fs/*' './lib/modules/*/kernel/lib/*' './lib/modules/*/kernel/crypto/*'
cp "$work"/boot/vmlinuz-* "$out/vmlinuz"
version=$(basename "$work"/lib/modules/*)
kept='virtio|failover|ext4|jbd2|mbcache|crc'
find "$work/lib/modules" -name '*.ko' | grep -vE "/[^/]*($kept)[^/]*$" | xargs rm
mv "$work/lib" "$initrd/lib"
busybox depmod -b "$initrd" "$version"

# The root: programs and libraries unpacked, not configured; what their scripts would have made follows.
for folder in bin sbin lib; do ln -s "usr/$folder" "$root/$folder"; done
unpack() { dpkg-deb --fsys-tarfile "$1" | tar -x -C "$root" --keep-directory-symlink --exclude=./usr/share/{doc,man,locale,i18n}; }
for deb in "$out"/debs/*.deb; do [ "$deb" = "${image[0]}" ] || unpack "$deb"; done
(cd build/sysroot/aarch64 && find lib usr/lib -name '*.so*' -print0 | xargs -0 cp -P --parents -t "$root")
cpack --config build/aarch64/CPackConfig.cmake -D CPACK_COMPONENTS_ALL=stillmap -B "$work/packages" >"$work/cpack.txt" || { cat "$work/cpack.txt"; exit 1; }
unpack "$work"/packages/stillmap_*_arm64.deb
cp "$root/usr/bin/busybox" "$initrd/bin/busybox"
ln -s busybox "$root/usr/bin/sh"
printf '%s\n' 'root:x:0:0::/:/bin/sh' >"$root/etc/passwd"
printf '%s\n' root:x:0: tty:x:5: video:x:44: plugdev:x:46: >"$root/etc/group"
echo 5711111111111111111111111111ab1e >"$root/etc/machine-id"
ln -s /lib/systemd/system/multi-user.target "$root/etc/systemd/system/default.target"
ln -s /lib/systemd/system/stillmap.service "$root/etc/systemd/system/multi-user.target.wants/stillmap.service"

# The board: two cores. Its camera is a log, each frame of which is taken, since an emulated core is no match for a camera.
shared=/usr/share/stillmap/firmware-config
cat >"$root/etc/stillmap/stillmap.env" <<EOF
BOARD=$shared/boards/two-core.toml
CAMERA=$shared/cameras/synthetic.toml
OPTIONS=--source tum:/srv/log --mode fast --loop 10000 --map room.stillmap --resume room.stillmap --set map.checkpoint_s=5 --listen 0.0.0.0:8765 --set stream.token_file=token
EOF
build/release/bin/stillmap-synth --out "$root/srv/log" --seed 3 --frames 30
(umask 077 && echo "$(basename "$out")-token-0123456789" >"$root/var/lib/stillmap/token")

cat >"$root/etc/systemd/system/shell.socket" <<'EOF'
[Socket]
ListenStream=2222
Accept=yes
EOF
cat >"$root/etc/systemd/system/shell@.service" <<'EOF'
[Service]
ExecStart=/bin/sh
StandardInput=socket
# On emulated cores that the runtime keeps busy.
Nice=-15
Environment=SYSTEMD_BUS_TIMEOUT=900
EOF
mkdir "$root/etc/systemd/system/sockets.target.wants"
ln -s /etc/systemd/system/shell.socket "$root/etc/systemd/system/sockets.target.wants/shell.socket"

cat >"$initrd/init" <<'EOF'
#!/bin/busybox sh
mount() { busybox mount "$@"; }
mount -t devtmpfs dev /dev
mount -t proc proc /proc
mount -t sysfs sys /sys
for module in virtio_pci virtio_blk crc32c_generic ext4 virtio_net; do busybox modprobe "$module"; done
busybox ifconfig eth0 10.0.2.15 netmask 255.255.255.0
mount -t ext4 /dev/vda /disk
for folder in dev proc sys; do mount --move "/$folder" "/disk/$folder"; done
exec busybox switch_root /disk /lib/systemd/systemd
EOF
chmod +x "$initrd/init"
(cd "$initrd" && find . | busybox cpio -o -H newc) 2>"$work/cpio.txt" | gzip -1 >"$out/initrd"
rm -f "$out/disk"
/sbin/mke2fs -q -t ext4 -d "$root" "$out/disk" 512M
echo "root $(du -sm "$root" | cut -f1) MB, initrd $(stat -c %s "$out/initrd") bytes"
