#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a test program on the distribution's kernel with its virtual camera (vivid), in a virtual machine.

    run_in_vm.py [--vimc] PROGRAM FOLDER [OTHER...]

The other programs are put beside it, into /bin. --vimc adds the virtual media device that libcamera drives; the distribution
has it in the kernel's sources only, so it is built from those. The kernel's package and what is built for it are kept in
FOLDER. Exit code: the program's, or 77 (skipped) without qemu or the sources.

Where STILLMAP_EMULATOR says how programs of a cross build are started (its last word is their sysroot), the machine is a 64-bit
ARM; its kernel runs 32-bit programs, too.
"""
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

MACHINES = {
    "x86_64": ("linux-image-amd64", ["qemu-system-x86_64", "-cpu", "Nehalem"], "ttyS0"),
    "aarch64": ("linux-image-arm64", ["qemu-system-aarch64", "-M", "virt", "-cpu", "max"], "ttyAMA0"),
}
EMULATOR = os.environ.get("STILLMAP_EMULATOR", "").split()
SYSROOT = Path(EMULATOR[-1] if EMULATOR else "/")
MACHINE = "aarch64" if EMULATOR else platform.machine()
PRIVATE_APT = Path(__file__).resolve().parents[3] / "toolchains/private_apt.sh"
LIBRARIES = Path("/usr/lib") / f"{platform.machine()}-linux-gnu/libcamera"
# Of the packages of the kernel and of busybox.
WANTED = (["./boot/vmlinuz-*", "./lib/modules/*/kernel/drivers/media/*", "./lib/modules/*/kernel/drivers/video/*", "./lib/modules/*/kernel/sound/core/*",
           "./lib/modules/*/kernel/lib/*"], ["./bin/busybox"])
# What libcamera itself opens to drive vimc: of its package libcamera-ipa.
LIBCAMERA_FILES = [LIBRARIES / "ipa_vimc.so", LIBRARIES / "ipa_vimc.so.sign", LIBRARIES / "vimc_ipa_proxy",
                   Path("/usr/share/libcamera/ipa/vimc/vimc.conf")]
# Three virtual cameras: two with buffers of one plane, and one with several.
INIT = """#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /dev /tmp
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs devtmpfs /dev
/bin/busybox ifconfig lo up
for module in $(/bin/busybox cat /modules/order); do
  case $module in vivid*) options="n_devs=3 node_types=0x1,0x1,0x1 multiplanar=1,1,2" ;; *) options= ;; esac
  /bin/busybox insmod /modules/$module $options || echo "insmod $module failed"
