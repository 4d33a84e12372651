"""Take the page's libraries from their packages: `python -m tests.studio.vendor`, which needs npm and Chromium.

Browsers find modules by path, so names such as `"preact"` in them are replaced. Blockly puts its style sheet into the
page itself, which the page's content policy forbids, so a browser writes the sheet to a file. `vendor.json` keeps the
version, the licence, and the hashes of each file before and after that; a test compares them.
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
from tests.studio.browser import CHROMIUM, OPTIONS

VENDOR = Path(__file__).parents[2] / "servolink/studio/web/vendor"

PACKAGES = {
    "preact": "11.2.0",
    "htm": "3.1.1",
    "@preact/signals": "",
    "@preact/signals-core": "",
    "uplot": "1.6.32",
    "blockly": "13.3.0",
}
FILES = {
    "preact.js": ("preact", "dist/preact.mjs"),
    "preact-hooks.js": ("preact", "hooks/dist/hooks.mjs"),
    "htm.js": ("htm", "dist/htm.mjs"),
    "signals.js": ("@preact/signals", "dist/signals.mjs"),
    "signals-core.js": ("@preact/signals-core", "dist/signals-core.mjs"),
    "uplot.js": ("uplot", "dist/uPlot.iife.min.js"),  # its module is three times as large
    "uplot.css": ("uplot", "dist/uPlot.min.css"),
    "blockly/blockly.js": ("blockly", "blockly_compressed.js"),
    "blockly/blockly.css": ("blockly", "blockly_compressed.js"),
    "blockly/en.js": ("blockly", "msg/en.js"),
    "blockly/zh-hans.js": ("blockly", "msg/zh-hans.js"),
    "blockly/zh-hant.js": ("blockly", "msg/zh-hant.js"),
    "blockly/sprites.svg": ("blockly", "media/sprites.svg"),
    "blockly/dropdown-arrow.svg": ("blockly", "media/dropdown-arrow.svg"),
}
"""Our name of each file, the package and the file in it."""
NAMES = {"preact": "preact.js", "preact/hooks": "preact-hooks.js", "@preact/signals-core": "signals-core.js"}
_NPM = shutil.which("npm") or "npm"
_IMPORT = re.compile(r'(from\s*)"([@\w][\w@/-]*)"')
_SCRIPT = re.compile(r"(?:\s*/\*.*?\*/)*\s*var (\w+)=function\(\)\{\"use strict\"", re.DOTALL)
"""A script that only defines one name."""
_UMD = re.compile(r".*\}\(this, function\(\) \{\n(.*)\}\)\);\s*", re.DOTALL)
"""A script that returns its content from a function, for loaders of several kinds."""
_INLINE_STYLE = re.compile(r"style:`direction: \$\{([^}]*)\}`")
"""Style in an element, which the content policy of the page forbids; the same as an attribute of SVG is allowed."""
_SOURCE_MAP = re.compile(r"\n//# sourceMappingURL=.*")
_SHEETS = """() => {
  const toolbox = { contents: [] };
  Blockly.inject(document.body, { renderer: "zelos", media: "/vendor/blockly", toolbox, trashcan: true });
  return [...document.querySelectorAll("style")].map((sheet) => sheet.textContent).join("\\n");
}"""
_CURSOR = re.compile(r"\s*cursor: url\([^)]*\), auto;|\s*cursor: -webkit-grab(bing)?;")
"""Cursors that are files of their own."""


def adapted(content: bytes) -> bytes:
    """Return a file as the page takes it: a module that names others by path, without a source map."""
    text = _IMPORT.sub(lambda found: f'{found[1]}"./{NAMES[found[2]]}"', content.decode())
    text = _INLINE_STYLE.sub(r"direction:\1", _SOURCE_MAP.sub("", text))
    if match := _SCRIPT.match(text):
        text = f"{text.rstrip()}\nexport default {match[1]};\n"
    elif match := _UMD.fullmatch(text):
        text = f"export default (function() {{\n{match[1]}}})();\n"
    return text.encode()


def style_sheet(*scripts: bytes) -> bytes:
    """Return the style sheet that Blockly would put into the page."""
    from playwright.sync_api import sync_playwright  # late: tests that compare hashes run without a browser

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        page = browser.new_page()
        for script in scripts:
            page.add_script_tag(content=script.decode())
        sheet = page.evaluate(_SHEETS)
        browser.close()
    ours = sheet.replace(".zelos-renderer.classic-theme", ".studio-renderer")
    return (_CURSOR.sub("", ours).strip() + "\n").encode()


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
                    ours = (
                        style_sheet(content[path], content["msg/en.js"])
                        if name == "blockly/blockly.css"
                        else adapted(content[path])
                    )
                    (VENDOR / name).parent.mkdir(exist_ok=True)
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
