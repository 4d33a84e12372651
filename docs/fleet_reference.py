"""docs/reference/fleet.md and its JSON Schema, made from the declarations of topics and payloads."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from msgspec import Struct

from docs.control_interface import anchor_of, section
from servolink.control.messages import Runnable
from servolink.fleet.topics import (
    METHODS,
    SENT,
    Echoed,
    Started,
    StopOver,
    Stored,
    TransferStep,
    needs_pulse,
    schema,
    scope_of,
)
from servolink.hub.methods.control_session import METHODS as HUB_METHODS

_FOLDER = Path(__file__).parent
PAGE = _FOLDER / "reference/fleet.md"
SCHEMA = _FOLDER / "reference/fleet.schema.json"

_INTRODUCTION = """\
# Topics of a fleet

What a board that has [joined a broker](../how-to/fleet.md) sends and takes, for programs in any language. This page
is made from the declarations in `servolink/fleet/topics.py`, as is the [JSON Schema](fleet.schema.json) of all
payloads.

Topics begin with a prefix, `servolink` unless `--prefix` says otherwise. `BOARD` is the name of a board: up to 64
letters, digits, `-` and `_`, of which the first is a letter or a digit. Payloads are JSON in UTF-8; `available` and
`pulse` are plain text.

| topic | payload | QoS | retained |
| --- | --- | --- | --- |
| `servolink/BOARD/available` | `online`, or `offline`: also the last will | 1 | yes |
| `servolink/BOARD/pulse` | a word, new each second | 0 | yes |
{topics}

## Commands

A command is a method of the [control interface](control-interface.md), with the same params and results, and with an
id of its own:

```json
{{"id": "lesson-7", "method": "run", "params": {{"type": "macro", "id": "Wave"}}, "who": "teacher"}}
```

- It is carried out once, however often it is delivered: the id is noted on the disk of the board's machine first. The
  same id with another payload is refused. A refusal is final: send it again with another id.
- It has one result, on `result` of the board, or on the response topic of the message (MQTT 5) if that is
  `servolink/BOARD/result/USER/WORD`, with any `USER` and `WORD`. The topic says which board has answered, as an access
  list lets no other user write there; do not rely on `board` in the payload. Correlation data comes back. Like every
  message with QoS 1, a result may be delivered twice.
- {motion} need a message expiry (MQTT 5), and 60 seconds count at most. What has not begun by then is refused, also
  if it waits because another program has exclusive use of the board. Put the latest word of `pulse` into
  `pulse`: then the board knows how old the command is, even if the network stood still, and refuses a late one.
- {transfers} need both, an expiry and a `pulse`: servos turn when their corrections change.
- Retained commands are refused. Messages of more than 1 MiB are ignored too, and messages beyond
64 in the queue.
- `stop` is always taken. Send it to `servolink/BOARD/stop`, where nothing is before it, or for all boards to
  `servolink/_fleet/stop`, if the access list lets them read that. [The one for a
  classroom](../how-to/fleet-classroom.md#set-up-the-broker) does not.
  What was sent before a stop does not begin after it, if it has a `pulse`; without one, only what the broker had by
  then is known to be older. So put the `pulse` of [the result](#stopover), or a later one, into what you send next.
- Set-points, limits, names, taps, recordings, line tests, the transmission mode, and questions to a person with their
  answers do not come from afar: these methods belong to one program's connection, or to the computer of the board. A
  fleet has the methods {afar}.
- After a crash of the board's machine, the result is OutcomeUnknown: read back before you repeat it.

A fleet adds two methods, by which boards start together: each is asked to `prepare` for an id, and answers when the
run was checked and the board has the lease; a message to `servolink/BOARD/start` with that id starts it at a moment
of its clock, and one to `servolink/_fleet/start` starts all who may read it 0.1 s later. `cancel` gives the lease back.
"""


def fleet_reference() -> str:
    """Return the page, in MyST Markdown."""
    rows = []
    for topic, (payload, qos, retain) in SENT.items():
        name = topic if topic.startswith("_fleet") else f"BOARD/{topic}"
        link = f"[{payload.__name__}](#{payload.__name__.lower()})"
        rows.append(f"| `servolink/{name}` | {link} | {qos} | {'yes' if retain else ''} |")
    scopes = {name: scope for name in (*HUB_METHODS, *METHODS) if (scope := scope_of(name)).from_afar}
    moving = [name for name, scope in scopes.items() if scope.moves]
    page = _INTRODUCTION.format(
        topics="\n".join(rows),
        motion=_listed([name for name in moving if not needs_pulse(scopes[name])]),
        transfers=_listed([name for name in moving if needs_pulse(scopes[name])]),
        afar=_listed(list(scopes)),
    )
    own: dict[str, type[Struct]] = {payload.__name__: payload for payload, _, _ in SENT.values()}
    own |= {params.__name__: params for params, _, _ in METHODS.values()}
    own |= {each.__name__: each for each in (Runnable, Started, StopOver, Echoed, TransferStep, Stored)}
    parts = [page, "## Payloads\n", *(section(name, own[name]) for name in sorted(own))]
    return re.sub(r"\[(\w+)\]\((?:#[\w-]+|project-file\.md)\)", lambda found: _link(found[1], own), "\n".join(parts))


def _link(name: str, own: dict[str, Any]) -> str:
    if name == "ErrorObject":
        return f"[{name}](control-interface.md#errors)"
    return f"[{name}]({f'#{name.lower()}' if name in own else f'control-interface.md#{anchor_of(name)}'})"


def _listed(names: list[str]) -> str:
    return f"{', '.join(f'`{name}`' for name in names[:-1])} and `{names[-1]}`"


def schema_text() -> str:
    """Return the schema."""
    return json.dumps(schema(), indent=2) + "\n"