done
# libcamera asks udev, which is not here: it reads what udev would have written about each device.
/bin/busybox mkdir -p /run/udev/data
/bin/busybox touch /run/udev/control
for device in /sys/class/video4linux/* /sys/bus/media/devices/*; do
  echo I:1000000 >/run/udev/data/c$(/bin/busybox cat $device/dev)
done
/test
echo "test program ended with code $?"
/bin/busybox poweroff -f
"""


def run(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout


def foreign_packages(folder):
    """apt's options for the packages of an emulated machine: none where it is of this machine's kind."""
    if not EMULATOR:
        return []
    script = f'. {PRIVATE_APT} && private_apt arm64 "$0" && printf "%s\\n" "${{private[@]}}"'
    return run("bash", "-c", script, folder.resolve() / "apt").splitlines()


def fetch(package, folder):
    """Kernel and modules of the package that `package` stands for, and busybox; unpacked in `folder` once."""
    if not (folder / "boot").is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        options = foreign_packages(folder)
        names = [re.search(r"Depends: (linux-image-\S+)", run("apt-cache", *options, "depends", package))[1]]
        if EMULATOR:
            names.append("busybox-static")
        run("apt-get", "-qq", *options, "download", *names, cwd=folder)
        unpacked = folder / "unpacking"
        shutil.rmtree(unpacked, ignore_errors=True)
        (unpacked / "bin").mkdir(parents=True)
        for deb in folder.glob("*.deb"):
            with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", deb], stdout=subprocess.PIPE) as archive:
                run("tar", "-x", "-C", unpacked, "--wildcards", *WANTED[deb.name.startswith("busybox")], stdin=archive.stdout)
            deb.unlink()
        for part in ("bin", "lib", "boot"):
            (unpacked / part).rename(folder / part)
    return next((folder / "boot").glob("vmlinuz-*")), {p.stem.replace("-", "_"): p for p in (folder / "lib").rglob("*.ko")}


def libraries_of(programs):
    """Name in the machine -> file of each library that they link to."""
    if not EMULATOR:
        return {name: Path(name) for name in re.findall(r"(/\S+) \(0x", "".join(run("ldd", p) for p in programs))}
    loader = next(SYSROOT.glob("lib/ld-linux*"))
    names = re.findall(r"=> (/(?:usr/)?lib/\S+) \(0x", "".join(run(*EMULATOR, loader, "--list", p) for p in programs))
    return {name: SYSROOT / name.lstrip("/") for name in (*names, f"/lib/{loader.name}")}


def modules_of(name, known):
    """The module's file after those that it needs."""
    depends = re.search(rb"\0depends=([^\0]*)\0", known[name].read_bytes())[1].decode()
    files = []
    for needed in filter(None, depends.split(",")):
        if needed.replace("-", "_") in known:  # the others are part of the kernel, or insmod says what is missing
            files += modules_of(needed.replace("-", "_"), known)
    return list(dict.fromkeys([*files, known[name]]))


def archive(files):
    """A cpio archive (newc) of name -> (mode, bytes), with the folders that they need."""
    entries = {}
    for name, entry in files.items():
        for parent in reversed(Path(name).parents[:-1]):
            entries.setdefault(str(parent), (0o040755, b""))
        entries[name] = entry
    out = bytearray()
    for number, (name, (mode, data)) in enumerate([*entries.items(), ("TRAILER!!!", (0, b""))], 1):
        fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
        out += b"070701" + b"".join(b"%08X" % f for f in fields) + name.encode() + b"\0"
        out += b"\0" * (-len(out) % 4) + data
        out += b"\0" * (-len(out) % 4)
    return bytes(out)


def build_vimc(kernel, folder):
    """The module vimc for this kernel, from the sources of the distribution; built once."""
    built = folder / "vimc/vimc.ko"
    headers, sources = Path("/usr/src") / kernel.name.replace("vmlinuz", "linux-headers"), Path("/usr/src/linux-source-6.1.tar.xz")
    for needed in (headers, sources, *LIBCAMERA_FILES):
        if not needed.exists():
            print(f"skipped: no {needed}; scripts/setup.sh --full installs it")
            sys.exit(77)
    if not built.exists():
        shutil.rmtree(built.parent, ignore_errors=True)
        built.parent.mkdir()
        run("tar", "-x", "-f", sources, "-C", built.parent, "--strip-components=5", "linux-source-6.1/drivers/media/test-drivers/vimc")
        run("make", "-C", headers, f"M={built.parent.resolve()}", "CONFIG_VIDEO_VIMC=m", "modules")
    return built


def initramfs(busybox, program, others, modules, more):
    files = {"bin/sh": (0o100755, busybox.read_bytes()), "init": (0o100755, INIT.encode()), "bin/busybox": (0o100755, busybox.read_bytes()), "test": (0o100755, program.read_bytes()),
             "modules/order": (0o100644, "\n".join(m.name for m in modules).encode())}
    for module in modules:
        files[f"modules/{module.name}"] = (0o100644, module.read_bytes())
    for other in others:
        files[f"bin/{other.name}"] = (0o100755, other.read_bytes())
    for name, library in libraries_of((program, *others)).items():
        files[name.lstrip("/")] = (0o100755, library.read_bytes())
    for file in more:
        files[str(file).lstrip("/")] = (0o100755, file.read_bytes())
    return archive(files)


def main():
    arguments = sys.argv[1:]
    vimc = arguments[0] == "--vimc"
    program, folder, *others = map(Path, arguments[vimc:])
    package, qemu, console = MACHINES.get(MACHINE, (None, [""], ""))
    busybox = folder / "bin/busybox" if EMULATOR else Path("/bin/busybox")
    if not shutil.which(qemu[0]) or not (EMULATOR or busybox.exists()):
        print(f"skipped: no {qemu[0] or 'virtual machine for this processor'} or no {busybox}; scripts/setup.sh --tests installs them")
        sys.exit(77)
    kernel, known = fetch(package, folder)
    modules, more = modules_of("vivid", known), ()
    if vimc:
        known["vimc"] = build_vimc(kernel, folder)
        modules, more = list(dict.fromkeys([*modules, *modules_of("vimc", known)])), LIBCAMERA_FILES
    image = folder / "initramfs"
    image.write_bytes(initramfs(busybox, program, others, modules, more))
    # The processor is emulated: where a machine offers to run it itself (KVM), that may still not work. On a machine that is
    # busy, the emulated timer comes too late for the kernel's check of it.
    result = subprocess.run([*qemu, "-accel", "tcg", "-smp", "2", "-m", "768", "-nographic", "-no-reboot", "-nic", "none",
                             "-kernel", kernel, "-initrd", image, "-append", f"console={console} quiet panic=-1 no_timer_check"],
                            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=1100, check=False)
    print(result.stdout, result.stderr)
    ended = re.search(r"test program ended with code (\d+)", result.stdout)
    sys.exit(int(ended[1]) if ended else 1)


if __name__ == "__main__":
    main()
