"""Kinds of virtual boards: all known differences between real boards, each declared once.

`BoardKind` is the source of the options of `virtual://` and `servolink virtual`, and of the table in the documentation.
"""

from __future__ import annotations

from functools import cache
from operator import is_not
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args, get_origin

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import astuple

from servolink.errors import quote
from servolink.protocol import PACKETS, Packet

OnDuplicate = Literal["replace", "append", "reject"]
"""Effect of adding a stored id: the new record replaces the old record, is stored in addition, or is refused."""
Clear = Literal["all", "records"]
"""Extent of clearing: everything, or all but project id and servo parameters."""
UnknownIds = Literal["empty", "silent"]
"""Response to a query of an unknown id: a response with id or count 0, or no response."""

Seconds = Annotated[float, Meta(ge=0, le=3600, title="SECONDS")]
INTERVAL_UNIT = 0.01
"""Seconds per unit of `interval` in the document (3.2.5, 3.3.2)."""

_REQUEST = "Request"


class BoardKind(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Kind of a virtual board. Raise ValueError for a wrong option or a value out of range."""

    mode: Annotated[
        Literal[0, 1],
        Meta(description="transmission mode at power-up; in mode 0 only requests to set the mode get a response"),
    ] = 1
    memory: Annotated[int, Meta(ge=0, le=2**31 - 1, title="BYTES", description="memory for stored records")] = 64 * 1024
    memory_unit: Annotated[Literal[1, 1024], Meta(description="bytes in one unit of reported memory")] = 1
    memory_reported: Annotated[
        int,
        Meta(ge=0, le=2**31 - 1, title="N", description="reported total memory, in units; 0: the actual memory"),
    ] = 0
    on_duplicate: Annotated[OnDuplicate, Meta(description="effect of adding a record with a stored id")] = "replace"
    clear: Annotated[Clear, Meta(description="extent of clearing the board")] = "all"
    project_id_bits: Annotated[Literal[0, 16, 32], Meta(description="stored bits of the project id")] = 32
    unknown_ids: Annotated[UnknownIds, Meta(description="response to a query of an unknown id")] = "empty"
    unsupported: Annotated[
        tuple[str, ...], Meta(title="NAMES", description="requests ignored by the board, separated by commas")
    ] = ()
    interval_unit: Annotated[
        float, Meta(ge=0.001, le=0.1, title="SECONDS", description="unit of `interval` in movements and actions")
    ] = INTERVAL_UNIT
    turnaround: Annotated[Seconds, Meta(description="working time of each request")] = 0.0
    write_seconds: Annotated[Seconds, Meta(description="further time to store or delete something")] = 0.0
    clear_seconds: Annotated[Seconds, Meta(description="further time to clear everything")] = 0.0
    queue: Annotated[
        int, Meta(ge=0, le=1000, title="N", description="most requests waiting while the board works; others are lost")
    ] = 1000
    queue_bytes: Annotated[
        int,
        Meta(ge=0, le=2**20, title="BYTES", description="most bytes waiting while the board works; others are lost"),
    ] = 2**20
    bus_powered: Annotated[bool, Meta(description="power is lost when the last host detaches")] = False
    partial_writes: Annotated[bool, Meta(description="a loss of power leaves part of an unfinished write")] = False

    DEFAULT: ClassVar[BoardKind]
    """Kind of most boards."""

    @classmethod
    @cache  # and not at import: most boards are of the default kind
    def options(cls) -> tuple[KindOption, ...]:
        """Return all options, in order of their description."""
        return tuple(map(_option, msgspec.structs.fields(cls)))

    def __post_init__(self) -> None:
        """Check the values of all options, unless all are defaults."""
        if any(map(is_not, astuple(self), self.__struct_defaults__)):
            for option in self.options():
                option.check(getattr(self, option.name))

    @property
    def takes_time(self) -> bool:
        """Whether requests have a working time, and responses are not immediate."""
        return bool(self.turnaround or self.write_seconds or self.clear_seconds)

    def ignores(self, request: Packet) -> bool:
        """Return whether a request is unsupported, and gets no response."""
        return type(request).__name__.removesuffix(_REQUEST) in self.unsupported


class KindOption(NamedTuple):
    """Option of `BoardKind`, with its description for people and its form as text."""

    name: str
    hint: Any
    default: Any
    meaning: str
    unit: str
    """Placeholder for the value in help texts, such as SECONDS or all|records."""
    allowed: str
    """Possible values, as a phrase to follow "must be"."""

    @property
    def is_flag(self) -> bool:
        """Whether the option is a switch without a value."""
        return isinstance(self.default, bool)

    @property
    def default_text(self) -> str:
        """Default of the option, as text."""
        if isinstance(self.default, tuple):
            return ",".join(self.default) or "none"
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default)

    def read(self, text: str) -> Any:
        """Return the value in `text`. Raise ValueError, without the name of the option, for a wrong value."""
        return self._converted(text.split(",") if isinstance(self.default, tuple) else text, text, strict=False)

    def check(self, value: object) -> None:
        """Raise ValueError for a `value` of the wrong type or out of range."""
        try:
            self._converted(value, value, strict=True)
        except ValueError as error:
            raise ValueError(f"{self.name} {error}") from None

    def _converted(self, value: object, shown: object, *, strict: bool) -> Any:
        try:
            converted = msgspec.convert(value, self.hint, strict=strict)
        except msgspec.ValidationError:
            raise ValueError(f"must be {self.allowed}, not {quote(shown)}") from None
        if isinstance(converted, tuple) and (unknown := sorted(set(converted) - _request_names())):
            raise ValueError(f"must be {self.allowed}, and {quote(unknown[0])} is not one")
        return converted


def _request_names() -> set[str]:
    return {name.removesuffix(_REQUEST) for name in PACKETS.by_name if name.endswith(_REQUEST)}


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


BoardKind.DEFAULT = BoardKind()
