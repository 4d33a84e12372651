"""The files of the page: all there, none of them changed since they were taken, and every text in all languages."""

from __future__ import annotations

import ast
import gzip
import json
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

from servolink import doctor
from servolink.studio.static_files import page_files
from tests.studio.vendor import VENDOR, sha256
from tests.syntax import tree_of

WEB = VENDOR.parent
MODULES = sorted(path for path in WEB.rglob("*.js") if "vendor" not in path.parts)
_IMPORT = re.compile(r'(?:from|import)\s*"(\.[^"\n]+)";')
_VALUE = re.compile(r"\{\w+\}")
_LANGUAGES = sorted(path.stem for path in WEB.glob("texts/*.json"))
_GZIPPED = 250_000
_EDITOR = 125_000  # bytes as gzip, loaded when the screen Code is first opened
_OTHER_LANGUAGES = {"/texts/en.json", "/texts/zh-Hans.json"}
"""A page loads the texts of its own language, of which the Traditional Chinese ones are the longest."""
_LICENCES = "/vendor/LICENCES.txt"
"""For people, and never asked for by the page."""


def language_file(language: str) -> Any:
    """Return the content of the file of a language. No key may stand there twice."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert len(dict(pairs)) == len(pairs), [
            key for key, times in Counter(key for key, _ in pairs).items() if times > 1
        ]
        return dict(pairs)

    return json.loads((WEB / f"texts/{language}.json").read_text(encoding="utf-8"), object_pairs_hook=unique)


def texts(language: str) -> dict[str, str]:
    return dict(language_file(language)["texts"])


def test_libraries_are_those_that_were_recorded() -> None:
    recorded = json.loads((VENDOR / "vendor.json").read_text(encoding="utf-8"))
    kinds = {".js", ".css", ".svg"}
    paths = [
        path
        for folder in (VENDOR, VENDOR / "blockly", VENDOR / "codemirror")
        for path in folder.iterdir()
        if path.suffix in kinds
    ]
    found = {path.relative_to(VENDOR).as_posix(): sha256(path.read_bytes()) for path in paths}
    assert found == {name: file["sha256"] for name, file in recorded.items()}


def test_modules_import_files_that_are_served() -> None:
    imports = [(path, name) for path in MODULES for name in _IMPORT.findall(path.read_text(encoding="utf-8"))]
    assert len(imports) > len(MODULES)
    web, files = WEB.resolve(), page_files()
    for path, name in imports:
        imported = (path.parent / name).resolve().relative_to(web)
        assert f"/{imported.as_posix()}" in files, f"{path} imports {name}"


def test_languages_have_the_same_texts_with_the_same_values() -> None:
    english = texts("en")
    assert len(english) > 50
    assert _LANGUAGES == ["en", "zh-Hans", "zh-Hant"]
    for language in _LANGUAGES:
        translated = texts(language)
        assert list(translated) == list(english), language
        for key, text in english.items():
            assert set(_VALUE.findall(text)) == set(_VALUE.findall(translated[key])), (language, key)


def test_traditional_chinese_has_no_simplified_characters() -> None:
    """The characters of Big5 are those of Taiwan; the name of the language in its own characters is elsewhere."""
    found = language_file("zh-Hant")
    values = [*found["texts"].values(), *(text for one in found["findings"].values() for text in one.values())]
    values += [text for messages in found["messages"].values() for text in messages.values()]
    for text in values:
        assert text.encode("big5hkscs").decode("big5hkscs") == text


def test_every_text_is_used() -> None:
    code = "\n".join(path.read_text(encoding="utf-8") for path in MODULES)
    unused = [key for key in texts("en") if f'"{key}"' not in code and not is_made(key, code)]
    assert unused == []


def is_made(key: str, code: str) -> bool:
    """Return whether a key is put together from a part, as in `${key}_detail` or `live.${state}`."""
    return f'"{key.removesuffix("_detail")}"' in code or f"`{key.rpartition('.')[0]}.${{" in code


def test_nothing_is_inline_and_nothing_comes_from_elsewhere() -> None:
    page = (WEB / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<style|<script(?![^>]* src=)|\son\w+=|style=|https?://", page)
    for path in MODULES:
        assert not re.search(r"innerHTML|insertAdjacentHTML|\beval\(|new Function", path.read_text(encoding="utf-8")), (
            path
        )


def test_files_for_developers_are_not_served() -> None:
    assert not [path for path in page_files() if path.endswith((".d.ts", "tsconfig.json", "vendor.json"))]


def test_modules_are_served_without_comments_and_with_the_lines_of_the_source() -> None:
    files, left_out = page_files(), 0
    for path in MODULES:
        source = [line.lstrip() for line in path.read_text(encoding="utf-8").split("\n")]
        served = files[f"/{path.relative_to(WEB).as_posix()}"].content.decode().split("\n")
        without_types = [re.sub(r"/\*\*.*?\*/", "", line).lstrip() for line in source]
        missing = [line for line, found in zip(without_types, served, strict=True) if line != found]
        assert all(re.match(r"\s*(//|/\*\*|\*)", line) for line in missing), path
        assert not any(re.search(r"^\s*(//|\*)|/\*", line) for line in served), path
        left_out += len(missing)
    assert left_out > len(MODULES)


def test_the_first_load_of_the_page_is_small() -> None:
    files = page_files()
    asked_later = (
        {f"/{path.relative_to(WEB).as_posix()}" for path in MODULES} - modules_at_first()
        | _OTHER_LANGUAGES
        | {_LICENCES}
    )
    asked_later |= {name for name in files if name.startswith(("/vendor/blockly/", "/vendor/codemirror/"))}
    assert 100_000 < sum(len(gzip.compress(files[name].content)) for name in files.keys() - asked_later) < _GZIPPED


def test_the_editor_of_programs_is_small() -> None:
    assert len(gzip.compress(page_files()["/vendor/codemirror/codemirror.js"].content)) < _EDITOR


def modules_at_first() -> set[str]:
    """Return the modules that the browser loads before it draws the page; Blockly is not among them."""
    found: set[Path] = set()
    waiting = [WEB / "app.js", WEB / "link/beat-worker.js"]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            imported = _IMPORT.findall(path.read_text(encoding="utf-8"))
            assert not any("blockly" in name or "codemirror" in name for name in imported), path
            waiting += [(path.parent / name).resolve() for name in imported if "vendor" not in name]
    return {f"/{path.relative_to(WEB).as_posix()}" for path in found}


def test_every_finding_before_a_board_is_opened_has_a_chinese_text() -> None:
    """It has a title and a reason; the facts and the commands in it are those of the machine."""
    checks = set()
    for module in ("environment.py", "permissions.py"):
        tree = tree_of(Path(doctor.__file__).with_name(module))
        constants = {ast.unparse(node.targets[0]): node.value for node in tree.body if isinstance(node, ast.Assign)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
                name = node.args[0]
                checks.add(ast.literal_eval(constants.get(ast.unparse(name), name)))
    for language in ("zh-Hans", "zh-Hant"):
        findings = language_file(language)["findings"]
        assert set(findings) == checks
        assert all(one.keys() == {"title", "meaning"} and all(one.values()) for one in findings.values())


def test_translated_messages_are_those_of_the_modules_named_above_them() -> None:
    simplified, traditional = (language_file(language)["messages"] for language in ("zh-Hans", "zh-Hant"))
    assert {place: list(messages) for place, messages in simplified.items()} == {
        place: list(messages) for place, messages in traditional.items()
    }
    found = 0
    for messages in (simplified, traditional):
        for place, templates in messages.items():
            for english, translated in templates.items():
                assert _VALUE.sub("{}", english) in lines_in(place), f"{place}: {english}"
                assert set(_VALUE.findall(translated)) <= set(_VALUE.findall(english)), translated
                found += 1
    assert found > 160


@cache
def lines_in(module: str) -> frozenset[str]:
    """Return the lines of all texts in a module, with `{}` for each value."""
    lines: set[str] = set()
    for node in ast.walk(tree_of(WEB.parents[2] / module)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            lines.update(node.value.split("\n"))
        elif isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
            lines.update("".join(map(str, parts)).split("\n"))
    return frozenset(lines)
