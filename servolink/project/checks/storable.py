"""What a board can store, whatever it then does with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import EncodeError
from servolink.project.checks.problem import Problem
from servolink.project.checks.repeats import number_of, repeats
from servolink.project.files.fault import fault
from servolink.project.files.file_types import file_type, to_file
from servolink.project.kinds import KINDS
from servolink.project.model import UNFINISHED, Project
from servolink.project.size import total_size
from servolink.protocol.editing import AddServoParameterRequest, ServoParameter
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet
from servolink.protocol.registry import PACKETS


def unstorable(project: Project, caption_encoding: str = "utf-8", memory: int | None = None) -> Iterator[Problem]:
    """Yield why a board with `memory` bytes cannot store `project`."""
    yield from _numbers_of_all(project)
    yield from _shelf("servo_parameters", project.servo_parameters, 0x100, _servo_parameter_request, caption_encoding)
    for kind in KINDS:
        most = layout(PACKETS[kind.listing.packet_id + 1], "little").rule.limit
        yield from _shelf(kind.plural, getattr(project, kind.plural), most, kind.add, caption_encoding)
    size = total_size(project)
    if memory is not None and size > memory:
        yield Problem("", f"all of it takes {size:,} bytes; the board has {memory:,}", "error")


def _numbers_of_all(project: Project) -> Iterator[Problem]:
    if project.project_id in UNFINISHED:
        text = f"{project.project_id} means that an import is under way; take another id, such as 1"
        yield Problem("project_id", text, "error")
    alone = replace(project, servo_parameters=(), actions=(), macros=(), joystick_tables=())
    yield from misfit("", alone)
    ids = {table.table_id for table in project.joystick_tables}
    active = project.active_joystick_table
    if active is not None and active not in ids:
        yield Problem("active_joystick_table", f"there is no joystick table {active}", "error", fixable=len(ids) <= 1)


def _shelf(
    place: str, records: tuple[Any, ...], most: int, request: Callable[[Any], Packet], caption_encoding: str
) -> Iterator[Problem]:
    """Look at all records of a kind, of which `request` stores one."""
    if len(records) > most:
        yield Problem(place, f"there are {len(records):,}; a board can list {most:,}", "error")
    yield from _ids(place, records)
    for at, record in enumerate(records):
        yield from _unsendable(f"{place}[{at}]", record, request, caption_encoding)


def _ids(place: str, records: tuple[Any, ...]) -> Iterator[Problem]:
    """Find ids that no record can have, or that several have."""
    for at, record in enumerate(records):
        record_id, path = number_of(record), f"{place}[{at}].{record.__struct_fields__[0]}"
        if record_id == 0 and place != "servo_parameters":
            yield Problem(path, "0 is no id: boards say it for what is not there", "error")
        elif record_id < 0:
            yield Problem(path, f"{record_id} is negative; take an id from 1 on, as boards do", "warning")
    for at, before, same in repeats(records):
        path = f"{place}[{at}].{records[at].__struct_fields__[0]}"
        text = f"{number_of(records[at])} is also the id of {place}[{before}]{', which is the same' if same else ''}"
        yield Problem(path, text, "error", fixable=same)


def _unsendable(path: str, record: Any, request: Callable[[Any], Packet], caption_encoding: str) -> Iterator[Problem]:
    """Find the first thing in a record that the request for storing it cannot carry."""
    if misfits := list(misfit(path, record)):
        yield from misfits
        return
    packet = request(record)
    try:
        layout(type(packet), "little").encode(packet, caption_encoding)
    except EncodeError as error:
        where, _, text = str(error).partition(": ")
        within = where.removeprefix(type(packet).__name__).removeprefix(".servos[0]")
        yield Problem(path + within, text, "error")


def _servo_parameter_request(parameter: ServoParameter) -> Packet:
    return AddServoParameterRequest((parameter,))


def misfit(path: str, part: Struct, *, exact: bool = False) -> Iterator[Problem]:
    """Find the first value that no project file may have, in the file's words; `exact` as for `load_project`."""
    said, form = to_file(part), file_type(type(part), exact=exact)
    try:
        msgspec.convert(said, form)
    except msgspec.ValidationError as error:
        within, text = fault(str(error), said, form)
        yield Problem(".".join(filter(None, (path, within))), text, "error")
