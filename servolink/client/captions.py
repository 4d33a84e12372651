"""Captions of servos, records and buttons, in place of ids.

An integer is an id, and so is a text of digits; `name:3` is the caption `3`. A caption that is written exactly so comes
first, then one that differs in case only. Captions are read from the board each time, because another program may have
changed them: an outdated one would run, move or delete something else. For an integer nothing is sent.
"""

from __future__ import annotations

from collections.abc import Coroutine, Iterable, Mapping
from typing import Any, Protocol, TypeAlias, TypeVar

from servolink.errors import AmbiguousName, EncodeError, NotFound, quote
from servolink.project import Named, id_or_caption
from servolink.protocol import (
    ALL_SERVOS,
    TABLE,
    QueryActiveJoystickTableRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    RecordType,
    Request,
    Response,
)
from servolink.support import as_number

ALL = "all"
"""Name of all servos; a servo with this caption is `name:all`."""

Targets: TypeAlias = Mapping[int, float] | Mapping[str, float] | Mapping[int | str, float]
"""Angles by id or caption of the servo.

mypy takes a literal with both, `{"hip": 3, 1: 3}`, for a dict of objects: annotate it as `dict[int | str, float]`.
"""

R = TypeVar("R", bound=Response)


class CaptionSource(Protocol):
    """Reader of captions: a board or a session."""

    def request(self, packet: Request[R], /) -> Coroutine[Any, Any, R]:
        """Send `packet` and return the response."""
        ...


async def servo_ids(source: CaptionSource, servos: Iterable[int | str]) -> list[int]:
    """Return the ids of servos, 255 for `all`, with one query at most.

    Raise NotFound or AmbiguousName for what is not one servo's caption.
    """
    return (await find_servos(source, servos))[0]


async def find_servos(source: CaptionSource, servos: Iterable[int | str]) -> tuple[list[int], dict[int, str]]:
    """Return the ids of servos, as `servo_ids` does, and the captions read for the answer, by id.

    If only ids are given, no captions are read.
    """
    names = [servo_or_caption(servo) for servo in servos]
    request, named = QueryServoParameterRequest(), list[Named]()
    if any(isinstance(name, str) for name in names):
        stored = (await source.request(request)).servos
        # An entry for 255 would make a caption mean all servos.
        named = [Named("servo", one.servo_id, one.servo_caption) for one in stored if one.servo_id != ALL_SERVOS]
    ids = [_the_one(named, "servo", name, request) if isinstance(name, str) else name for name in names]
    return ids, {one.record_id: one.caption for one in named}


async def servo_id(source: CaptionSource, servo: int | str) -> int:
    """Return the id of a servo, as `servo_ids` does."""
    return (await servo_ids(source, (servo,)))[0]


async def servo_targets(source: CaptionSource, targets: Targets) -> Mapping[int, float]:
    """Return `targets` by id, `all` as each servo of the board. Raise EncodeError for a repeated servo."""
    return (await find_targets(source, targets))[0]


async def find_targets(source: CaptionSource, targets: Targets) -> tuple[Mapping[int, float], dict[int, str]]:
    """Return `targets` by id, as `servo_targets` does, and the captions read for the answer, by id."""
    if not isinstance(targets, Mapping) or not any(isinstance(servo, str) for servo in targets):
        return targets, {}  # type: ignore[return-value]  # by id, or refused later
    targets = dict(targets)  # a copy, because the caller may change the original meanwhile
    request = QueryServoListRequest()
    every = (await source.request(request)).servo_id_list if ALL in targets else ()
    if ALL in targets and not every:
        raise NotFound("the board has no servos", request)
    found: dict[int, float] = {}
    named: dict[int, int | str] = {}
    ids, captions = await find_servos(source, targets)
    for number, (servo, angle) in zip(ids, targets.items(), strict=True):
        for each in dict.fromkeys(every) if servo == ALL else (number,):
            if each in found:
                raise EncodeError(f"servo {each} is given twice: as {quote(named[each])} and as {quote(servo)}")
            found[each], named[each] = angle, servo
    return found, captions


async def record_id(
    source: CaptionSource, record_type: RecordType[Any], record: int | str, *, must_exist: bool = False
) -> int:
    """Return the id of a stored record. Raise NotFound for an unknown caption, AmbiguousName for a repeated caption.

    With `must_exist`, raise NotFound also for an id that the board does not list.
    """
    name = id_or_caption(record) if isinstance(record, str) else as_number(record)
    if not (must_exist or isinstance(name, str)):
        return name
    request = record_type.list_request
    entries = record_type.entries_in(await source.request(request))
    all_named = [Named(record_type.label, record_type.id_of(one), record_type.caption_of(one)) for one in entries]
    named = [one for one in dict.fromkeys(all_named) if one.record_id]  # an empty board may list the id 0
    if isinstance(name, str):
        found = _the_one(named, record_type.label, name, request)
        if len(same := [one for one in named if one.record_id == found]) > 1:
            raise AmbiguousName(
                f"the board lists {Named.listed(same)}, so it is unknown which of them has this id", request
            )
        return found
    if name not in (one.record_id for one in named):
        raise NotFound(
            f"the board has no {record_type} {quote(name)}; {Named.closest(named, '', record_type.label)}", request
        )
    return name


async def button_id(source: CaptionSource, button: int | str) -> int:
    """Return the id of a button of the active joystick table: only there do buttons have captions.

    Raise NotFound or AmbiguousName for what is not one button's caption.
    """
    name = id_or_caption(button) if isinstance(button, str) else as_number(button)
    if not isinstance(name, str):
        return name
    active = (await source.request(QueryActiveJoystickTableRequest())).table_id
    request = TABLE.query(active)
    table = TABLE.record_in(await source.request(request)) if active else None
    if table is None:
        raise NotFound(f"no button is captioned {quote(name)}: the board has no active joystick table", request)
    named = [Named("button", one.button_id, one.button_caption) for one in table.buttons]
    return _the_one(named, "button", name, request)


def servo_or_caption(servo: int | str) -> int | str:
    """Return an id, 255 for `all`, or a caption."""
    if not isinstance(servo, str):
        number: int = as_number(servo)
        return number
    return ALL_SERVOS if servo == ALL else id_or_caption(servo)


def _the_one(things: Iterable[Named], label: str, caption: str, request: Request[Any]) -> int:
    things = list(things)
    found = Named.captioned(things, caption)
    if len(found) == 1:
        return found[0].record_id
    if found:
        text = f"{quote(caption)} may be {Named.listed(found, 'or')}; give the id"
        raise AmbiguousName(text, request)
    hint = Named.closest(things, caption, label) if things or label != "servo" else "no servo of it has a caption"
    raise NotFound(f"the board has no {label} {quote(caption)}; {hint}", request)
