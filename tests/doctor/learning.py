"""Boards to learn, and what is learnt of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from servolink import Action, Macro, MacroCommand, ServoParameter, Step, connect
from servolink.boards import Measured
from servolink.doctor.learn_board import Learnt, learn_by_asking, learn_by_writing
from servolink.doctor.learn_line import SharedTransport
from servolink.doctor.learn_queries import make_contact
from servolink.project import BackupStore
from servolink.protocol import Codec
from servolink.transports import Faults, FaultyTransport, Transport
from servolink.virtual import BoardKind, Contents, VirtualBoard, VirtualTransport
from tests.virtual_time import run

URL = "virtual://bench"
CHINESE = ("挥手", "抬起右腿", "前进")
FULL = BoardKind()
"""A board as the document describes it."""


def described(value: object) -> str | None:
    """Return what a test is called after: what is unusual about a kind of board, or how it encodes."""
    if isinstance(value, BoardKind):
        unusual = [name for name in value.__struct_fields__ if getattr(value, name) != getattr(FULL, name)]
        return ",".join(f"{name}={getattr(value, name)}" for name in unusual) or "full"
    return f"{value.byte_order}-{value.caption_encoding}" if isinstance(value, Codec) else str(value)


def board_of(
    kind: BoardKind = FULL, codec: Codec | None = None, captions: tuple[str, ...] = ("wave", "nod", "bow")
) -> VirtualBoard:
    """Return a board of this kind that has something of everything stored."""
    codec = codec or Codec()
    board = VirtualBoard(servos=4, codec=codec)  # which understands everything, so that it can be filled

    async def fill() -> None:
        async with connect(VirtualTransport(board), byte_order=codec.byte_order) as connected:
            await connected.add_servo_parameters([ServoParameter(2, 3, "")])
        async with connect(
            VirtualTransport(board), byte_order=codec.byte_order, caption_encoding=codec.caption_encoding
        ) as connected:
            for number, caption in enumerate(captions, 1):
                await connected.add_action(Action(number, caption, (Step(1, 10 * number, 50), Step(3, 0, 20))))
            await connected.add_macro(Macro(1, captions[0], (MacroCommand.of(1.0),)))
            await connected.write_project_id(77)

    run(fill())
    found = VirtualBoard(servos=4, codec=codec, kind=kind)
    found.storage.contents = board.storage.contents
    if kind.project_id_bits == 0:
        found.storage.contents = Contents(board.storage.contents.records)
    return found


def learn(
    board: VirtualBoard,
    folder: Path | None = None,
    *,
    faults: Faults | None = None,
    behind: Callable[[Transport], Transport] | None = None,
    clear: bool = False,
    power_cycled: bool = True,
    seed: int = 0,
) -> dict[str, Measured]:
    """Return what is learnt of `board` by asking and, with a `folder` for the backup, by writing, by setting."""

    async def main() -> Learnt:
        transport: Transport = VirtualTransport(board, URL)
        if faults is not None:
            transport = FaultyTransport(transport, faults, seed=seed)
        if behind is not None:
            transport = behind(transport)
        shared = SharedTransport(transport)
        try:
            learnt = await learn_by_asking(shared, await make_contact(shared), power_cycled=power_cycled)
            if folder is not None:
                await learn_by_writing(shared, learnt, BackupStore(folder), clear=clear)
        finally:
            await shared.free()
        return learnt

    return {each.setting: each for each in run(main()).measured}
