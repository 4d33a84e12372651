"""Starting of the servos of a run, so that a board whose servos are stopped or released moves with the others."""

from __future__ import annotations

from typing import Any

from servolink.client import collect
from servolink.control import Runnable, ServoList
from servolink.errors import ServolinkError
from servolink.fleet.controller import Controller
from servolink.fleet.pending_command import result_as
from servolink.protocol import ACTION, MACRO, RecordType, record_from_json


async def start_servos(controller: Controller, board: str, run: Runnable, pulse: str | None) -> None:
    """Start and hold the stopped and released servos that a run moves on a board.

    `pulse` is the word of the board when the run was asked for: after a stop since then, no servo is started. Raise the
    error of the board, also if the board does not allow `move` from afar, and ServolinkError without a word.
    """
    if pulse is None:
        raise ServolinkError(f"{board}: no servo was started, as its pulse has not come; try again in a moment")

    async def get(kind: RecordType[Any], record_id: int | str) -> Any:
        found = await controller.call(board, "records.get", {"type": kind.label, "id": record_id})
        record = result_as(board, found, dict[str, Any]).get("record")
        return record_from_json(kind.record_class, record, unchecked=True)

    kind: RecordType[Any] = ACTION if run.type == "action" else MACRO
    stored = await collect(get, kind, kind.id_of(await get(kind, run.id)))
    moved = {step.servo_id for action in stored.actions for step in action.steps}
    servos = result_as(board, await controller.call(board, "servos.list"), ServoList).servos
    for servo in servos:
        if servo.servo_id in moved and not (servo.is_start and servo.is_hold):
            params = {"servo": servo.servo_id, "start": True, "hold": True}
            await controller.call(board, "servo.set", params, pulse=pulse)
