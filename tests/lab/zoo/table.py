"""Expectations for each odd board: verdict of doctor, learnt settings, and refusals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

USUAL: dict[str, object] = {
    "byte_order": "little",
    "caption_encoding": "utf-8",
    "unsupported": (),
    "unknown_ids": "empty",
    "depth": 16,
}
"""Settings learnt of the plain board."""
COMMANDS = ("servos", "info", "export", "apply", "rollback", "move", "stop")
FREE = ("servos", "info", "export", "move", "stop")
"""Commands that need none before them."""


class Row(NamedTuple):
    """Expectations for one kind of board."""

    verdict: tuple[str, ...] = ()
    """Findings of doctor; none for a healthy board."""
    learnt: Mapping[str, object] | str = {}
    """Learnt settings where they differ from the usual, None for a setting left open; or the words of a refusal."""
    refused: Mapping[str, str] | str = {}
    """Commands that refuse, each with words of the error, before the board is learnt; only words where chance decides
    which of the free commands refuse."""
    after: Mapping[str, str] | None = None
    """The same after learning; None for no difference."""
    said: str = ""
    """Words in the findings of doctor."""
    by_chance: frozenset[str] = frozenset()
    """Further commands that refuse, and settings that stay open, where the bytes of this run happen to be damaged."""


def all_refuse(words: str) -> dict[str, str]:
    """Return the same refusal for all commands; without an export, nothing is applied."""
    return dict.fromkeys(FREE, words)


_WITHOUT_PROJECT_ID = "QueryProjectIDRequest() was not answered"
_HELD = "answers each query only when the next one is sent"
_NOT_FOUND = "does not answer in either byte order or transmission mode"
_SENDS_TEXT = "sends text"
_RETURNS = "returns the requests that are sent to it"
_SILENT = "is open, but no board answers"
_LONGER = "ignore_extra=yes"
_NO_SERVOS = "the board has no servos"
_UNCONFIRMED = "a stop was sent 3 times and could not be confirmed"
_ANGLE_UNIT = "SetAngleUnitRequest"
_SUM = "the checksum is not the one of the document"
_LENGTH = "the length counts the whole frame"
_SAME_ID = "each response has the id of its request"
_PARITY = "sends bytes with even parity in bit 7"
_DAMAGED = "received bytes were part of no frame"
_NOT_APPLIED = "does not accept action 9"

_SEVERAL = "two boards, or more, answer on this line"
_TWICE = {"answers_twice": True, "depth": 1}

TABLE: dict[str, Row] = {
    "plain": Row(),
    "big": Row(("byte order",), {"byte_order": "big"}, all_refuse("byte_order=big"), {}),
    "old": Row(("transmission mode",)),
    "old-at-opening": Row(("transmission mode",), {"transmission_mode": 1}),
    "old-slow": Row(("transmission mode",)),
    "big-old": Row(("byte order", "transmission mode"), {"byte_order": "big"}, all_refuse("byte_order=big"), {}),
    "busy": Row(("one at a time",), {"depth": 1}),
    "old-busy": Row(("transmission mode", "one at a time"), {"depth": 1}),
    "late": Row(),
    "very-late": Row((), {"depth": 4}),
    "merging": Row(),
    "halves": Row(),
    "single-bytes": Row((), {"depth": 8}),
    "stalling": Row(("responses",)),
    "echoing": Row(("echoed requests",)),
    "boot-text": Row(),
    "logging": Row(("text",)),
    "resetting": Row(("absent",)),
    "twice": Row(("answers twice",), _TWICE, all_refuse("use answers_twice=yes"), {}),
    "twice-2": Row(("answers twice",), _TWICE, "use answers_twice=yes", {}),
    "twice-10": Row(("answers twice",), _TWICE, "use answers_twice=yes", {}),
    "late-copies": Row(("late copies",), {"late_copies": True, "depth": 1}),
    "two-boards": Row(("several boards",), _SEVERAL, all_refuse(_SEVERAL)),
    "twins": Row(("several boards",), _SEVERAL, all_refuse(_SEVERAL)),
    "bad-sum": Row(("noise",)),
    "padded": Row(("contents",), {"ignore_extra": True}, all_refuse(_LONGER), {}),
    "flooding": Row(),
    "silent": Row(("no response",), _NOT_FOUND, all_refuse(_SILENT)),
    "chatting": Row(("no response",), _NOT_FOUND, all_refuse(_SENDS_TEXT)),
    "loop-back": Row(("echo",), _NOT_FOUND, all_refuse(_RETURNS)),
    "modem": Row(("no response",), _NOT_FOUND, all_refuse(_SENDS_TEXT)),
    "no-project-id": Row((), {"unsupported": ("QueryProjectID",)}),
    "old-firmware": Row(
        (),
        {
            "unsupported": (
                "QueryProjectID",
                "QueryMemorySize",
                "QueryRemainPower",
                "QueryActiveJoystickTable",
                "QueryJoystickTableList",
            )
        },
        {"export": "was not answered"},
        {},
    ),
    "servos-only": Row(
        (),
        {
            "caption_encoding": None,
            "unsupported": (
                "QueryProjectID",
                "QueryMemorySize",
                "QueryRemainPower",
                "QueryActiveJoystickTable",
                "QueryActionList",
                "QueryMacroList",
                "QueryJoystickTableList",
                "QueryServoParameter",
            ),
            "unknown_ids": None,
        },
        {"export": "was not answered"},
        {"rollback": "nothing to undo"},  # as nothing of the project could be written
    ),
    "refusing": Row(
        ("servos",),
        {"caption_encoding": None},
        {"servos": _NO_SERVOS, "apply": _NOT_APPLIED, "move": _NO_SERVOS, "stop": _UNCONFIRMED},
    ),
    "from-zero": Row(),
    "one-servo": Row(),
    "many-servos": Row(),
    "big5": Row((), {"caption_encoding": "big5"}),
    "gbk": Row((), {"caption_encoding": "gb18030"}),
    "spaced": Row(),
    "uncleared": Row(),
    "uncleared-big5": Row((), {"caption_encoding": "big5"}),
    "uncleared-gbk": Row((), {"caption_encoding": "gb18030"}),
    "full": Row((), {}, {"apply": _NOT_APPLIED}),
    "kib": Row(),
    "percent": Row(),
    "free-only": Row(),
    "not-measured": Row(),
    "clipping": Row((), {}, {"apply": _NOT_APPLIED}),
    "missing-servo": Row(("servos",)),
    "wrong-count": Row(("contradiction",), {}, {"info": "5 servo_id_list take 6 bytes"}),
    "singles-only": Row(("servos",), {"unsupported": ("QueryServo",)}),
    "no-all": Row(("servos",), {"unsupported": ("QueryServo",)}),
    "adc-only": Row((), {}, {"move": "its angles are raw ADC"}),
    "half-project-id": Row(),
    "no-feedback": Row(),
    "line-ends": Row(
        ("line ends",),
        {"unsupported": None},
        {"servos": _DAMAGED, "move": _DAMAGED, "stop": _UNCONFIRMED},
        said="0d",
        by_chance=frozenset({"info", "export", "apply", "rollback"}),
    ),
    "text-bridge": Row(
        ("text bridge",),
        {"unsupported": None},
        {"servos": _ANGLE_UNIT, "export": _DAMAGED, "move": _ANGLE_UNIT, "stop": "they cannot be shown"},
        said="ef bf bd",
        by_chance=frozenset({"info", "apply", "rollback", "caption_encoding", "unknown_ids", "depth"}),
    ),
    "held-packets": Row(("responses",)),
    "one-behind": Row(("responses",), _HELD, all_refuse(_HELD)),
    "short-packets": Row(
        ("responses",),
        {"caption_encoding": None, "unknown_ids": None},
        {"export": "QueryServoParameterRequest() was not answered"},
        said="32 bytes",
    ),
    "reordering": Row(("noise",), {"depth": 1}),
    "first-byte-lost": Row(("first bytes",), "loses the first byte", all_refuse("4c 05 1d"), said="first byte"),
    "floating": Row(("no response",), _NOT_FOUND, all_refuse("00 00 00"), said="00 00 00"),
    "servo-bus": Row(("no response",), _NOT_FOUND, all_refuse("ff ff 01 02 00 fc"), said="ff ff 01 02 00 fc"),
    "overheard": Row(("unasked",), {"depth": 2}, said="another program"),
    "leftovers": Row(),
    "hanging-up": Row(("connection",), "s after the latest request", said="connections that are idle"),
    "dozing": Row(("transmission mode",), {"transmission_mode": 1}),
    "brown-out": Row((), {}, {"move": "servo 1 is at 0, not at 10"}),
    "short-buffer": Row((), {}, {"apply": _NOT_APPLIED}),
    "cyrillic": Row((), {"caption_encoding": None}),
    "hangul": Row((), {"caption_encoding": "euc_kr"}),
    "cut-captions": Row(),
    "mixed-order": Row(
        ("contradiction", *["impossible values"] * 3),
        {"caption_encoding": None, "unknown_ids": None},
        {"servos": "take", "info": "take", "export": "take", "move": "fits only the other byte order"},
        said="byte order",
    ),
    "listed-twice": Row(),
    "dead-servo": Row(("impossible values",), {}, {"stop": "servos [3] report that they may still move"}),
    "bad-record": Row((), {}, {"export": "QueryActionRequest(action_id=2) was not answered"}),
    "old-states": Row((), {}, {"stop": _UNCONFIRMED}),
    "content-sum": Row(("checksum",), _SUM, all_refuse(_SUM), said="the sum of the content only"),
    "whole-length": Row(("length",), _LENGTH, all_refuse(_LENGTH)),
    "same-id": Row(("ids",), _SAME_ID, all_refuse(_SAME_ID)),
    "small-counts": Row(
        ("responses",), {"caption_encoding": None, "unknown_ids": None}, {"export": "was not answered"}, said="30011"
    ),
    "one-more": Row(("contradiction",), {}, {"servos": "take", "move": "take", "stop": _UNCONFIRMED}),
    "singly": Row(("servos",)),
    "refusals": Row(("responses",), {}, {"export": "was not answered"}, said="ERR 30100"),
    "telnet": Row(
        ("telnet",),
        {"unsupported": None},
        {"servos": _ANGLE_UNIT, "move": _ANGLE_UNIT, "stop": _ANGLE_UNIT},
    ),
    "flow-control": Row(("flow control",), said="13 11"),
    "even-parity": Row(("serial settings",), _PARITY, all_refuse(_PARITY)),
    "sleeper": Row(("sleep",), "of two queries in a row the second one is"),
    "unit-lies": Row((), {}, {"move": "beyond 360"}),
    "slow-moving": Row(),
    "silent-write": Row((), {}, {"apply": _NOT_APPLIED}),
    "renumbering": Row((), {}, {"apply": "action 9 (stored under another id, as action 3)"}),
}
