"""A virtual board's memory as a file, so that it outlives the program as a real board's flash does.

The contents are written as the requests that would store them again, each a frame in hex: exact to the byte,
protected by the frames' checksums, and readable with `servolink decode`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from servolink.errors import OpenError, PacketError, ServolinkError
from servolink.files import MIB, read_file, reason, write_atomically
from servolink.protocol import editing, joystick
from servolink.protocol.frame import HEADER_SIZE, ByteOrder, encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.record_types import RECORD_TYPES, SERVO_PARAMETER, TABLE
from servolink.virtual.hardware import Hardware
from servolink.virtual.storage import Contents, servo_parameters


class BoardState(Struct, frozen=True, forbid_unknown_fields=True):
    """The content of the file."""

    byte_order: ByteOrder
    battery: Annotated[float, Meta(ge=0, le=1000, description="per mille")]
    angles: dict[int, Annotated[float, Meta(ge=-180, le=180, description="degrees")]]
    requests: list[str]


def save_state(board: Hardware, path: Path) -> None:
    """Write what `board` stores to `path`, whole or not at all. Raise ServolinkError if the file cannot be written."""
    state = BoardState(
        byte_order=board.codec.byte_order,
        battery=board.battery,
        angles={servo.servo_id: servo.angle for servo in board.servos.values()},
        requests=[frame.hex() for frame in _requests(board)],
    )
    try:
        write_atomically(path, msgspec.json.format(msgspec.json.encode(state), indent=1) + b"\n")
    except OSError as error:
        raise ServolinkError(f"{path}: the board cannot be saved: {reason(error)}") from error


def load_state(board: Hardware, path: Path) -> None:
    """Replace what `board` stores by the content of `path`. No effect if the file does not exist.

    Records are restored as they were, even several under one id and those that a partial write left, whatever options
    this board has. Raise OpenError, and leave the board as it was, if the file cannot be read, is not the state of a
    board, or does not fit this board.
    """
    try:
        # In hex a record takes less than three times its size.
        state = msgspec.json.decode(read_file(path, MIB + 4 * board.storage.memory), type=BoardState)
    except FileNotFoundError as error:
        if not path.resolve().parent.is_dir():  # where it could not be saved either
            raise OpenError(f"{path}: the folder does not exist; create it first") from error
        return
    except OSError as error:
        raise OpenError(f"{path}: cannot be read: {reason(error)}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise OpenError(f"{path}: is not a saved board: {error}; delete it to start over") from error
    if state.byte_order != board.codec.byte_order:
        raise OpenError(f"{path}: was saved by a {state.byte_order}-endian board; use --byte-order {state.byte_order}")
    before, board.storage.contents = board.storage.contents, Contents()
    for at, request in enumerate(state.requests):
        if problem := _store(board, request):
            board.storage.contents = before
            raise OpenError(f"{path}: requests[{at}]: {problem}")
    board.battery = state.battery
    for servo_id, angle in state.angles.items():
        if (servo := board.servos.get(servo_id)) is not None:
            servo.angle = angle


def _requests(board: Hardware) -> Iterator[bytes]:
    """Yield the frames that restore what `board` stores."""
    codec, storage = board.codec, board.storage
    yield codec.encode(editing.WriteProjectIDRequest(storage.project_id))
    parameters = storage.servo_content(codec.byte_order)
    yield encode_frame(SERVO_PARAMETER.add_class.packet_id, parameters, codec.byte_order)
    for record_type in RECORD_TYPES:
        for _, record in storage.all(record_type):
            yield encode_frame(record_type.add_class.packet_id, record, codec.byte_order)
    chosen = storage.contents.chosen_table
    if chosen and storage.get(TABLE, chosen) is not None:  # an interrupted deletion of the table may leave its id
        yield codec.encode(joystick.SetActiveJoystickTableRequest(chosen))


def _store(board: Hardware, request: str) -> str:
    """Store what one request of a file stores; return what is wrong with it, empty if nothing is."""
    try:
        frame = bytes.fromhex(request)
        packet = board.codec.decode_frame(frame)
    except (PacketError, ValueError) as error:
        return str(error)
    stored = _carry_out(board, packet, frame[HEADER_SIZE:-1])
    if stored is None:
        return f"{type(packet).__name__} stores nothing"
    return "" if stored else f"this {type(packet).__name__} needs more memory or servos, or a table that is not stored"


def _carry_out(board: Hardware, packet: Packet, content: bytes) -> bool | None:
    """Carry out a request; return False if the board cannot store its content, None if it stores nothing."""
    storage = board.storage
    for record_type in RECORD_TYPES:
        if isinstance(packet, record_type.add_class):
            return storage.put(record_type, {record_type.id_of(packet): content}, on_duplicate="append")
    match packet:
        case editing.WriteProjectIDRequest():
            storage.project_id = packet.project_id
            return True
        case editing.AddServoParameterRequest():
            parameters = servo_parameters(packet, content)
            return parameters.keys() <= board.servos.keys() and storage.put(SERVO_PARAMETER, parameters)
        case joystick.SetActiveJoystickTableRequest():
            return storage.activate(packet.table_id)
        case _:
            return None
