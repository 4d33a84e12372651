"""Commands about the content of a board: actions, macros, joystick tables and settings of servos."""

from __future__ import annotations

from servolink.cli.command import STORED, Command

ACTION = Command(
    "action",
    STORED,
    help="show, store, change, delete or run one action",
    examples=("action add Wave --pose 1=30,2=-10", "action rename 1 Hello", "action delete 2 --yes"),
    needs_records=True,
)
MACRO = Command(
    "macro",
    STORED,
    help="show, store, change, delete or run one macro",
    examples=("macro add Nod --play action:1,wait:0.5", "macro show 1"),
    needs_records=True,
)
TABLE = Command(
    "table",
    STORED,
    help="show, store, change, delete or activate one joystick table",
    examples=("table add Pad --press 7=1", "table activate 1"),
    needs_records=True,
)
SERVO = Command(
    "servo",
    STORED,
    help="start, hold, release, name and trim servos",
    examples=("servo start 1 2", "servo trim 3 +4", "servo rename 3 hip"),
)

NOUNS = {"action": "actions", "macro": "macros", "table": "joystick tables"}
"""Types of record as named in commands, and the plural of each for people."""


def a(noun: str) -> str:
    """Return `an action`, or the same of another noun."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
