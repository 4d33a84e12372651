"""`servolink action`, `macro` and `table`: one stored record is shown, added, changed, deleted or run."""

from __future__ import annotations

from servolink.cli.commands import STORED, Command
from servolink.cli.parser import Parser


def _commands(noun: str, plural: str, example: str, content: str, change: str) -> dict[str, Command]:
    """Return the verbs of a noun: `example` describes a new record, and `change` changes one."""

    def command(place: str, text: str, *examples: str) -> Command:
        return Command(STORED, place, text, tuple(f"{noun} {one}" for one in examples), needs_records=True)

    a_noun = f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
    return {
        "list": command("stored.show:configure_list", f"list the {plural} stored on the board", "list"),
        "show": command("stored.show:configure_show", f"show {a_noun} in full", "show 1", "show 1 --json"),
        "add": command(
            f"stored.options:configure_add_{noun}",
            f"store {a_noun}",
            f"add {example}",
            f"add --from robot.servolink.json {content}",
        ),
        "set": command(f"stored.options:configure_set_{noun}", f"change {a_noun}", f"set 1 {change}"),
        "rename": command("stored.options:configure_rename", f"give {a_noun} another caption", "rename 1 Hello"),
        "delete": command("stored.options:configure_delete", f"delete {plural}, after a backup", _DELETED[noun]),
    }


_DELETED = {"action": "delete 2 --yes", "macro": "delete 2 --yes", "table": "delete 1 --yes"}
"""Examples, one for each noun. What something else runs is not deleted."""


def _run(noun: str, text: str) -> Command:
    examples = (f"{noun} run 1", f"{noun} run 1 --start")
    return Command(STORED, "motion.run:configure_stored", text, examples, needs_records=True)


COMMANDS = {
    "action": {
        **_commands("action", "actions", "Wave --pose 1=30,2=-10 --seconds 0.5", "Bow", "--seconds 2"),
        "run": _run("action", "run an action"),
    },
    "macro": {
        **_commands(
            "macro", "macros", "Dance --play action:1,wait:0.5,action:1x3@50", "Greet", "--play action:1,wait:1"
        ),
        "run": _run("macro", "start a macro"),
    },
    "table": {
        **_commands("table", "joystick tables", "Left --press 7=1 --up 8=1", "Pad", "--long-press 3=1"),
        "activate": Command(
            STORED,
            "stored.options:configure_activate",
            "make a joystick table the one that buttons obey",
            ("table activate 1",),
            needs_records=True,
        ),
    },
}
"""By noun: as `servolink.cli.commands.COMMANDS`."""


def configure_action(parser: Parser) -> None:
    """Add the commands of `servolink action`."""
    parser.add_commands(COMMANDS["action"], "verb")


def configure_macro(parser: Parser) -> None:
    """Add the commands of `servolink macro`."""
    parser.add_commands(COMMANDS["macro"], "verb")


def configure_table(parser: Parser) -> None:
    """Add the commands of `servolink table`."""
    parser.add_commands(COMMANDS["table"], "verb")
