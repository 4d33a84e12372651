"""The table of commands: where each stands in the help, where its code is, and how it is used."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from dataclasses import dataclass

FIRST_STEPS = "first steps"
MOVE = "move"
RECORDINGS = "recordings"
STORED = "what is stored"
PROJECTS = "projects"
TOGETHER = "together"
DEVELOPERS = "for developers"

TOPICS = (FIRST_STEPS, MOVE, STORED, PROJECTS, TOGETHER, RECORDINGS, DEVELOPERS)
"""In the order of `servolink --help`."""


PATIENCE = "3"
"""The seconds of `--timeout` of most commands if they are not given."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command."""

    topic: str
    place: str
    """Module below `servolink.cli` and its function, which adds the options to a parser and sets the default `run`."""
    help: str
    examples: tuple[str, ...] = ()
    """What may be typed after `servolink`, each on a board of its own; a test runs all of them on virtual boards."""
    takes_board: bool = True
    """Whether it has the option `--board`."""
    patience: str = PATIENCE
    """The seconds of its own option `--timeout` if they are not given."""
    needs_records: bool = False
    """Whether its examples need something stored on the board."""


def late(place: str) -> Callable[[argparse.Namespace], int]:
    """Return the function `place` (as `Command.place`) that runs a command; its module is imported when it runs."""
    module, _, function = place.partition(":")

    def run(args: argparse.Namespace) -> int:
        return int(getattr(importlib.import_module(f"servolink.cli.{module}"), function)(args))

    return run


