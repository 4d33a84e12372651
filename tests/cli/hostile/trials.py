"""How each command is tried with hostile texts in everything that it reads."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Trial:
    """Arguments, with the names of a world in braces (see `World.arguments`), and what becomes of them."""

    pattern: str
    refused: bool = False
    """Hostile texts make it fail, by an error."""
    timed: bool = False
    """How many escapes a terminal gets depends on the time that it takes, or on what is wrong with the texts."""

    def __str__(self) -> str:
        """Return the arguments."""
        return self.pattern


TRIALS: dict[str, tuple[Trial, ...]] = {
    "list": (Trial("list"), Trial("list --probe")),
    "use": (Trial("use mine --yes serial:///dev/{text}"), Trial("use mine --yes virtual://?state={text}")),
    "doctor": (
        Trial("doctor serial:///dev/no{place}"),
        Trial("doctor {few}"),
        Trial("doctor"),
        Trial("use rex {few}"),
        Trial("doctor rex --learn --power-cycled", timed=True),
    ),
    "info": (
        Trial("--url {all} info"),
        Trial("--url serial:///dev/{place} info"),
        Trial("--url replay:///{place} info"),
    ),
    "servos": (Trial("--url {all} servos"), Trial("--url {few} --caption-encoding latin-1 servos")),
    "watch": (
        Trial("--url {few} watch --seconds 0.02 --alarm current_raw>43", timed=True),
        Trial("--url {few} watch 250 --seconds 0.02"),
    ),
    "move": (
        Trial("--url {few} move 1=10 2=-10 --duration 0.05", timed=True),
        Trial("--url {few} move 250=1"),
        Trial("--url {few} move {text}=1"),
        Trial("--url {few} move all=0 --duration 0.05", timed=True),
    ),
    "stop": (Trial("--url {few} stop"),),
    "release": (
        Trial("--url {few} release --yes"),
        Trial("--url {few} release 1 250 --yes"),
        Trial("--url {few} release x{text} --yes"),
    ),
    "run": (
        *(Trial(f"--url {{few}} run {kind} {at}") for kind in ("action", "macro") for at in (1, 8)),
        Trial("--url {few} run action 99"),
        Trial("--url {all} run action x"),
        Trial("--url {few} run macro {text}"),
        Trial("--url {few} run action 1 --start --wait", timed=True),
    ),
    "actions": (
        Trial("--url {all} actions x"),
        Trial("--url {all} actions"),
        *(Trial(f"--url {{few}} actions {at}") for at in (1, 8, 21)),
    ),
    "macros": (Trial("--url {all} macros"), *(Trial(f"--url {{few}} macros {at}") for at in (1, 8, 21))),
    "tables": (Trial("--url {all} tables 1"), *(Trial(f"--url {{few}} tables {at}") for at in ("", 2, 21))),
    "action": (
        Trial("--url {few} action list"),
        Trial("--url {few} action show 8"),
        Trial("--url {few} action add {name} --pose 1=3", refused=True, timed=True),
        Trial("--url {few} action add {{}}", timed=True),
        Trial("--url {few} action add @{noise}"),
        Trial("--url {few} action add {name} --from {other}"),
        Trial("--url {few} action rename 8 wave", timed=True),
        Trial("--url {few} action set 99 --seconds 1", timed=True),
        Trial("--url {few} action delete 8 --yes", timed=True),
    ),
    "macro": (
        Trial("--url {few} macro show 8"),
        Trial("--url {few} macro set 8 --play action:{name}", timed=True),
        Trial("--url {few} macro set 8 --play name:{name}", timed=True),
        Trial("--url {few} macro add x --play wave", timed=True),
        Trial("--url {few} macro delete 99 --yes", timed=True),
        Trial("--url {few} macro rename 8 wave", timed=True),
    ),
    "table": (
        Trial("--url {few} table show 2"),
        Trial("--url {few} table set 2 --press {name}", timed=True),
        Trial("--url {few} table activate 2"),
        Trial("--url {few} table rename 2 wave", timed=True),
    ),
    "board": (
        Trial("use mine virtual://?state={text}"),
        Trial("board set mine --depth 4 --angle 3=0..9"),
        Trial("board"),
        Trial("board show mine"),
        Trial("board show {name}"),
        Trial("board set mine --depth {name}"),
        Trial("board set mine --unsupported {name}"),
        Trial("board set mine --angle {name}"),
        Trial("board set mine --unset {name}"),
        Trial("board forget {name} --yes"),
    ),
    "servo": (
        Trial("--url {few} servo list"),
        Trial("--url {few} servo start {name}"),
        Trial("--url {few} servo hold 1"),
        Trial("--url {few} servo unit 1 adc"),
        Trial("--url {few} servo rename 1 {name}", refused=True, timed=True),
        Trial("--url {few} servo trim 1 +4", timed=True),
    ),
    "request": (
        Trial("--url {few} request {name}"),
        Trial("""--url {few} request {{"QueryActionRequest":{{"action_id":8}}}}"""),
        Trial("""--url {few} request {{"DeleteActionRequest":{{"action_id":8}}}} --yes""", timed=True),
    ),
    "export": (Trial("--url {few} export {new}", timed=True), Trial("--url {few} export {noise}")),
    "plan": (
        Trial("--url {few} plan {allowed}", timed=True),
        Trial("--url virtual://?servos=250 plan {allowed}", timed=True),
        Trial("--url {few} plan {other}", refused=True, timed=True),
        Trial("--url {few} plan {mixed}"),
        Trial("--url {few} plan {noise}"),
    ),
    "apply": (
        Trial("--url {few} apply {allowed} --yes", timed=True),
        Trial("--url {few} apply {other} --yes", refused=True, timed=True),
    ),
    "rollback": (
        Trial("--url {few} apply {allowed} --yes", timed=True),
        Trial("--url {few} rollback --yes", timed=True),
        Trial("--url {few} rollback {other} --yes", timed=True),
        Trial("--url {few} rollback {mixed} --yes"),
    ),
    "backups": (Trial("backups"), Trial("--url {few} apply {allowed} --yes", timed=True), Trial("backups")),
    "project": (
        Trial("project show {project}"),
        *(Trial(f"project show {{other}} action:{at} macro:{at} table:{at}") for at in (1, 7, 8, 20)),
        Trial("project show {other} {name}"),
        Trial("project new {new}"),
        Trial("project new {other}"),
        Trial("project check {allowed} --servos 3 --memory 100 --speed-cap 1"),
        Trial("project check {other} --servos 3 --memory 100 --speed-cap 1", timed=True),
        Trial("project show {few}", timed=True),
        Trial("project check {mixed}"),
        Trial("project check {allowed} --fix"),
        Trial("project preflight {other} --speed-cap 1 --limit 0 5"),
        Trial("project preflight {other} {name} --speed-cap 1"),
        *(Trial(f"project play {{other}} macro:{at} --fast") for at in (1, 7, 8, 20)),
        Trial("project play {other} {name} --board {few} --start", timed=True),
        Trial("project play {allowed} action:1 --board {few} --start", timed=True),
        Trial("project mirror {allowed} action:1 macro:2 --map 1=2,3=4 -o {mirrored}"),
        Trial("project mirror {other} action:1 -o {mirrored} --force", refused=True),
        Trial("project scale-time {allowed} 2 --in-place"),
        Trial("project scale-time {other} 2 {name} -o {scaled}"),
        Trial("project merge {allowed} {allowed} -o {merged}"),
        Trial("project merge {allowed} {other} -o {merged}", refused=True),
        Trial("project rename {allowed} action 1 wave -o {renamed}"),
        Trial("project rename {allowed} action 999 {name} -o {renamed}"),
        Trial("project schema"),
    ),
    "twin": (
        Trial("twin check {body}", timed=True),
        Trial("twin check {body} --macro {name}"),
        Trial("twin check {noise}"),
        Trial("twin soften {body}"),
        Trial("twin soften {other}"),
        Trial("twin model {body}"),
        Trial("twin model {body} -o {missing}/x"),
    ),
    "figure": (
        Trial("figure export {body} {exported}"),
        Trial("figure export {other} {exported} --force"),
        Trial("figure import {noise}"),
        Trial("figure import {missing}/{name}"),
    ),
    "events": (Trial("--url {few} events --seconds 0.02"),),
    "decode": (
        Trial("decode --hex {hex}"),
        Trial("decode --file {stream}"),
        Trial("decode --hex {noise}"),
        Trial("decode --file {noise}"),
        Trial("decode --file {missing}"),
        Trial("decode {name}"),
    ),
    "encode": (Trial("encode {name}"), Trial("encode {{}} {name}")),
    "wireshark": (Trial("wireshark {name}"), Trial("wireshark --caption-encoding {text}")),
    "spy": (
        Trial("spy serial:///dev/{place}"),
        Trial("spy /dev/null/nowhere --record {missing}"),
        Trial("spy {few}"),
    ),
    "record": (
        Trial("--url {few} record {recorded} --seconds 0.02", timed=True),
        Trial("--url {few} record {missing}/{name} --seconds 0.02", timed=True),
        Trial("--url serial:///dev/{place} record {recorded}"),
        Trial("record {noise}"),
        Trial("record --repair {noise}"),
        Trial("record --repair {mcap}"),
    ),
    "show": (
        Trial("show {mcap}", timed=True),
        Trial("show {mcap} --channel packets --problems", timed=True),
        Trial("show {noise}"),
        Trial("show {missing}"),
    ),
    "replay": (
        Trial("replay {mcap} --to virtual"),
        Trial("replay {mcap} --tcp 127.0.0.1:0"),
        Trial("replay {noise} --to virtual"),
        Trial("replay {missing}"),
    ),
    "convert": (
        Trial("convert {mcap} --csv -o {new}"),
        Trial("convert {mcap} --csv -o {new}"),
        Trial("convert {noise} --csv"),
        Trial("convert {noise} --pcap"),
        Trial("convert {mcap} --csv --channel events -o {missing}/x"),
    ),
    "report": (
        Trial("--url {few} report --seconds 0.05 --yes --with-project -o {report}", timed=True),
        Trial("show {report}", timed=True),
        Trial("--url serial:///dev/{place} report --yes --force -o {report}", timed=True),
        Trial("--url {few} report --recording {mcap} --yes --force -o {report}", timed=True),
        Trial("--url {few} report --recording {noise} --yes --force -o {report}"),
    ),
    "studio": (
        Trial("--url serial:///dev/{place} studio --no-browser"),
        Trial("--url serial:///dev/{text} studio --no-browser"),
        Trial("studio --host 0.0.0.0 --no-browser"),
        Trial("studio --demo --no-browser --port {text}"),
        Trial("--url share://{text} studio --no-browser"),
    ),
    "share": (
        Trial("--url serial:///dev/{place} share"),
        Trial("--url serial:///dev/{text} share --tcp 127.0.0.1:0"),
        Trial("--url {few} share --pty {missing}/x"),
        Trial("--url {few} share --pty {noise}"),
        Trial("--url {few} share --status"),
        Trial("share --take rex"),
    ),
    "fleet": (
        Trial("fleet join {text} {few}"),
        Trial("fleet join mqtt://127.0.0.1:1 {text}"),
        Trial("fleet join mqtt://127.0.0.1:1 {few} --policy {noise}"),
        Trial("fleet list --broker {text}"),
        Trial("fleet list --broker mqtt://127.0.0.1:1 --password-file {missing}/{place}"),
        Trial("fleet stop --broker mqtts://127.0.0.1:1 --ca {noise}"),
        Trial("fleet apply {other} --yes --broker mqtt://127.0.0.1:1", refused=True),
        Trial("fleet apply {allowed} --yes --broker mqtt://127.0.0.1:1"),
        Trial("fleet forget {text} --yes --broker mqtt://127.0.0.1:1"),
        Trial("fleet run {text} --broker mqtt://127.0.0.1:1 --groups {noise}"),
    ),
    "virtual": (
        Trial("virtual --tcp 127.0.0.1:0 --state {noise}"),
        Trial("virtual --tcp 127.0.0.1:0 --script {script}"),
        Trial("virtual --tcp 127.0.0.1:0 --script {missing}"),
    ),
    "mcp": (Trial("--url {few} mcp --http {text}"), Trial("--url {few} mcp --speed-cap {text}")),
    "ros2": (Trial("--url {few} ros2 --speed-cap {text}"), Trial("--url {few} ros2 --project {noise}")),
    "foxglove": (Trial("foxglove --recording {missing} --listen {text}"), Trial("foxglove --speed {text}")),
    "bench": (Trial("--url {few} bench --requests 1", timed=True),),
    "trim": (
        Trial("--url {few} trim --set 1=+2 --start", timed=True),
        Trial("--url {few} trim --set x{text}=+2"),
        Trial("--url {few} trim {text}"),
    ),
    "remote": (Trial("--url {few} remote"), Trial("--url {few} remote --table x{text}")),
    "teach": (Trial("--url {few} teach wave 250 --yes"), Trial("--url {few} teach wave --file {mixed} --yes")),
}
"""The trials of each command, in their order; each command has them for itself, in a world of its own."""

EXEMPT = {
    "demo": "reads nothing but its own virtual board, on which it stores its own captions",
    "completion": "reads nothing",
    "help": "reads nothing",
    "firmware": "reads only the image and ranges of pulses, of which tests/firmware/test_install.py refuses others",
    "complete": "leaves out what is hostile; tests/cli/first_steps/test_completion.py has its trials",
}
"""The other commands, and why they have no trials here."""
