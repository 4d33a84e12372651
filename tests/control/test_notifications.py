"""`servolink.control.notifications` and `status`: what a program decodes, also from a newer hub.

Module: servolink.control.status.
"""

from __future__ import annotations

import msgspec
from msgspec import Struct

from servolink.control.error_codes import ErrorData, ErrorObject
from servolink.control.greeting import Welcome
from servolink.control.notifications import NAMES, NOTIFICATIONS, LeaseNotice
from servolink.control.status import BoardState, HoldStatus, HubStatus, LeaseStatus, ProgramStatus, ServoNow
from tests.tables import over

HEARD = [
    *NOTIFICATIONS.values(),
    *(BoardState, ErrorData, ErrorObject, HoldStatus, HubStatus, LeaseStatus, ProgramStatus, ServoNow, Welcome),
]


@over("kind", HEARD)
def test_a_newer_hub_may_say_more(kind: type[Struct]) -> None:
    assert not kind.__struct_config__.forbid_unknown_fields


def test_unknown_fields_are_ignored_at_any_depth() -> None:
    text = b"""{"event": "new kind", "by": null, "colour": 1,
        "lease": {"session": "s", "who": "ann", "since": 1.5, "dead_man": null, "mood": "good"}}"""
    expected = LeaseNotice("new kind", None, LeaseStatus("s", "ann", 1.5, None))
    assert msgspec.json.decode(text, type=LeaseNotice) == expected


def test_each_notification_has_a_name_of_its_own() -> None:
    assert {NAMES[kind]: kind for kind in NAMES} == NOTIFICATIONS
