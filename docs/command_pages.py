"""Pages of the commands, for the site and for `man`, made from the declarations that `--help` shows.

`python -m docs.command_pages` writes the manual pages in docs/man/. Those of the site are written when it is built.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from docs.command_index import value_of
from servolink.cli.command import TOPICS, Command
from servolink.cli.command_line import EXIT_CODES, WHOLE, Parser, parser_of
from servolink.cli.index import below, index, load

_FOLDER = Path(__file__).parent
MANUAL = _FOLDER / "man"
SITE = _FOLDER / "reference/commands"

_COMMON = "common options"
_ARGUMENTS = "positional arguments"
_CODE = re.compile(r"`([^`]+)`|(?<![\w`-])(--?[a-zA-Z][\w-]*(?: FILE)?)")
_LAST_LINE = f"{EXIT_CODES[:1].upper()}{EXIT_CODES[1:]}."

Term = tuple[str, str]
"""An option as it is typed, and its meaning."""


def names() -> list[str]:
    """Return the commands that have a page; their subcommands are on it."""
    return list(below(""))


def subcommands(name: str) -> list[Command]:
    """Return the subcommands of a command, and theirs."""
    return [load(each) for each in index() if each.startswith(f"{name} ")]


def synopsis(command: Command) -> str:
    """Return how a command is typed."""
    words = ["servolink", command.name, "[OPTION]..."]
    if below(command.name):
        words.append("[COMMAND ...]" if command.run else "COMMAND ...")
    arguments = next((actions for title, actions in _groups(parser_of(command)) if title == _ARGUMENTS), [])
    for action in arguments:
        several = "..." if action.nargs in {argparse.ZERO_OR_MORE, argparse.ONE_OR_MORE} else ""
        optional = action.nargs in {argparse.ZERO_OR_MORE, argparse.OPTIONAL}
        words.append(f"[{value_of(action)}]{several}" if optional else f"{value_of(action)}{several}")
    return " ".join(filter(None, words))


def option_groups(command: Command) -> Iterator[tuple[str, list[Term]]]:
    """Yield the options of a command by group, with a title if it is more than that; common ones for `servolink`."""
    parser = parser_of(command)
    formatter = parser._get_formatter()  # noqa: SLF001 - argparse has no other way to fill in defaults
    for title, actions in _groups(parser):
        if title != _COMMON or command is WHOLE:
            terms = [(_term(action), formatter._expand_help(action)) for action in actions]  # noqa: SLF001 - likewise
            yield ("" if title in {_ARGUMENTS, "options"} else _capitalised(title)), terms


def _groups(parser: Parser) -> Iterator[tuple[str, list[argparse.Action]]]:
    for group in parser._action_groups:  # noqa: SLF001 - argparse has no other way to walk over them
        shown = [action for action in group._group_actions if action.help != argparse.SUPPRESS]  # noqa: SLF001
        if shown:
            yield group.title or "", shown


def _term(action: argparse.Action) -> str:
    value = "" if action.nargs == 0 else f" {value_of(action)}"
    return ", ".join(f"{name}{value}" for name in action.option_strings) or value.strip()


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _by_topic() -> Iterator[tuple[str, list[Term]]]:
    """Yield each topic with the names and meanings of its commands."""
    for topic in TOPICS:
        yield _capitalised(topic), [(name, entry.help) for name, entry in below("").items() if entry.topic == topic]


def _paragraphs(command: Command, text: Callable[[str], str], block: Callable[[str], str]) -> list[str]:
    """Return the help of a command and the paragraphs behind it; `block` takes the rows of a list as they are."""
    found = [text(f"{_capitalised(command.help)}.")]
    for paragraph in filter(None, command.details.split("\n\n")):
        first, _, rows = paragraph.partition("\n  ")
        found.append(text(first))
        if rows:
            found.append(block("\n".join(row.strip() for row in rows.split("\n"))))
    return found


def _without(command: Command) -> str:
    return "" if command.takes_board else ", without `--board` and `--timeout`"


def site_pages() -> dict[str, str]:
    """Return all pages of the site by the name of the file, in MyST Markdown."""
    return {"index.md": _overview(), **{f"{name}.md": site_page(load(name)) for name in names()}}


def _overview() -> str:
    parts = ["# Commands", "[The command line](../command-line.md) says what holds for all of them."]
    for topic, commands in _by_topic():
        parts += [
            f"## {topic}",
            "\n".join(f"- [`{name}`]({name}.md): {_marked(meaning)}" for name, meaning in commands),
        ]
    parts += _site_options(WHOLE, "## {}")
    parts.append("\n".join(["```{toctree}", ":hidden:", "", *names(), "```"]))
    return "\n\n".join(parts) + "\n"


def site_page(command: Command) -> str:
    """Return the page of a command and its subcommands, in MyST Markdown."""
    parts = [f"# {command.name}", *_site_section(command)]
    for each in subcommands(command.name):
        parts += [f"## {each.name}", *_site_section(each)]
    more = f"The [common options](index.md#common-options) are accepted too{_without(command)}."
    return "\n\n".join([*parts, "---", more, _LAST_LINE]) + "\n"


def _site_section(command: Command) -> list[str]:
    parts = _paragraphs(command, _marked, lambda rows: f"```text\n{rows}\n```")
    parts += [f"```text\n{synopsis(command)}\n```", *_site_options(command, "**{}**")]
    if command.examples:
        parts.append("\n".join(["```console no-run", *(f"$ servolink {each}" for each in command.examples), "```"]))
    return parts


def _site_options(command: Command, heading: str) -> list[str]:
    parts = [f"```{{program}} {'servolink ' + command.name}\n```"]
    for title, terms in option_groups(command):
        parts += [heading.format(_marked(title))] if title else []
        parts += [f"```{{option}} {term}\n{_marked(meaning)}\n```" for term, meaning in terms]
    return parts


def _marked(text: str) -> str:
    """Return text with options and quoted commands as code, and nothing else that Markdown would read."""
    parts, end = list[str](), 0
    for found in _CODE.finditer(text):
        parts += [_escaped(text[end : found.start()]), f"`{found[1] or found[2]}`"]
        end = found.end()
    return "".join([*parts, _escaped(text[end:])])


def _escaped(text: str) -> str:
    return re.sub(r"([\\*_<>\[\]{}#])", r"\\\1", text)


def manual_pages() -> dict[str, str]:
    """Return all manual pages by the name of the file, in troff with the macros of `man`."""
    return {"servolink.1": _manual()} | {f"servolink-{name}.1": manual_page(load(name)) for name in names()}


def _manual() -> str:
    lines = [*_head("servolink", WHOLE.help), ".SH SYNOPSIS", "servolink [OPTION]... COMMAND ...", ".SH COMMANDS"]
    lines.append(_troff("Each command has a page of its own, such as servolink-move(1)."))
    for topic, commands in _by_topic():
        lines += [f".SS {topic}", *_manual_terms(commands)]
    return "\n".join([*lines, ".SH OPTIONS", *_manual_options(WHOLE), ".SH EXIT STATUS", _LAST_LINE]) + "\n"


def manual_page(command: Command) -> str:
    """Return the manual page of a command and its subcommands."""
    lines = [*_head(f"servolink-{command.name}", command.help), ".SH SYNOPSIS", _troff(synopsis(command))]
    lines += [".SH DESCRIPTION", *_manual_text(command), ".SH OPTIONS", *_manual_options(command), ".PP"]
    lines.append(_troff(f"The common options of servolink(1) are accepted too{_without(command)}."))
    inner = subcommands(command.name)
    lines += [".SH COMMANDS"] if inner else []
    for each in inner:
        lines += [f".SS {_troff(each.name)}", _troff(synopsis(each)), ".PP", *_manual_text(each)]
        lines += _manual_options(each)
    examples = [_troff(f"servolink {example}") for each in (command, *inner) for example in each.examples]
    lines += [".SH EXAMPLES", ".nf", *examples, ".fi"] if examples else []
    return "\n".join([*lines, ".SH EXIT STATUS", _LAST_LINE, ".SH SEE ALSO", ".BR servolink (1)"]) + "\n"


def _head(name: str, meaning: str) -> list[str]:
    return [f'.TH {_troff(name.upper())} 1 "" servolink', ".SH NAME", f"{_troff(name)} \\- {_troff(meaning)}"]


def _manual_text(command: Command) -> list[str]:
    paragraphs = _paragraphs(command, _troff, lambda rows: "\n".join([".nf", *map(_troff, rows.split("\n")), ".fi"]))
    return "\n.PP\n".join(paragraphs).split("\n")


def _manual_options(command: Command) -> list[str]:
    lines = list[str]()
    for title, terms in option_groups(command):
        lines += [f".SS {_troff(title)}"] if title else []
        lines += _manual_terms(terms)
    return lines


def _manual_terms(terms: list[Term]) -> list[str]:
    return [line for term, meaning in terms for line in (".TP", f"\\fB{_troff(term)}\\fR", _troff(meaning))]


def _troff(text: str) -> str:
    """Return text with nothing that troff would read as a request, and quoted commands in bold."""
    plain = re.sub(r"^([.'])", r"\\&\1", text.replace("\\", "\\e").replace("-", "\\-"))
    return re.sub(r"`([^`]+)`", r"\\fB\1\\fR", plain)


def write(folder: Path, pages: dict[str, str]) -> None:
    """Write the pages that differ from their files, and remove files without a page."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(MANUAL, manual_pages())
