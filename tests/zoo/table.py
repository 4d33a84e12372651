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


def all_refuse(words: str) -> dict[str, str]:
    """Return the same refusal for all commands; without an export, nothing is applied."""
    return dict.fromkeys(FREE, words)


_WITHOUT_PROJECT_ID = "QueryProjectIDRequest() was not answered"
_TOO_LITTLE = "answers, but too little to be sure"
_NOT_FOUND = "does not answer in either byte order or transmission mode"
_SENDS_TEXT = "sends text"
_RETURNS = "returns the requests that are sent to it"
_SILENT = "is open, but no board answers"
_LONGER = "ignore_extra=yes"
_NO_SERVOS = "the board has no servos"
_UNCONFIRMED = "a stop was sent 3 times and could not be confirmed"
_NOT_APPLIED = "does not accept action 9"

_TWICE = {"answers_twice": True, "depth": 1}

TABLE: dict[str, Row] = {
    "plain": Row(),
    "big": Row(("byte order",), {"byte_order": "big"}, all_refuse("byte_order=big"), {}),
    "old": Row(("transmission mode",)),
    "old-at-opening": Row(("transmission mode",), {"transmission_mode": 1}),
    "old-slow": Row(("transmission mode",)),
    "big-old": Row(("byte order", "transmission mode"), {"byte_order": "big"}, all_refuse("byte_order=big"), {}),
    "busy": Row((), {"depth": 1}),
    "old-busy": Row(("transmission mode",), {"depth": 1}),
    "late": Row(),
    "very-late": Row((), {"depth": 4}),
    "merging": Row(),
    "halves": Row(),
    "single-bytes": Row((), {"depth": 8}),
    "stalling": Row(("responses",)),
    "echoing": Row(),
    "boot-text": Row(),
    "logging": Row(("text",)),
    "resetting": Row(("absent",)),
    "twice": Row(("answers twice",), _TWICE, all_refuse("use answers_twice=yes"), {}),
    "twice-2": Row(("answers twice",), _TWICE, "use answers_twice=yes", {}),
    "twice-10": Row(("answers twice",), _TWICE, "use answers_twice=yes", {}),
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
        (),
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
    "missing-servo": Row(),
    "wrong-count": Row((), {}, {"info": "5 servo_id_list take 6 bytes"}),
    "singles-only": Row((), {"unsupported": ("QueryServo",)}),
    "no-all": Row((), {"unsupported": ("QueryServo",)}),
    "adc-only": Row((), {}, {"move": "its angles are raw ADC"}),
    "half-project-id": Row(),
    "no-feedback": Row(),
}
