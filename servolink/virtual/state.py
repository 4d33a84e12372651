"""A virtual board's memory as a file, so that it outlives the program as a real board's flash does.

What is stored is written as the requests that would store it again, each a frame in hex: exact to the byte,
protected by the frames' checksums, checked on loading by the board itself, and readable with `servolink decode`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from servolink.errors import OpenError, PacketError, ServolinkError
from servolink.printable import printable
from servolink.protocol import editing, joystick
from servolink.protocol.frame import HEADER_SIZE, ByteOrder, encode_frame
from servolink.protocol.packet import Packet, Result
from servolink.virtual.answers import ANSWERS, Asked
from servolink.virtual.board import VirtualBoard
from servolink.virtual.storage import Kind

_STORED: dict[Kind, type[Packet]] = {
    Kind.ACTION: editing.AddActionRequest,
    Kind.MACRO: editing.AddMacroRequest,
    Kind.TABLE: joystick.AddJoystickTableRequest,
}
_REBUILDING: tuple[type[Packet], ...] = (
    editing.WriteProjectIDRequest,
    editing.AddServoParameterRequest,
    joystick.SetActiveJoystickTableRequest,
    *_STORED.values(),
)


class BoardState(Struct, frozen=True, forbid_unknown_fields=True):
    """What the file holds."""

    byte_order: ByteOrder
    battery: Annotated[float, Meta(ge=0, le=1000, description="per mille")]
    angles: dict[int, Annotated[float, Meta(ge=-180, le=180, description="degrees")]]
    requests: list[str]


def save_state(board: VirtualBoard, path: Path) -> None:
    """Write what `board` keeps to `path`, whole or not at all; ServolinkError if the file cannot be written."""
    state = BoardState(
        byte_order=board.codec.byte_order,
        battery=board.battery,
        angles={servo.servo_id: servo.angle for servo in board.servos.values()},
        requests=[frame.hex() for frame in _requests(board)],
    )
    try:
        _replace(path, msgspec.json.format(msgspec.json.encode(state), indent=1) + b"\n")
    except OSError as error:
        raise ServolinkError(f"{printable(str(path))}: the board cannot be saved: {printable(str(error))}") from error


def _replace(path: Path, content: bytes) -> None:
    with NamedTemporaryFile(dir=path.parent, prefix=path.name + ".", delete=False) as file:
        try:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            file.close()
            Path(file.name).replace(path)
        except BaseException:
            file.close()
            Path(file.name).unlink()
            raise


def load_state(board: VirtualBoard, path: Path) -> None:
    """Put what `path` holds into the fresh `board`; nothing if there is no such file.

    OpenError if it cannot be read, is no state of a board, or does not fit this one.
    """
    name = printable(str(path))
    try:
        state = msgspec.json.decode(path.read_bytes(), type=BoardState)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OpenError(f"{name}: cannot be read: {printable(str(error))}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise OpenError(f"{name}: is no saved board: {printable(str(error))}; delete it to begin anew") from error
    if state.byte_order != board.codec.byte_order:
        raise OpenError(f"{name}: was saved by a {state.byte_order}-endian board; use --byte-order {state.byte_order}")
    for at, request in enumerate(state.requests):
        if problem := _store(board, request):
            raise OpenError(f"{name}: requests[{at}]: {problem}")
    board.battery = state.battery
    for servo_id, angle in state.angles.items():
        if (servo := board.servos.get(servo_id)) is not None:
            servo.angle = angle


def _requests(board: VirtualBoard) -> Iterator[bytes]:
    """Yield the frames that rebuild what `board` keeps."""
    codec, storage = board.codec, board.storage
    yield codec.encode(editing.WriteProjectIDRequest(storage.project_id))
    parameters = storage.all(Kind.SERVO)
    content = len(parameters).to_bytes(2, codec.byte_order) + b"".join(parameters.values())
    yield encode_frame(editing.AddServoParameterRequest.packet_id, content, codec.byte_order)
    for kind, declared in _STORED.items():
        for record in storage.all(kind).values():
            yield encode_frame(declared.packet_id, record, codec.byte_order)
    if storage.chosen_table:
        yield codec.encode(joystick.SetActiveJoystickTableRequest(storage.chosen_table))


def _store(board: VirtualBoard, request: str) -> str:
    """Let `board` do one request of a file; return what is wrong with it, empty if it was done."""
    try:
        frame = bytes.fromhex(request)
        packet = board.codec.decode_frame(frame)
    except (PacketError, ValueError) as error:
        return printable(str(error))
    if not isinstance(packet, _REBUILDING):
        return f"{type(packet).__name__} stores nothing"
    session = board.attach(lambda _: None)
    answer = ANSWERS[type(packet)](Asked(session, packet, frame[HEADER_SIZE:-1], now=0.0))
    session.detach()
    if not isinstance(answer, Result) or not answer.result:
        return (
            f"the board refuses this {type(packet).__name__}; it needs more memory or servos, or a value is not allowed"
        )
    return ""
