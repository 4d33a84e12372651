"""A virtual board's memory as a file, so that it outlives the program as a real board's flash does.

What is stored is written as the requests that would store it again, each a frame in hex: exact to the byte,
protected by the frames' checksums, and readable with `servolink decode`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from servolink.errors import OpenError, PacketError, ServolinkError
from servolink.escaping import escape
from servolink.files import MIB, read_file, reason, write_atomically
from servolink.protocol import editing, joystick
from servolink.protocol.frame import HEADER_SIZE, ByteOrder, encode_frame
from servolink.protocol.packet import Packet
from servolink.virtual.handlers import cut_parameters
from servolink.virtual.hardware import Hardware
from servolink.virtual.storage import Contents, Kind

_STORED: dict[Kind, type[Packet]] = {
    Kind.ACTION: editing.AddActionRequest,
    Kind.MACRO: editing.AddMacroRequest,
    Kind.TABLE: joystick.AddJoystickTableRequest,
}


class BoardState(Struct, frozen=True, forbid_unknown_fields=True):
    """What the file holds."""

    byte_order: ByteOrder
    battery: Annotated[float, Meta(ge=0, le=1000, description="per mille")]
    angles: dict[int, Annotated[float, Meta(ge=-180, le=180, description="degrees")]]
    requests: list[str]


def save_state(board: Hardware, path: Path) -> None:
    """Write what `board` keeps to `path`, whole or not at all; ServolinkError if the file cannot be written."""
    state = BoardState(
        byte_order=board.codec.byte_order,
        battery=board.battery,
        angles={servo.servo_id: servo.angle for servo in board.servos.values()},
        requests=[frame.hex() for frame in _requests(board)],
    )
    try:
        write_atomically(path, msgspec.json.format(msgspec.json.encode(state), indent=1) + b"\n")
    except OSError as error:
        raise ServolinkError(f"{escape(str(path))}: the board cannot be saved: {escape(str(error))}") from error


def load_state(board: Hardware, path: Path) -> None:
    """Put what `path` holds into `board`, in place of what it keeps; nothing if there is no such file.

    Records come back as they were, doubles and torn ones too, whatever this board does with such. OpenError if the file
    cannot be read, is no state of a board, or does not fit this one, which is then as it was.
    """
    name = escape(str(path))
    try:
        # In hex a record takes less than three times its size.
        state = msgspec.json.decode(read_file(path, MIB + 4 * board.storage.memory), type=BoardState)
    except FileNotFoundError as error:
        if not path.resolve().parent.is_dir():  # where it could not be saved either
            raise OpenError(f"{name}: there is no such folder; make it first") from error
        return
    except OSError as error:
        raise OpenError(f"{name}: cannot be read: {reason(error)}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise OpenError(f"{name}: is no saved board: {escape(str(error))}; delete it to begin anew") from error
    if state.byte_order != board.codec.byte_order:
        raise OpenError(f"{name}: was saved by a {state.byte_order}-endian board; use --byte-order {state.byte_order}")
    before, board.storage.contents = board.storage.contents, Contents()
    for at, request in enumerate(state.requests):
        if problem := _store(board, request):
            board.storage.contents = before
            raise OpenError(f"{name}: requests[{at}]: {problem}")
    board.battery = state.battery
    for servo_id, angle in state.angles.items():
        if (servo := board.servos.get(servo_id)) is not None:
            servo.angle = angle


def _requests(board: Hardware) -> Iterator[bytes]:
    """Yield the frames that rebuild what `board` keeps."""
    codec, storage = board.codec, board.storage
    yield codec.encode(editing.WriteProjectIDRequest(storage.project_id))
    parameters = [record for _, record in storage.all(Kind.SERVO)]
    content = len(parameters).to_bytes(2, codec.byte_order) + b"".join(parameters)
    yield encode_frame(editing.AddServoParameterRequest.packet_id, content, codec.byte_order)
    for kind, declared in _STORED.items():
        for _, record in storage.all(kind):
            yield encode_frame(declared.packet_id, record, codec.byte_order)
    chosen = storage.contents.chosen_table
    if chosen and storage.get(Kind.TABLE, chosen) is not None:  # its number outlives a table whose deletion was torn
        yield codec.encode(joystick.SetActiveJoystickTableRequest(chosen))


def _store(board: Hardware, request: str) -> str:
    """Let `board` keep what one request of a file says; return what is wrong with it, empty if nothing is."""
    try:
        frame = bytes.fromhex(request)
        packet = board.codec.decode_frame(frame)
    except (PacketError, ValueError) as error:
        return escape(str(error))
    kept = _kept(board, packet, frame[HEADER_SIZE:-1])
    if kept is None:
        return f"{type(packet).__name__} stores nothing"
    return "" if kept else f"this {type(packet).__name__} needs more memory or servos, or what is not stored"


def _kept(board: Hardware, packet: Packet, content: bytes) -> bool | None:
    """Keep the content of a request; False if it does not fit the board, None if it is nothing to be kept."""
    storage = board.storage
    match packet:
        case editing.WriteProjectIDRequest():
            storage.project_id = packet.project_id
            return True
        case editing.AddServoParameterRequest():
            parameters = cut_parameters(packet, content)
            return parameters.keys() <= board.servos.keys() and storage.put(Kind.SERVO, parameters)
        case editing.AddActionRequest():
            return storage.put(Kind.ACTION, {packet.action_id: content}, on_duplicate="append")
        case editing.AddMacroRequest():
            return storage.put(Kind.MACRO, {packet.macro_id: content}, on_duplicate="append")
        case joystick.AddJoystickTableRequest():
            return storage.put(Kind.TABLE, {packet.table_id: content}, on_duplicate="append")
        case joystick.SetActiveJoystickTableRequest():
            return storage.activate(packet.table_id)
        case _:
            return None
