"""The pages of the commands: those of `man` as the declarations are, those of the site with every option."""

from __future__ import annotations

import re

from docs.command_pages import MANUAL, manual_pages, names, site_page
from servolink.cli.index import index, load


def test_the_manual_pages_are_made_from_the_declarations() -> None:
    pages = {path.name: path.read_text(encoding="utf-8") for path in MANUAL.iterdir()}
    assert pages == manual_pages(), "run `python -m docs.command_pages`"


def test_the_pages_of_the_site_have_each_option_of_each_command() -> None:
    common = set(index()[""].options)
    shown = dict[str, set[str]]()
    for name in names():
        for section in re.split(r"^```\{program\} servolink ", site_page(load(name)), flags=re.MULTILINE)[1:]:
            command, _, text = section.partition("\n")
            shown[command] = set(re.findall(r"(?:\{option\} |, )(--?[\w-]+)", text))
    missing = {name: set(entry.options) - common - shown.get(name, set()) for name, entry in index().items()}
    assert {name: options for name, options in missing.items() if options} == {}
    assert shown.keys() == index().keys() - {""}
