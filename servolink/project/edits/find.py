"""Records by what people call them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.kinds import Kind
from servolink.project.model import Project
from servolink.project.records import named

_NUMBERED = re.compile(r"(?:([a-z]+):)?([0-9]{1,10})", re.ASCII)


def find(project: Project, name: str, kinds: Iterable[Kind]) -> Any:
    """Return the record that `name` means: a caption, an id, or an id behind its kind, as in `action:3`.

    ProjectError if there is none, or more than one.
    """
    kinds = tuple(kinds)
    numbered = _NUMBERED.fullmatch(name)
    word, number = (numbered[1] or "", int(numbered[2])) if numbered else ("", -1)
    records = [(kind, record) for kind in kinds for record in getattr(project, kind.plural)]
    found = [
        record
        for kind, record in records
        if kind.caption_of(record) == name or (kind.id_of(record) == number and word in ("", kind.word.split()[-1]))
    ]
    if not found:
        found = [record for kind, record in records if kind.caption_of(record).casefold() == name.casefold()]
    if len(found) == 1:
        return found[0]
    if found:
        raise ProjectError(f"'{printable(name)}' may be {' or '.join(map(named, found))}: write it as in action:3")
    words = " or ".join(kind.word for kind in kinds)
    there = ", ".join(named(record) for _, record in records[:10]) + (", ..." if len(records) > 10 else "")
    raise ProjectError(f"there is no {words} '{printable(name)}'; there is {there or 'none at all'}")
