"""Profile of a board: measured properties, decisions of the user, and the evidence for each setting.

None means unknown. Fields have the same names as in the file; `FieldHelp` has the meaning of each field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from functools import cache
from itertools import groupby
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, get_type_hints

from msgspec import Meta, Struct, ValidationError, convert
from msgspec.structs import asdict, force_setattr, replace

from servolink.errors import quote
from servolink.motion import MotionLimits
from servolink.protocol import PACKETS, ByteOrder, Codec, Query

MOST_DEPTH = 64


class FieldHelp(Struct, frozen=True):
    """Description of a field of a profile, for the user."""

    meaning: str
    """Meaning with the unit, written as the comment above the field in the file."""
    expected: str
    """Possible values, as a phrase to follow "must be"."""
    check: Callable[[Any], object] = lambda value: None
    """Further check, which raises ValueError for a wrong value of the right type."""

    @staticmethod
    def in_shell(text: str) -> str:
        """Return a description of values as written in a shell, without the quotes and brackets of TOML."""
        return re.sub(r'["\[\]]', "", text)


@cache
def query_names() -> frozenset[str]:
    """Return the names of all queries, such as `QueryMemorySize`."""
    return frozenset(kind.__name__.removesuffix("Request") for kind in PACKETS.values() if issubclass(kind, Query))


def _check_encoding(name: str) -> None:
    Codec(caption_encoding=name)


def _check_unsupported(names: tuple[str, ...]) -> None:
    if unknown := sorted(set(names) - query_names()):
        raise ValueError(
            f"{quote(unknown[0])} is not a query of the protocol; the queries are {', '.join(sorted(query_names()))}"
        )


def _check_pair(pair: tuple[float, float]) -> None:
    if not pair[0] <= pair[1]:
        raise ValueError(f"no angle is within {pair[0]:g}..{pair[1]:g}; write the lowest angle first")


_U16 = Annotated[int, Meta(ge=0, le=0xFFFF)]
_Natural32 = Annotated[int, Meta(ge=0, le=0x7FFF_FFFF)]
_Depth = Annotated[int, Meta(ge=1, le=MOST_DEPTH)]
_Seconds = Annotated[float, Meta(ge=0, le=3600)]
_IntervalUnit = Annotated[float, Meta(ge=0.0001, le=10)]
_Speed = Annotated[float, Meta(ge=0.001, le=100_000)]
_Degrees = Annotated[float, Meta(ge=-0x8000, le=0x7FFF)]
_ServoId = Annotated[int, Meta(ge=0, le=254)]
_DEPTH = f"1..{MOST_DEPTH}"
_SPEED = "0.001..100000 degrees per second"

ServoKey = Annotated[_ServoId, FieldHelp("", "a servo id, 0..254")]
SpeedOfServo = Annotated[_Speed, FieldHelp("", _SPEED)]
AnglesOfServo = Annotated[
    tuple[_Degrees, _Degrees],
    FieldHelp("", "the lowest and the highest angle in degrees, such as [20, 160]", _check_pair),
]


class BoardIdentityRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Identity of a board: properties different from other boards."""

    servo_ids: Annotated[
        tuple[_ServoId, ...] | None,
        FieldHelp("ids of all servos", "a list of servo ids, 0..254"),
    ] = None
    memory_total: Annotated[
        _Natural32 | None,
        FieldHelp("total memory as the board reports it, in units of settings.memory_unit", f"0..{0x7FFF_FFFF}"),
    ] = None
    vendor_id: Annotated[_U16 | None, FieldHelp("USB vendor id of the port", "0x0000..0xffff")] = None
    product_id: Annotated[_U16 | None, FieldHelp("USB product id of the port", "0x0000..0xffff")] = None
    serial_number: Annotated[str | None, FieldHelp("USB serial number of the port", "text")] = None

    @classmethod
    def of(cls, **found: object) -> BoardIdentityRecord:
        """Return the identity in properties as found, without those that no board has, such as a memory of -1."""
        return cls(**{name: value for name, value in found.items() if can_hold(cls, name, value)})  # type: ignore[arg-type]

    def fits(self, found: BoardIdentityRecord) -> bool:
        """Return whether all properties known of both boards agree; the order of servo ids does not count."""
        ids = self.servo_ids, found.servo_ids
        if None not in ids and set(self.servo_ids or ()) != set(found.servo_ids or ()):
            return False
        others = [(getattr(self, name), getattr(found, name)) for name in self.__struct_fields__ if name != "servo_ids"]
        return all(expected is None or actual is None or expected == actual for expected, actual in others)

    def facts(self) -> list[tuple[str, str]]:
        """Return the known properties, in words such as `servos`, `1..16`."""
        facts = []
        if self.servo_ids is not None:
            facts.append(("servos", _ranges(sorted(set(self.servo_ids))) or "none"))
        if self.memory_total is not None:
            facts.append(("memory total", str(self.memory_total)))
        if self.vendor_id is not None or self.product_id is not None:
            facts.append(("USB", f"{self.vendor_id or 0:04x}:{self.product_id or 0:04x}"))
        if self.serial_number:
            facts.append(("serial number", quote(self.serial_number)))
        return facts


