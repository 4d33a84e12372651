"""State file of a virtual board, which outlives the program like the flash of a real board.

Contents are written as requests to store the contents again, each as a frame in hex: exact to the byte, protected by
checksums, and readable with `servolink decode`.
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
from servolink.protocol import (
    RECORD_TYPES,
    SERVO_PARAMETER,
    TABLE,
    AddServoParameterRequest,
    ByteOrder,
    FrameAt,
    Packet,
    SetActiveJoystickTableRequest,
    WriteProjectIDRequest,
    encode_frame,
)
from servolink.support import MIB, LockedFile, read_file, reason, write_atomically
from servolink.virtual.hardware import Hardware
from servolink.virtual.storage import Contents, servo_parameters


class SavedBoard(Struct, frozen=True, forbid_unknown_fields=True):
    """Content of a state file."""

    byte_order: ByteOrder
    battery: Annotated[float, Meta(ge=0, le=1000, description="per mille")]
    angles: dict[int, Annotated[float, Meta(ge=-180, le=180, description="degrees")]]
    requests: list[str]


class StateFile:
    """State file of one board, locked against other boards of any program until the context ends.

    Without the lock, two boards would overwrite the contents of each other.
    """

    def __init__(self, board: Hardware, path: Path) -> None:
        """Load `path` as `load_state` does. Raise ServolinkError also for a file used by another board."""
        self._board = board
        self._path = path
        target = Path(os.path.realpath(path))
        # A separate lock file, because saving replaces the state file.
        self._lock_path = target.with_name(f".{target.name}.servolink-lock") if target.name else target
        try:
            lock = LockedFile.open(self._lock_path)
        except OSError as error:
            load_state(board, path)  # the error of `load_state` is better for an unusable path
            raise ServolinkError(f"{path}: cannot be locked: {self._lock_path}: {reason(error)}") from error
        if lock is None:
            raise ServolinkError(
                f"{path}: another virtual board uses this file; close the other board first. To share a board, run "
                f"`servolink virtual --state {path}` and connect to the printed address"
            )
        self._lock = lock
        try:
            load_state(board, path)
        except BaseException:
            self.__exit__()
            raise
        self._contents = board.storage.contents
        self._angles = _angles(board) if path.exists() else None  # None: the file must be written at the end

    def __enter__(self) -> Self:
        """Return the locked file."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the lock of the file."""
        with suppress(OSError):
            self._lock.remove()

    @property
    def is_outdated(self) -> bool:
        """Whether records, parameters or the project id have changed since loading or the last saving."""
        return self._board.storage.contents is not self._contents

    def save(self) -> None:
        """Save the board, unless nothing was stored or moved since. Raise ServolinkError for a failure."""
        angles = _angles(self._board)
        if self.is_outdated or angles != self._angles:
            self._contents, self._angles = self._board.storage.contents, None
            save_state(self._board, self._path)
            self._angles = angles


def save_state(board: Hardware, path: Path) -> None:
    """Write the storage of `board` to `path` atomically. Raise ServolinkError if the file cannot be written."""
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
    """Replace the storage of `board` with the content of `path`. No effect for a missing file.

    Records are restored exactly, even several under the same id and parts left by an interrupted write, regardless of
    the options of the board.

    Raises:
        ServolinkError: The file is unreadable, not the state of a board, or does not fit the board, which is unchanged.

    """
    try:
        # In hex a record takes less than three times the size.
        state = msgspec.json.decode(read_file(path, MIB + 4 * board.storage.memory), type=SavedBoard)
    except FileNotFoundError as error:
        if not path.resolve().parent.is_dir():  # saving would fail as well
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
    """Yield frames of requests to restore the storage of `board`."""
    codec, storage = board.codec, board.storage
    yield codec.encode(WriteProjectIDRequest(storage.project_id))
    parameters = storage.servo_content(codec.byte_order)
    yield encode_frame(SERVO_PARAMETER.add_class.packet_id, parameters, codec.byte_order)
    for record_type in RECORD_TYPES:
        for _, record in storage.all(record_type):
            yield encode_frame(record_type.add_class.packet_id, record, codec.byte_order)
    chosen = storage.contents.chosen_table
    if chosen and storage.get(TABLE, chosen) is not None:  # an interrupted deletion of the table may leave the id
        yield codec.encode(SetActiveJoystickTableRequest(chosen))


def _store(board: Hardware, request: str) -> str:
    """Execute a request of a state file; return the reason for a failure, empty for success."""
    try:
        frame = bytes.fromhex(request)
        packet = board.codec.decode_frame(frame)
    except (PacketError, ValueError) as error:
        return str(error)
    stored = _carry_out(board, packet, FrameAt(packet.packet_id, len(frame), frame).content)
    if stored is None:
        return f"{type(packet).__name__} stores nothing"
    return "" if stored else f"this {type(packet).__name__} needs more memory or servos, or a missing table"


def _carry_out(board: Hardware, packet: Packet, content: bytes) -> bool | None:
    """Execute a request; return False if the board cannot store the content, None for a request that stores nothing."""
    storage = board.storage
    for record_type in RECORD_TYPES:
        if isinstance(packet, record_type.add_class):
            return storage.put(record_type, {record_type.id_of(packet): content}, on_duplicate="append")
    match packet:
        case WriteProjectIDRequest():
            storage.project_id = packet.project_id
            return True
        case AddServoParameterRequest():
            parameters = servo_parameters(packet, content)
            return parameters.keys() <= board.servos.keys() and storage.put(SERVO_PARAMETER, parameters)
        case SetActiveJoystickTableRequest():
            return storage.activate(packet.table_id)
        case _:
            return None