COMMANDS = {
    "demo": Command(
        FIRST_STEPS,
        "developers.demo:configure",
        "show all of it on a virtual board, in about 10 seconds",
        ("demo", "demo --json"),
        takes_board=False,
    ),
    "list": Command(
        FIRST_STEPS,
        "boards.find:configure_list",
        "list the boards that are connected to this computer",
        ("list", "list --probe"),
        takes_board=False,
    ),
    "use": Command(
        FIRST_STEPS,
        "boards.find:configure_use",
        "give a board a name, for --board and for programs",
        ("use left-arm virtual://", "use --list", "use --remove left-arm"),
        takes_board=False,
    ),
    "doctor": Command(
        FIRST_STEPS,
        "boards.doctor:configure",
        "find out why a board does not work, and learn what it does",
        ("doctor", "doctor virtual://"),
        patience="about 0.5",
    ),
    "studio": Command(
        FIRST_STEPS,
        "together.studio:configure",
        "see and move the robot in the browser",
        ("studio", "studio --demo", "studio --no-browser --port 8765"),
    ),
    "move": Command(
        MOVE,
        "motion.move:configure_move",
        "move servos to angles",
        ("move 1=90 2=-45", "move 1=30 --speed 20 --no-wait", "move 1=80 --limit -90 90 --duration 0.5"),
    ),
    "stop": Command(MOVE, "motion.move:configure_stop", "stop all servos and keep holding them", ("stop",)),
    "release": Command(
        MOVE, "motion.move:configure_release", "let servos go limp", ("release --yes", "release 1 2 --yes --json")
    ),
    "run": Command(
        MOVE,
        "motion.run:configure",
        "run an action or a macro stored on the board",
        ("run action 1", "run macro 1 --start --wait"),
        needs_records=True,
    ),
    "watch": Command(
        MOVE,
        "motion.watch:configure",
        "show all servos live, with alarms and a file for spreadsheets",
        (
            "watch --seconds 2",
            "watch 1 2 --hz 50 --seconds 1 --json",
            "watch --alarm 'current_raw>800 for 0.5s' --seconds 1",
        ),
    ),
    "servos": Command(
        MOVE,
        "motion.servos:configure",
        "show angle, current and temperature of each servo",
        ("servos", "servos --adc", "servos --json"),
    ),
    "teach": Command(
        MOVE,
        "motion.teach:configure",
        "record poses of limbs that are moved by hand",
        ("teach Wave 1 2", "teach Nod --file robot.servolink.json --interval 0.5"),
    ),
    "trim": Command(
        MOVE,
        "motion.trim:configure",
        "nudge servos until they stand right, and store their corrections",
        ("trim --set 3=+4", "trim --set 1=-2 --set 2=+1 --json"),
    ),
    "remote": Command(
        MOVE,
        "motion.remote:configure",
        "press the buttons of a joystick table by keys",
        ("remote", "remote --table 1 --speed-cap 90"),
        needs_records=True,
    ),
    "events": Command(
        MOVE,
        "motion.events:configure",
        "show button events as they come",
        ("events --seconds 2", "events --seconds 1 --json"),
    ),
    "info": Command(
        STORED,
        "boards.find:configure_info",
        "show project id, memory, battery and what is stored on the board",
        ("info", "info --json", "info --timeout 10"),
    ),
    "action": Command(
        STORED,
        "stored:configure_action",
        "show, store, change, delete or run one action",
        ("action add Wave --pose 1=30,2=-10", "action rename 1 Hello", "action delete 2 --yes"),
        needs_records=True,
    ),
    "macro": Command(
        STORED,
        "stored:configure_macro",
        "show, store, change, delete or run one macro",
        ("macro add Nod --play action:1,wait:0.5", "macro show 1"),
        needs_records=True,
    ),
    "table": Command(
        STORED,
        "stored:configure_table",
        "show, store, change, delete or activate one joystick table",
        ("table add Pad --press 7=1", "table activate 1"),
        needs_records=True,
    ),
    "servo": Command(
        STORED,
        "stored.servo:configure",
        "start, hold, release, name and trim servos",
        ("servo start 1 2", "servo trim 3 +4", "servo rename 3 hip"),
    ),
    "actions": Command(
        STORED,
        "stored.show:configure",
        "list the actions stored on the board, or show one",
        ("actions", "actions 1"),
        needs_records=True,
    ),
    "macros": Command(
        STORED,
        "stored.show:configure",
        "list the macros stored on the board, or show one",
        ("macros", "macros 1"),
        needs_records=True,
    ),
    "tables": Command(
        STORED,
        "stored.show:configure",
        "list the joystick tables stored on the board, or show one",
        ("tables", "tables 1"),
        needs_records=True,
    ),
    "board": Command(
        STORED,
        "boards.board:configure",
        "show and set what a board is, does and is known to be",
        ("board", "board show rex"),
        takes_board=False,
    ),
    "export": Command(
        PROJECTS,
        "projects.export:configure_export",
        "write everything on the board into a project file",
        ("export robot.servolink.json", "export robot.servolink.json --yes"),
    ),
    "plan": Command(
        PROJECTS,
        "projects.plan:configure",
        "show what a project file would change on the board",
        ("plan robot.servolink.json", "plan robot.servolink.json --replace --json"),
    ),
    "apply": Command(
        PROJECTS,
        "projects.apply:configure_apply",
        "make the board hold what a project file holds, after a backup",
        ("apply robot.servolink.json --yes", "apply robot.servolink.json --replace --yes"),
    ),
    "rollback": Command(
        PROJECTS,
        "projects.apply:configure_rollback",
        "bring back what was on the board before the last import",
        ("rollback --yes",),
        needs_records=True,
    ),
    "backups": Command(
        PROJECTS,
        "projects.export:configure_backups",
        "list what was on boards before imports",
        ("backups", "backups --json"),
        takes_board=False,
    ),
    "project": Command(
        PROJECTS,
        "projects:configure",
        "show, check, edit and play projects in files, without a board",
        ("project new arm.servolink.json --servos 6", "project show robot.servolink.json"),
        takes_board=False,
    ),
    "share": Command(
        TOGETHER,
        "together.share:configure",
        "share one board among programs that use it at the same time",
        ("share", "share --name rex --tcp 127.0.0.1:0", "share --name rex --watch-tcp 127.0.0.1:0"),
    ),
    "fleet": Command(
        TOGETHER,
        "fleet.broker:configure",
        "see and command many boards, through an MQTT broker",
        ("fleet list", "fleet run Wave --on all", "fleet stop"),
        takes_board=False,
    ),
    "record": Command(
        RECORDINGS,
        "recordings.record:configure",
        "record what happens on a board, beside other programs too",
        (
            "record out.mcap --seconds 2",
            "record out.mcap --hz 50 --seconds 1 --json",
            "record out.mcap --seconds 1 --wire",
        ),
    ),
    "show": Command(
        RECORDINGS,
        "recordings.show:configure",
        "tell what happened in a recording, and what went wrong",
        ("show out.mcap", "show out.mcap --problems", "show out.mcap --from 2 --to 5 --servo 3 --json"),
        takes_board=False,
    ),
    "replay": Command(
        RECORDINGS,
        "recordings.replay:configure",
        "be the board of a recording, or move a virtual robot",
        ("replay out.mcap --to virtual --speed 2", "replay out.mcap", "replay out.mcap --tcp 127.0.0.1:7878"),
        takes_board=False,
    ),
    "convert": Command(
        RECORDINGS,
        "recordings.convert:configure",
        "write a recording in the form of other tools",
        ("convert out.mcap --csv", "convert out.mcap --csv --channel servos -o servos.csv", "convert out.mcap --pcap"),
        takes_board=False,
    ),
    "report": Command(
        RECORDINGS,
        "recordings.report:configure",
        "write one file for a bug report, with nothing private in it",
        ("report --yes --seconds 1", "report --recording out.mcap --yes -o bug.zip"),
    ),
    "virtual": Command(
        DEVELOPERS,
        "developers.virtual:configure",
        "serve a virtual board over a pseudo-terminal, TCP or USB/IP",
        ("virtual", "virtual --tcp 127.0.0.1:7878 --servos 4", "virtual --state arm.state --faults drop=0.01"),
        takes_board=False,
    ),
    "request": Command(
        DEVELOPERS,
        "developers.packets:configure_request",
        "send one packet of the protocol and print the response",
        (
            """request '{"QueryServoRequest": {"servo_id": 1}}'""",
            """request '{"DeleteActionRequest": {"action_id": 2}}' --yes""",
        ),
        needs_records=True,
    ),
    "decode": Command(
        DEVELOPERS,
        "developers.packets:configure_decode",
        "turn frames into readable packets",
        ("decode 134c051d344e0100070b",),
        takes_board=False,
    ),
    "encode": Command(
        DEVELOPERS,
        "developers.packets:configure_encode",
        "turn packets into frames",
        ("""encode '{"packet":"QueryServoRequest","fields":{"servo_id":7}}'""",),
        takes_board=False,
    ),
    "spy": Command(
        DEVELOPERS,
        "developers.spy:configure",
        "look on while another program uses a board, and learn from it",
        ("spy /dev/ttyACM0 --pty /tmp/board", "spy COM3 --tcp 127.0.0.1:7878 --record out.mcap"),
        takes_board=False,
    ),
    "wireshark": Command(
        DEVELOPERS,
        "developers.wireshark:configure",
        "print or install a dissector with which Wireshark reads packets",
        ("wireshark --install", "wireshark --byte-order big --caption-encoding big5"),
        takes_board=False,
    ),
    "bench": Command(
        DEVELOPERS,
        "developers.bench:configure",
        "measure round trips to the board",
        ("bench", "bench --requests 20 --json"),
    ),
    "completion": Command(
        DEVELOPERS,
        "developers.completion:configure",
        "print a script that completes commands in bash, zsh or fish",
        ("completion bash", "completion fish"),
        takes_board=False,
    ),
}
"""Command name to command, in the order of the help."""
