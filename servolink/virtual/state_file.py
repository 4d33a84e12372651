"""A virtual board's memory as a file, so that it outlives the program as a real board's flash does.

The contents are written as the requests that would store them again, each a frame in hex: exact to the byte,
protected by the frames' checksums, and readable with `servolink decode`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Self

import msgspec
from msgspec import Meta, Struct

from servolink.errors import PacketError, ServolinkError
from servolink.files import MIB, read_file, reason, write_atomically
from servolink.platforms.locks import open_locked, remove_locked
from servolink.protocol import editing, joystick
from servolink.protocol.frame import HEADER_SIZE, ByteOrder, encode_frame
from servolink.protocol.packet import Packet
from servolink.protocol.record_types import RECORD_TYPES, SERVO_PARAMETER, TABLE
from servolink.virtual.hardware import Hardware
from servolink.virtual.storage import Contents, servo_parameters


class SavedBoard(Struct, frozen=True, forbid_unknown_fields=True):
    """The content of the file."""

    byte_order: ByteOrder
    battery: Annotated[float, Meta(ge=0, le=1000, description="per mille")]
    angles: dict[int, Annotated[float, Meta(ge=-180, le=180, description="degrees")]]
    requests: list[str]


class StateFile:
    """File of one board, locked against other boards of any program until the context ends.

    Two boards would overwrite what the other one stored.
    """

    def __init__(self, board: Hardware, path: Path) -> None:
        """Load `path` as `load_state` does. Raise ServolinkError too if another board uses it."""
        self._board = board
        self._path = path
        target = Path(os.path.realpath(path))
        # Beside the file, which is replaced when it is saved, and a lock would go with the old one.
        self._lock_path = target.with_name(f".{target.name}.servolink-lock") if target.name else target
        try:
            lock = open_locked(self._lock_path)
        except OSError as error:
            load_state(board, path)  # whose error says more for an unusable path
            raise ServolinkError(f"{path}: cannot be locked: {self._lock_path}: {reason(error)}") from error
        if lock is None:
            raise ServolinkError(
                f"{path}: another virtual board uses this file; close that one first. To share one board, run "
                f"`servolink virtual --state {path}` and connect to the address that it prints"
            )
        self._lock = lock
        try:
            load_state(board, path)
        except BaseException:
            self.__exit__()
            raise
        self._contents = board.storage.contents
        self._angles = _angles(board) if path.exists() else None  # None: the file is to be written at the end

    def __enter__(self) -> Self:
        """Return the file."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the file to others."""
        with suppress(OSError):
            remove_locked(self._lock_path, self._lock)

    @property
    def is_outdated(self) -> bool:
        """Whether records, parameters or the project id were changed since they were loaded or last saved."""
        return self._board.storage.contents is not self._contents

    def save(self) -> None:
        """Save the board, unless nothing was stored or moved since. Raise ServolinkError if that fails."""
        angles = _angles(self._board)
        if self.is_outdated or angles != self._angles:
            self._contents, self._angles = self._board.storage.contents, None
            save_state(self._board, self._path)
            self._angles = angles


def save_state(board: Hardware, path: Path) -> None:
    """Write what `board` stores to `path`, whole or not at all. Raise ServolinkError if the file cannot be written."""
    state = SavedBoard(
        byte_order=board.codec.byte_order,
        battery=board.battery,
        angles=_angles(board),
        requests=[frame.hex() for frame in _requests(board)],
    )
    try:
        write_atomically(path, msgspec.json.format(msgspec.json.encode(state), indent=1) + b"\n")
    except OSError as error:
        raise ServolinkError(f"{path}: the board cannot be saved: {reason(error)}") from error


def load_state(board: Hardware, path: Path) -> None:
    """Replace what `board` stores by the content of `path`. No effect if the file does not exist.

    Records are restored as they were, even several under one id and those that a partial write left, whatever options
    this board has. Raise ServolinkError, and leave the board as it was, if the file cannot be read, is not the state of
    a board, or does not fit this board.
    """
    try:
        # In hex a record takes less than three times its size.
        state = msgspec.json.decode(read_file(path, MIB + 4 * board.storage.memory), type=SavedBoard)
    except FileNotFoundError as error:
        if not path.resolve().parent.is_dir():  # where it could not be saved either
            raise ServolinkError(f"{path}: the folder does not exist; create it first") from error
        return
    except OSError as error:
        raise ServolinkError(f"{path}: cannot be read: {reason(error)}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        advice = "give another file (`servolink apply` writes a project file to a board)"
        raise ServolinkError(f"{path}: is not a saved board: {error}; {advice}") from error
    if state.byte_order != board.codec.byte_order:
        raise ServolinkError(
            f"{path}: was saved by a {state.byte_order}-endian board; use --byte-order {state.byte_order}"
        )
    before, board.storage.contents = board.storage.contents, Contents()
    for at, request in enumerate(state.requests):
        if problem := _store(board, request):
            board.storage.contents = before
            raise ServolinkError(f"{path}: requests[{at}]: {problem}")
    board.battery = state.battery
    for servo_id, angle in state.angles.items():
        if (servo := board.servos.get(servo_id)) is not None:
            servo.angle = angle


def _angles(board: Hardware) -> dict[int, float]:
    return {servo.servo_id: servo.angle for servo in board.servos.values()}


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
