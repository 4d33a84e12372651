"""The kinds of virtual boards: everything in which real boards may differ, declared once.

The options of `virtual://`, those of `servolink virtual` and the table in the documentation are read from `BoardKind`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

import msgspec
from msgspec import Meta, Struct

from servolink.escaping import quote
from servolink.protocol.codec import PACKETS_BY_NAME
from servolink.protocol.packet import Packet

OnDuplicate = Literal["replace", "append", "reject"]
"""What adding a stored id does: the new record replaces the old one, is stored besides it, or is refused."""
Clear = Literal["all", "records"]
"""What clearing deletes: everything, or all but project id and servo parameters."""
UnknownIds = Literal["empty", "silent"]
"""How a query of an id that does not exist is answered: with the id or count 0, or not at all."""

Seconds = Annotated[float, Meta(ge=0, le=3600, title="SECONDS")]
INTERVAL_UNIT = 0.01
"""Seconds per unit of `interval` in the document (3.2.5, 3.3.2)."""

_REQUEST = "Request"
_NAMES = frozenset(name.removesuffix(_REQUEST) for name in PACKETS_BY_NAME if name.endswith(_REQUEST))


class BoardKind(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What kind of board a virtual board is. Raise ValueError for an option that is wrong or out of range."""

    mode: Annotated[
        Literal[0, 1], Meta(description="transmission mode at power-up; in mode 0 only its setting is answered")
    ] = 1
    memory: Annotated[int, Meta(ge=0, le=2**31 - 1, title="BYTES", description="memory for what is stored")] = 64 * 1024
    memory_unit: Annotated[Literal[1, 1024], Meta(description="bytes in which the board counts its memory")] = 1
    memory_reported: Annotated[
        int,
        Meta(ge=0, le=2**31 - 1, title="N", description="memory it claims to have, in that unit; 0: as much as it has"),
    ] = 0
    on_duplicate: Annotated[OnDuplicate, Meta(description="what adding a stored id does")] = "replace"
    clear: Annotated[Clear, Meta(description="what clearing deletes")] = "all"
    project_id_bits: Annotated[Literal[0, 16, 32], Meta(description="how many bits of the project id it keeps")] = 32
    unknown_ids: Annotated[UnknownIds, Meta(description="answer to a query of an id that does not exist")] = "empty"
    unsupported: Annotated[
        tuple[str, ...], Meta(title="NAMES", description="requests that it ignores, separated by commas")
    ] = ()
    interval_unit: Annotated[
        float, Meta(ge=0.001, le=0.1, title="SECONDS", description="the unit of `interval` in movements and actions")
    ] = INTERVAL_UNIT
    turnaround: Annotated[Seconds, Meta(description="working time of each request")] = 0.0
    write_seconds: Annotated[Seconds, Meta(description="further time to store or delete something")] = 0.0
    clear_seconds: Annotated[Seconds, Meta(description="further time to clear everything")] = 0.0
    queue: Annotated[
        int, Meta(ge=0, le=1000, title="N", description="requests that can wait while it works; others are lost")
    ] = 1000
    queue_bytes: Annotated[
        int, Meta(ge=0, le=2**20, title="BYTES", description="bytes that can wait while it works; others are lost")
    ] = 2**20
    bus_powered: Annotated[bool, Meta(description="it loses power when its last host detaches")] = False
    partial_writes: Annotated[bool, Meta(description="losing power leaves a part of what is being stored")] = False

    def __post_init__(self) -> None:
        """Check all options."""
        for option in OPTIONS:
            option.check(getattr(self, option.name))

    @property
    def takes_time(self) -> bool:
        """Whether it works on requests, instead of responding at once."""
        return bool(self.turnaround or self.write_seconds or self.clear_seconds)

    def ignores(self, request: Packet) -> bool:
        """Return whether the board does not support a request."""
        return type(request).__name__.removesuffix(_REQUEST) in self.unsupported


class KindOption(NamedTuple):
    """Option of `BoardKind`, as read from text and described to people."""

    name: str
    hint: Any
    default: Any
    meaning: str
    unit: str
    """What stands for the value in help texts, such as SECONDS or all|records."""
    allowed: str
    """Possible values, in words."""

    @property
    def is_flag(self) -> bool:
        """Whether the option is only on or off."""
        return isinstance(self.default, bool)

    @property
    def default_text(self) -> str:
        """The default as text."""
        if isinstance(self.default, tuple):
            return ",".join(self.default) or "none"
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default)

    def read(self, text: str) -> Any:
        """Return the value that `text` stands for. Raise ValueError, without the option's name, if it is wrong."""
        return self._converted(text.split(",") if isinstance(self.default, tuple) else text, text, strict=False)

    def check(self, value: object) -> None:
        """Raise ValueError if `value` is of the wrong type or out of range."""
        try:
            self._converted(value, value, strict=True)
        except ValueError as error:
            raise ValueError(f"{self.name} {error}") from None

    def _converted(self, value: object, shown: object, *, strict: bool) -> Any:
        try:
            converted = msgspec.convert(value, self.hint, strict=strict)
        except msgspec.ValidationError:
            raise ValueError(f"must be {self.allowed}, not {quote(shown)}") from None
        if isinstance(converted, tuple) and (unknown := sorted(set(converted) - _NAMES)):
            raise ValueError(f"must be {self.allowed}, and {quote(unknown[0])} is not one")
        return converted


def _option(field: msgspec.structs.FieldInfo) -> KindOption:
    bare, *metas = get_args(field.type)
    low, high, unit, meaning = (
        next((value for meta in reversed(metas) if (value := getattr(meta, key)) is not None), "")
        for key in ("ge", "le", "title", "description")
    )
    if get_origin(bare) is Literal:
        choices = [str(choice) for choice in get_args(bare)]
        allowed, unit = "one of " + ", ".join(choices), "|".join(choices)
    elif bare is bool:
        allowed = "0 or 1"
    elif get_origin(bare) is tuple:
        allowed = "names of requests such as QueryMemorySize, separated by commas"
    else:
        allowed = f"{'an integer' if bare is int else 'a number'} from {low} to {high}"
    return KindOption(field.name, field.type, field.default, meaning, unit, allowed)


OPTIONS: tuple[KindOption, ...] = tuple(map(_option, msgspec.structs.fields(BoardKind)))
"""All options, in the order in which they are described."""
DEFAULT_KIND = BoardKind()
