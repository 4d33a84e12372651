"""Take the page's libraries from their packages: `python -m tests.studio.vendor`, which needs npm and Chromium.

Browsers find modules by path, so names such as `"preact"` in them are replaced. Blockly puts its style sheet into the
page itself, which the page's content policy forbids, so a browser writes the sheet to a file. CodeMirror is many
packages, of which esbuild makes one module with the parts that the page uses. `vendor.json` keeps the version, the
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
EDITOR = {
    "codemirror": "6.0.2",
    "@codemirror/autocomplete": "6.20.4",
    "@codemirror/commands": "6.11.1",
    "@codemirror/lang-python": "6.2.1",
    "@codemirror/language": "6.13.1",
    "@codemirror/state": "6.7.6",
    "@codemirror/streamparser": "6.0.0",
    "@codemirror/view": "6.43.15",
    "@lezer/common": "1.5.5",
    "@lezer/highlight": "1.2.5",
    "@lezer/lr": "1.4.12",
    "@lezer/python": "1.1.19",
    "@marijn/find-cluster-break": "1.0.4",
    "crelt": "1.0.7",
    "style-mod": "4.1.5",
    "w3c-keyname": "2.2.8",
}
"""Packages of CodeMirror."""
ESBUILD = "0.28.2"
PARTS = """
export { closeBrackets, closeBracketsKeymap } from "@codemirror/autocomplete";
export { defaultKeymap, history, historyKeymap, indentWithTab } from "@codemirror/commands";
export { python } from "@codemirror/lang-python";
export { bracketMatching, indentOnInput, indentUnit, syntaxHighlighting } from "@codemirror/language";
export { StateEffect, StateField } from "@codemirror/state";
export { Decoration, EditorView, keymap, lineNumbers } from "@codemirror/view";
export { classHighlighter } from "@lezer/highlight";
"""
"""What the page uses of CodeMirror."""
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
        bundle, found = editor(Path(folder))
        licences += found
    (VENDOR / "codemirror").mkdir(exist_ok=True)
    (VENDOR / "codemirror/codemirror.js").write_bytes(bundle)
    files["codemirror/codemirror.js"] = {
        "package": "codemirror",
        "version": EDITOR["codemirror"],
        "licence": "MIT",
        "path": f"bundle of {', '.join(f'{name} {version}' for name, version in EDITOR.items())}",
        "original_sha256": sha256(bundle),
        "sha256": sha256(bundle),
    }
    (VENDOR / "vendor.json").write_text(json.dumps(files, indent=2) + "\n")
    (VENDOR / "LICENCES.txt").write_text(("\n" + "-" * 80 + "\n\n").join(licences))


def editor(folder: Path) -> tuple[bytes, list[str]]:
    """Return the module of CodeMirror, and the licences of its packages.

    It puts its rules into the list of style sheets: the content policy forbids elements with style.
    """
    wanted = [f"{name}@{version}" for name, version in EDITOR.items()]
    quiet = ("--silent", "--no-audit", "--no-fund", "--no-package-lock")
    processes.run([_NPM, "install", *quiet, *wanted, f"esbuild@{ESBUILD}"], cwd=folder, check=True)
    packages = folder / "node_modules"
    rules = packages / "style-mod/src/style-mod.js"
    before, after = "if (!root.head && root.adoptedStyleSheets", "if (root.adoptedStyleSheets"
    assert rules.read_text().count(before) == 1
    rules.write_text(rules.read_text().replace(before, after))
    (folder / "parts.js").write_text(PARTS)
    options = ("--bundle", "--minify", "--format=esm", "--target=es2022", "--legal-comments=none", "--outfile=made.js")
    processes.run([str(packages / ".bin/esbuild"), "parts.js", *options], cwd=folder, check=True)
    licences = [f"{name} {version}\n\n{_licence(packages / name)}\n" for name, version in EDITOR.items()]
    return (folder / "made.js").read_bytes(), licences


def _licence(package: Path) -> str:
    return (package / "LICENSE").read_text().strip()


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
