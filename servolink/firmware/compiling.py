"""Compilation of the firmware for a Pico from the C sources in this package."""

from __future__ import annotations

import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

from servolink.errors import ServolinkError
from servolink.firmware.image import to_uf2

SOURCES = Path(__file__).parent
"""Folder of the C sources, in `core` and `pico`."""
IMAGE = files("servolink.firmware") / "servolink-pico.uf2"
"""Image of this version, compiled when the version was made."""

_COMPILER = "arm-none-eabi-gcc"
_FLAGS = [  # the same bytes for each build: no paths, no times, no build id
    "-std=c99",
    "-mcpu=cortex-m0plus",
    "-mthumb",
    "-O2",
    "-ffunction-sections",
    "-fdata-sections",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wconversion",
    "-Wno-unused-parameter",
    "-nostartfiles",
    "--specs=nano.specs",
    "-Wl,--gc-sections",
    "-Wl,--build-id=none",
    "-T",
    "pico/pico.ld",
]


def build(folder: Path) -> Path:
    """Compile the firmware into a folder, and return the path of the image.

    The folder is made if needed. The same compiler makes the same bytes.

    Raises:
        ServolinkError: The compiler is not installed, or it fails, or this package is not in a folder.

    """
    if shutil.which(_COMPILER) is None:
        raise ServolinkError(
            f"{_COMPILER} is not installed; Debian has the packages gcc-arm-none-eabi and libnewlib-arm-none-eabi"
        )
    if not SOURCES.is_dir():
        raise ServolinkError(f"{SOURCES} is in an archive, which a compiler does not read; unpack servolink first")
    folder = folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    elf, binary = folder / "servolink-pico.elf", folder / "servolink-pico.bin"
    sources = [
        str(path.relative_to(SOURCES)) for path in sorted(SOURCES.glob("*/*.[cS]")) if path.parent.name != "host"
    ]
    _run(_COMPILER, *_FLAGS, "-o", str(elf), *sources)
    _run("arm-none-eabi-objcopy", "-O", "binary", "--gap-fill", "0xff", str(elf), str(binary))
    image = folder / IMAGE.name
    image.write_bytes(to_uf2(binary.read_bytes()))
    return image


def _run(*command: str) -> None:
    done = subprocess.run(command, cwd=SOURCES, capture_output=True, check=False)  # noqa: S603 - our own sources
    if done.returncode:
        raise ServolinkError(f"{command[0]} failed:\n{done.stderr.decode(errors='replace').strip()}")