def _ranges(ordered: Sequence[int]) -> str:
    """Return the numbers in `ordered`, ascending, as text such as `1..3, 7`."""
    runs = [[number for _, number in run] for _, run in groupby(enumerate(ordered), lambda each: each[1] - each[0])]
    return ", ".join(f"{run[0]}..{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


class BoardSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a board: left open by the document, or different between boards."""

    byte_order: Annotated[ByteOrder | None, FieldHelp("byte order of the numbers in packets", '"little" or "big"')] = (
        None
    )
    caption_encoding: Annotated[
        str | None,
        FieldHelp('encoding of captions, such as "utf-8" or "big5"', "the name of an encoding", _check_encoding),
    ] = None
    power_up_mode: Annotated[
        Literal[0, 1] | None,
        FieldHelp("transmission mode after switching on: servolink speaks mode 1", "0 or 1"),
    ] = None
    transmission_mode: Annotated[
        Literal["auto", "keep", 1] | None,
        FieldHelp(
            'when connecting sets mode 1: "auto" (if the board is silent), 1 (always) or "keep" (never)',
            '"auto", "keep" or 1',
        ),
    ] = None
    unsupported: Annotated[
        tuple[str, ...] | None,
        FieldHelp(
            'queries without a response of the board, such as ["QueryMemorySize"]',
            "a list of queries",
            _check_unsupported,
        ),
    ] = None
    unknown_ids: Annotated[
        Literal["empty", "silent"] | None,
        FieldHelp("response of the board to a query of an unknown id", '"empty" or "silent"'),
    ] = None
    turnaround: Annotated[
        _Seconds | None,
        FieldHelp("seconds from the end of a query to the beginning of the response", "0..3600 seconds"),
    ] = None
    depth: Annotated[_Depth | None, FieldHelp("most queries in progress at the same time", _DEPTH)] = None
    write_depth: Annotated[_Depth | None, FieldHelp("most writes in progress at the same time", _DEPTH)] = None
    answers_twice: Annotated[
        bool | None,
        FieldHelp("whether the board may answer a request twice", "true or false"),
    ] = None
    late_copies: Annotated[
        bool | None,
        FieldHelp("whether copies of responses may come later", "true or false"),
    ] = None
    ignore_extra: Annotated[
        bool | None,
        FieldHelp("whether to ignore content beyond the document", "true or false"),
    ] = None
    memory_unit: Annotated[Literal[1, 1024] | None, FieldHelp("bytes in one unit of reported memory", "1 or 1024")] = (
        None
    )
    project_id_bits: Annotated[Literal[0, 16, 32] | None, FieldHelp("stored bits of the project id", "0, 16 or 32")] = (
        None
    )
    on_duplicate: Annotated[
        Literal["replace", "append", "reject"] | None,
        FieldHelp("effect of adding a record with a stored id", '"replace", "append" or "reject"'),
    ] = None
    clear: Annotated[
        Literal["all", "records"] | None,
        FieldHelp("extent of clearing: all, or all but project id and servo parameters", '"all" or "records"'),
    ] = None
    clear_seconds: Annotated[_Seconds | None, FieldHelp("seconds needed to clear the board", "0..3600 seconds")] = None
    interval_unit: Annotated[
        _IntervalUnit | None,
        FieldHelp("seconds in one unit of the time of a movement; 0.01 in the document", "0.0001..10 seconds"),
    ] = None
    when_started: Annotated[
        Literal["stays", "turns"] | None,
        FieldHelp(
            'effect of starting a stopped servo: the servo "stays", or "turns" to the previous target',
            '"stays" or "turns"',
        ),
    ] = None

    @classmethod
    def help_in_shell(cls) -> dict[str, str]:
        """Return meaning and possible values of each setting, written as in a shell."""
        described = {name: help_ for name, (_, help_) in fields_of(cls).items()}
        return {name: each.in_shell(f"{each.meaning} ({each.expected})") for name, each in described.items()}


class SafetyLimits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits set by the user, which programs can only tighten."""

    speed_cap: Annotated[_Speed | None, FieldHelp("highest speed of any servo, in degrees per second", _SPEED)] = None
    soft_start: Annotated[
        _Speed | None,
        FieldHelp("highest speed of the first movement from an unknown pose, in degrees per second", _SPEED),
    ] = None
    angle_range: Annotated[
        tuple[_Degrees, _Degrees] | None,
        FieldHelp(
            "lowest and highest angle of any servo in degrees, such as [-90, 90]; `angles` can only narrow it",
            "the lowest and the highest angle in degrees, such as [-90, 90]",
            _check_pair,
        ),
    ] = None
    guard: Annotated[
        bool | None,
        FieldHelp(
            "whether a hub stops the board for a stalled servo; unless set, the studio and share --guard do",
            "true or false",
        ),
    ] = None
    temperature: Annotated[
        int | None,
        FieldHelp("raw temperature of a servo before which the guard of a hub warns", "a whole number"),
    ] = None
    ease_off: Annotated[
        tuple[_ServoId, ...] | None,
        FieldHelp(
            "servos that the guard turns back by up to 2 degrees after a stall, such as [3]",
            "a list of servo ids, 0..254",
        ),
    ] = None
    angles: Annotated[
        dict[ServoKey, AnglesOfServo],
        FieldHelp("lowest and highest angle of a servo in degrees, by servo id, such as 3 = [20, 160]", "a table"),
    ] = {}
    speed_caps: Annotated[
        dict[ServoKey, SpeedOfServo],
        FieldHelp("highest speed of a servo in degrees per second, by servo id, such as 3 = 90", "a table"),
    ] = {}

    def for_motions(self, source: str = "") -> MotionLimits:
        """Return the limits for the checks of motions, which name `source` in errors."""
        limits = MotionLimits(self.angles, self.speed_cap, self.speed_caps, self.soft_start, source)
        everywhere = self.angle_range
        return limits if everywhere is None else limits.tightened(MotionLimits(everywhere, source=source))


Confidence = Literal["certain", "likely", "guess"]


class Evidence(Struct, frozen=True, forbid_unknown_fields=True):
    """Evidence for the value of a setting."""

    confidence: Annotated[Confidence, FieldHelp("", '"certain", "likely" or "guess"')]
    text: Annotated[str, FieldHelp("", "text")]
    """Observation, in one sentence with figures."""
    learnt_at: Annotated[datetime | None, FieldHelp("", "a date and time such as 2026-01-31T12:00:00Z")] = None
    BY_HAND: ClassVar[str] = "set with `servolink board set`"
    """Text of the evidence for a value set by the user."""


def _check_setting(name: str) -> None:
    if name not in BoardSettings.__struct_fields__:
        raise ValueError(f"is not a setting; the settings are {', '.join(BoardSettings.__struct_fields__)}")


SettingName = Annotated[str, FieldHelp("", "the name of a setting", _check_setting)]


class BoardProfile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Identity, settings, limits and evidence of one board."""

    identity: Annotated[
        BoardIdentityRecord | None,
        FieldHelp("Identity of this board: with another board nothing is moved or written.", "a table"),
    ] = None
    settings: Annotated[
        BoardSettings,
        FieldHelp(
            "Settings, measured or set by you. Options of a program and of the address take precedence.", "a table"
        ),
    ] = BoardSettings()
    limits: Annotated[
        SafetyLimits,
        FieldHelp("Limits set by you. Programs cannot allow more, only less.", "a table"),
    ] = SafetyLimits()
    evidence: Annotated[
        dict[SettingName, Evidence],
        FieldHelp("Evidence for each setting, by name, with confidence and time.", "a table"),
    ] = {}

    def merged(self, measured: Iterable[Measured], identity: BoardIdentityRecord, now: datetime) -> Self:
        """Return this profile with measured settings; limits, and settings without a new measurement, stay.

        An old value is replaced, except by the same value with weaker evidence, and except if the user has set another
        value and the measurement is not certain.
        """
        settings, evidence = self.settings, dict(self.evidence)
        for each in measured:
            if each.value is not None and _replaces(each, getattr(settings, each.setting), evidence.get(each.setting)):
                settings = replace(settings, **{each.setting: each.value})
                evidence[each.setting] = Evidence(each.confidence, each.evidence, now)
        return replace(self, identity=_merged(self.identity, identity), settings=settings, evidence=evidence)


class ProfileInUse(NamedTuple):
    """Profile in use by a connection."""

    name: str | None
    """Name of the board, None for an unnamed profile."""
    profile: BoardProfile

    def __str__(self) -> str:
        """Return the profile as named in errors, such as `profile "rex"`."""
        return "the profile" if self.name is None else f'profile "{self.name}"'

    @property
    def settings(self) -> BoardSettings:
        """Settings of the board, in use by the connection."""
        return self.profile.settings

    @property
    def limits(self) -> MotionLimits:
        """Limits of movements, for every check of a movement."""
        return self.profile.limits.for_motions(str(self))


@cache
def fields_of(kind: type[Struct]) -> dict[str, tuple[Any, FieldHelp]]:
    """Return type and description of each field of a part of the profile, in order."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: (hints[name], about(hints[name])) for name in kind.__struct_fields__}


def about(hint: Any) -> FieldHelp:
    """Return the description in an annotated type."""
    return next(each for each in hint.__metadata__ if isinstance(each, FieldHelp))


def can_hold(kind: type[Struct], name: str, value: object) -> bool:
    """Return whether a field of a part of the profile can be `value`."""
    hint, described = fields_of(kind)[name]
    try:
        found = convert(value, hint)
        if found is not None:
            described.check(found)
    except (ValidationError, ValueError):
        return False
    return True


_RANKS: dict[Confidence, int] = {"guess": 0, "likely": 1, "certain": 2}


class Measured(Struct, frozen=True):
    """Measured setting of a board."""

    setting: str
    """Name of the setting in the profile."""
    value: Any
    """Measured value; None if unknown."""
    confidence: Confidence
    evidence: str
    """Observation, in one sentence with figures."""

    def __post_init__(self) -> None:
        """Drop a value that no profile can hold, such as a time of no length, and say so in the evidence."""
        if not can_hold(BoardSettings, self.setting, self.value):
            force_setattr(self, "evidence", f"{self.evidence}; {quote(self.value)} is too unlikely to be saved")
            force_setattr(self, "value", None)


def _replaces(measured: Measured, value: object, evidence: Evidence | None) -> bool:
    if value is None:
        return True
    if evidence is None or evidence.text == Evidence.BY_HAND:
        return measured.confidence == "certain" or measured.value == value
    return measured.value != value or _RANKS[measured.confidence] >= _RANKS[evidence.confidence]


def _merged(stored: BoardIdentityRecord | None, found: BoardIdentityRecord) -> BoardIdentityRecord:
    """Return the identity with new properties; properties lost on a bad line keep their old values."""
    return replace(stored or found, **{name: value for name, value in asdict(found).items() if value is not None})
