"""The kernel and the small first file system from which the guest starts."""

from __future__ import annotations

import lzma
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

MODULES = (
    "virtio_pci",
    "virtio_console",
    "9pnet_virtio",
    "9p",
    "overlay",
    "vhci-hcd",
    "usbhid",
    "hid-generic",
    "cdc-acm",
)
"""What the guest needs and Debian's kernel does not have built in."""

_XZ = b"\xfd7zXZ\0"
_DEPENDS = re.compile(rb"\0depends=([^\0]*)\0")
_EXECUTABLE, _FOLDER, _PLAIN = 0o100755, 0o040755, 0o100644

INIT = """#!/bin/busybox sh
# Starts as process 1 of the guest: mounts the host's files under a layer in memory, runs the command in them.
/bin/busybox --install -s /bin
export PATH=/bin
mkdir -p /proc /sys /dev /host /parts /memory /root
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
for module in $(cat /order); do insmod /modules/$module; done
for shared in host parts; do
    mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=512000 $shared /$shared
done
mount -t tmpfs memory /memory
mkdir /memory/upper /memory/work
mount -t overlay -o lowerdir=/parts:/host,upperdir=/memory/upper,workdir=/memory/work overlay /root
for folder in proc sys dev; do mount --move /$folder /root/$folder; done
cd /root
for folder in run dev/shm; do mkdir -p $folder; mount -t tmpfs memory $folder; done
mkdir dev/pts
ln -s /proc/self/fd dev/fd
mount -t devpts devpts dev/pts
ip link set lo up
cp /command run/command
stty -F dev/hvc0 raw
chroot . /bin/sh /run/command < dev/null > dev/hvc0 2>&1
echo $? > dev/hvc1
sync
poweroff -f
"""


def unpacked_kernel(vmlinuz: bytes) -> bytes:
    """Return the kernel inside the file that a boot loader starts, as starting that takes 2 s longer."""
    at = vmlinuz.find(_XZ)
    return vmlinuz if at < 0 else lzma.LZMADecompressor().decompress(vmlinuz[at:])


def first_files(parts: Path, command: str) -> bytes:
    """Return the archive that the kernel unpacks and whose `/init` it runs; the folder `parts` holds busybox."""
    modules = list(_with_needs(MODULES, _found(parts)))
    files = {
        "bin": (_FOLDER, b""),
        "bin/busybox": (_EXECUTABLE, (parts / "bin/busybox").read_bytes()),
        "modules": (_FOLDER, b""),
        **{f"modules/{path.name}": (_PLAIN, _plain(path)) for path in modules},
        "order": (_PLAIN, "\n".join(path.name for path in modules).encode()),
        "init": (_EXECUTABLE, INIT.encode()),
        "command": (_PLAIN, command.encode()),
    }
    return b"".join(_archived(name, *file) for name, file in files.items()) + _archived("TRAILER!!!", 0, b"")


def _found(parts: Path) -> dict[str, Path]:
    return {_name(path.name.partition(".")[0]): path for path in parts.glob("usr/lib/modules/*/kernel/**/*.ko*")}


def _name(module: str) -> str:
    return module.replace("-", "_")


def _plain(path: Path) -> bytes:
    return lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()


def _with_needs(names: Iterable[str], found: dict[str, Path], seen: set[str] | None = None) -> Iterator[Path]:
    """Yield the files of modules, each after those it needs; those that are built in have none."""
    seen = set() if seen is None else seen
    for name in map(_name, names):
        if name in found and name not in seen:
            seen.add(name)
            needs = _DEPENDS.search(_plain(found[name]))
            yield from _with_needs(needs[1].decode().split(",") if needs else (), found, seen)
            yield found[name]


def _archived(name: str, mode: int, content: bytes) -> bytes:
    """Return an entry of a cpio archive in the format "newc"."""
    encoded = os.fsencode(name) + b"\0"
    numbers = (0, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(encoded), 0)
    return _aligned(b"070701" + b"".join(b"%08x" % number for number in numbers) + encoded) + _aligned(content)


def _aligned(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
