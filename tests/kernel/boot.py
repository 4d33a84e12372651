"""Runs a command on an unmodified Debian kernel in QEMU, in which the host's files are there to read.

`python -m tests.kernel.boot COMMAND [ARGUMENT...]`; `tests/kernel/install` fetches what is needed. What the command
writes is lost, what it prints is printed, and its exit code becomes ours.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests import processes
from tests.kernel.image import first_files, unpacked_kernel

PARTS = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "servolink-kernel" / "root"
QEMU = "qemu-system-x86_64"
INSTALL = "tests/kernel/install"
LIMIT = 1800.0
"""Seconds after which a guest is given up."""


def missing() -> str:
    """Say what this machine lacks for the bench, or nothing."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return "the kernel bench runs on Linux for x86-64 only"
    lacks = []
    if shutil.which(QEMU) is None:
        lacks.append(QEMU)
    if not (PARTS / "bin/busybox").exists() or not list(PARTS.glob("boot/vmlinuz-*")):
        lacks.append(f"Debian's kernel, busybox and usbip in {PARTS}")
    return f"the kernel bench lacks {' and '.join(lacks)}; on Debian `{INSTALL}` fetches it" if lacks else ""


def boot(command: Sequence[str], environment: Mapping[str, str] | None = None) -> int:
    """Run `command` in a guest, in this folder, and return its exit code; RuntimeError if the guest does not tell."""
    with tempfile.TemporaryDirectory(prefix="servolink-kernel-") as name:
        folder = Path(name)
        (folder / "kernel").write_bytes(unpacked_kernel(next(PARTS.glob("boot/vmlinuz-*")).read_bytes()))
        (folder / "files").write_bytes(first_files(PARTS, _script(command, environment or {})))
        try:
            processes.run(_qemu(folder), check=True, limit=LIMIT, stdout=None, stderr=None)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"the guest took more than {LIMIT:g} s; {_last_words(folder)}") from None
        status = (folder / "status").read_text().strip()
        if not status:
            raise RuntimeError(f"the guest ended and did not tell how its command did; {_last_words(folder)}")
        return int(status)


def _script(command: Sequence[str], environment: Mapping[str, str]) -> str:
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    exports = [f"export {name}={shlex.quote(value)}" for name, value in {**kept, **environment}.items()]
    return "\n".join([*exports, f"cd {shlex.quote(str(Path.cwd()))}", f"exec {shlex.join(command)}"])


def _qemu(folder: Path) -> list[str]:
    options = {
        "machine": "q35",
        "accel": "tcg,thread=multi",
        "cpu": "max",
        "smp": "2",
        "m": "1024",
        "kernel": str(folder / "kernel"),
        "initrd": str(folder / "files"),
        "append": "console=ttyS0 quiet panic=-1 mitigations=off",
        "serial": f"file:{folder / 'log'}",
        "display": "none",
    }
    command = [QEMU, "-nodefaults", "-no-user-config", "-no-reboot"]
    for name, value in options.items():
        command += f"-{name}", value
    for name, shared in {"host": Path("/"), "parts": PARTS}.items():
        command += "-fsdev", f"local,id={name},path={shared},security_model=none,readonly=on,multidevs=remap"
        command += "-device", f"virtio-9p-pci,fsdev={name},mount_tag={name}"
    command += "-device", "virtio-serial-pci"
    for name, leads_to in {"output": "stdio,signal=off", "status": f"file,path={folder / 'status'}"}.items():
        command += "-chardev", f"{leads_to},id={name}", "-device", f"virtconsole,chardev={name}"
    return command


def _last_words(folder: Path) -> str:
    log = folder / "log"
    text = log.read_text(errors="replace") if log.exists() else ""
    return "the end of its log:\n" + "\n".join(text.splitlines()[-20:])


if __name__ == "__main__":
    if lacking := missing():
        sys.exit(lacking)
    sys.exit(boot(sys.argv[1:]))
