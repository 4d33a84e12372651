"""Changes of TOML files that people edit: tomlkit keeps comments, spacing and the form of all other values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.items import Comment, InlineTable, Item, Table

from servolink.errors import escape

_UNUSUAL = re.compile(r"[^ !#-\[\]-~]")
_HEXADECIMAL = {"vendor_id", "product_id"}


def change_toml(text: str, tables: Mapping[str, object]) -> str:
    """Return `text` with the content of `tables`; comments, spacing and the form of other values stay.

    None means unknown: the line becomes a comment, `# name =`, and such a comment becomes a value again.
    """
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = text.replace("\r\n", "\n")
    document = tomlkit.parse(lines if lines.endswith("\n") or not lines else f"{lines}\n")
    _change(document, tables)
    return tomlkit.dumps(document).replace("\n", newline)


def toml_value(name: str, value: object) -> str:
    """Return a value as TOML, with USB ids in hexadecimal and control characters escaped."""
    if isinstance(value, str):
        return '"' + _UNUSUAL.sub(_escape_match, value) + '"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(toml_value(name, each) for each in value)}]"
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return f"{value:#06x}" if name in _HEXADECIMAL and isinstance(value, int) else repr(value).removesuffix(".0")


def _change(table: Any, values: Mapping[str, object]) -> None:
    """Set the content of a table of tomlkit to `values`; tomlkit has a type for each form of tables."""
    for name in [name for name in table if name not in values or _becomes_table(table[name], values[name])]:
        _remove(table, name)
    for name, value in values.items():
        if isinstance(value, Mapping):
            if name in table:
                _change(table[name], value)
            elif any(each is not None for each in value.values()):
                _add_table(table, name, value)
        elif value is None and name in table:
            _comment_out(table, name)
        elif value is not None and not (name in table and _is_same(table[name], value)):
            item = tomlkit.value(toml_value(name, value))
            # A table in several pieces, joined by tomlkit, has no `append`.
            if name in table or not hasattr(table, "append"):
                table[name] = item
            elif not _replace_comment(table, name, item):
                _add(table, name, item)


def _comment_out(table: Any, name: str) -> None:
    """Put the comment `# name =` in place of a value; what is in one line with others is removed."""
    for at, (key, item) in enumerate([] if isinstance(table, InlineTable) else _body(table)):
        if key is not None and key.key == name:
            made = tomlkit.comment(f"{name} ={item.trivia.comment_ws}{item.trivia.comment}")
            made.trivia.indent = item.trivia.indent
            _body(table)[at] = (None, made)
            return
    del table[name]


def _replace_comment(table: Any, name: str, item: Item) -> bool:
    """Put a value in place of the comment `# name =`. Return whether there is one."""
    for at, (_, found) in enumerate(_body(table)):
        if not isinstance(found, Comment):
            continue
        before, equals, after = found.trivia.comment.removeprefix("#").partition("=")
        if equals and before.strip() == name and after.strip()[:1] in {"", "#"}:
            item.trivia.indent, item.trivia.trail = found.trivia.indent, found.trivia.trail
            item.trivia.comment = after.strip()
            item.trivia.comment_ws = after[: len(after) - len(after.lstrip())]
            _body(table)[at] = (tomlkit.key(name), item)
            return True
    return False


def _becomes_table(item: Any, value: object) -> bool:
    return isinstance(value, Mapping) and not isinstance(item, Mapping)


def _is_same(item: Any, value: object) -> bool:
    found = item if isinstance(item, bool) else item.unwrap()  # tomlkit returns flags as they are
    return found == (list(value) if isinstance(value, tuple) else value) and isinstance(found, bool) == isinstance(
        value, bool
    )


def _add_table(table: Any, name: str, values: Mapping[str, object]) -> None:
    if isinstance(table, InlineTable):
        added: Any = tomlkit.inline_table()
    else:
        added = tomlkit.table(is_super_table=all(isinstance(each, Mapping) for each in values.values()))
        added.trivia.indent = "\n"
    _change(added, values)
    if hasattr(table, "append"):
        _add(table, name, added)
    else:
        table[name] = added


def _add(table: Any, name: str, item: Item) -> None:
    """Add a value or a table in front of the comments at the end: comments there belong to the next header."""
    body = _body(table)
    end: list[Any] = []
    while body and body[-1][0] is None:
        end.insert(0, body.pop())
    table.append(name, item)
    body.extend(end)


def _remove(table: Any, name: str) -> None:
    """Remove a value or a table, but keep the comments at the end: comments there belong to the next header."""
    item, body = table[name], _body(table)
    index = next((at for at, (key, _) in enumerate(body) if key is not None and key.key == name), None)
    table.remove(name)
    if isinstance(item, Table) and index is not None:
        body[index] = (None, tomlkit.ws(_end_of(item).removeprefix("\n")))


def _end_of(table: Table) -> str:
    """Return the comments and empty lines at the end of a table."""
    end = ""
    for key, item in reversed(table.value.body):
        if key is not None:
            return (_end_of(item) if isinstance(item, Table) else "") + end
        end = item.as_string() + end
    return end


def _body(table: Any) -> list[Any]:
    container: Container = getattr(table, "value", table)
    return container.body if hasattr(container, "body") else []


def _escape_match(found: re.Match[str]) -> str:
    character = found[0]
    is_plain = character not in '"\\' and escape(character) == character
    return character if is_plain else f"\\U{ord(character):08x}"
