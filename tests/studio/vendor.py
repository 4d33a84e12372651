"""Take the page's libraries from their packages: `python -m tests.studio.vendor`, which needs npm.

Browsers find modules by path, so names such as `"preact"` in them are replaced. `vendor.json` keeps the version, the
licence, and the hashes of each file before and after that; a test compares them.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tarfile
import tempfile
from pathlib import Path

from tests import processes

VENDOR = Path(__file__).parents[2] / "servolink/studio/web/vendor"

PACKAGES = {"preact": "11.2.0", "htm": "3.1.1", "@preact/signals": "", "@preact/signals-core": "", "uplot": "1.6.32"}
FILES = {
    "preact.js": ("preact", "dist/preact.mjs"),
    "preact-hooks.js": ("preact", "hooks/dist/hooks.mjs"),
    "htm.js": ("htm", "dist/htm.mjs"),
    "signals.js": ("@preact/signals", "dist/signals.mjs"),
    "signals-core.js": ("@preact/signals-core", "dist/signals-core.mjs"),
    "uplot.js": ("uplot", "dist/uPlot.iife.min.js"),  # its module is three times as large
    "uplot.css": ("uplot", "dist/uPlot.min.css"),
}
"""Our name of each file, the package and the file in it."""
NAMES = {"preact": "preact.js", "preact/hooks": "preact-hooks.js", "@preact/signals-core": "signals-core.js"}
_NPM = shutil.which("npm") or "npm"
_IMPORT = re.compile(r'(from\s*)"([@\w][\w@/-]*)"')
_SCRIPT = re.compile(r"(?:\s*/\*.*?\*/)*\s*var (\w+)=function\(\)\{\"use strict\"", re.DOTALL)
"""A script that only defines one name."""
_SOURCE_MAP = re.compile(r"\n//# sourceMappingURL=.*")


def adapted(content: bytes) -> bytes:
    """Return a file as the page takes it: a module that names others by path, without a source map."""
    text = _IMPORT.sub(lambda found: f'{found[1]}"./{NAMES[found[2]]}"', content.decode())
    if match := _SCRIPT.match(text):
        text = f"{text.rstrip()}\nexport default {match[1]};\n"
    return _SOURCE_MAP.sub("", text).encode()


def sha256(content: bytes) -> str:
    """Return the hash that is recorded."""
    return hashlib.sha256(content).hexdigest()


def main() -> None:
    """Take everything again."""
    VENDOR.mkdir(parents=True, exist_ok=True)
    files, licences = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for package, version in PACKAGES.items():
            content = _unpacked(package, version, Path(folder))
            facts = json.loads(content["package.json"])
            licences.append(f"{package} {facts['version']}\n\n{content['LICENSE'].decode().strip()}\n")
            for name, (origin, path) in FILES.items():
                if origin == package:
                    ours = adapted(content[path])
                    (VENDOR / name).write_bytes(ours)
                    files[name] = {
                        "package": package,
                        "version": facts["version"],
                        "licence": facts["license"],
                        "path": path,
                        "original_sha256": sha256(content[path]),
                        "sha256": sha256(ours),
                    }
    (VENDOR / "vendor.json").write_text(json.dumps(files, indent=2) + "\n")
    (VENDOR / "LICENCES.txt").write_text(("\n" + "-" * 80 + "\n\n").join(licences))


def _unpacked(package: str, version: str, folder: Path) -> dict[str, bytes]:
    name = f"{package}@{version}" if version else package
    packed = processes.run([_NPM, "pack", "--silent", name], cwd=folder, check=True).stdout.split()
    with tarfile.open(folder / packed[-1]) as archive:
        return {
            member.name.partition("/")[2]: file.read()
            for member in archive.getmembers()
            if (file := archive.extractfile(member)) is not None
        }


if __name__ == "__main__":
    main()
