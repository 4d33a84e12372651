"""Kinds of boards: each option has its effect, and a wrong one is refused by its name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink import connect
from servolink.errors import InvalidAddress, NotFound, RequestTimeout
from servolink.protocol import (
    ACTION,
    Action,
    AddActionRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    QueryActionRequest,
    QueryActionResponse,
    QueryJoystickTableRequest,
    QueryMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    Step,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from servolink.transports import Address
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind, KindOption
from servolink.virtual.transport import VirtualTransport, from_address
from tests.virtual.host import START, Host
from tests.virtual_time import run

WRONG: dict[str, list[str]] = {
    "mode": ["2", "true", ""],
    "memory": ["-1", "2147483648", "0x10", "x"],
    "memory_unit": ["1000", "0"],
    "memory_reported": ["-1"],
    "on_duplicate": ["update"],
    "clear": ["most"],
    "project_id_bits": ["8", "-16"],
    "unknown_ids": ["none"],
    "unsupported": ["", "QueryMemorySizeRequest", "QueryServo,", "queryservo"],
    "interval_unit": ["0", "1", "nan"],
    "turnaround": ["-0.1", "3601", "nan", "inf", "1s"],
    "write_seconds": ["-1"],
    "clear_seconds": ["-1"],
    "queue": ["-1", "1001", "1.5"],
    "queue_bytes": ["-1", "1048577"],
    "bus_powered": ["yes"],
    "partial_writes": ["2"],
}
RIGHT: dict[str, tuple[str, Any]] = {
    "mode": ("0", 0),
    "memory": ("1000", 1000),
    "memory_unit": ("1024", 1024),
    "memory_reported": ("99", 99),
    "on_duplicate": ("append", "append"),
    "clear": ("records", "records"),
    "project_id_bits": ("16", 16),
    "unknown_ids": ("silent", "silent"),
    "unsupported": ("QueryMemorySize,QueryServo", ("QueryMemorySize", "QueryServo")),
    "interval_unit": ("0.001", 0.001),
    "turnaround": ("0.02", 0.02),
    "write_seconds": ("1", 1.0),
    "clear_seconds": ("30", 30.0),
    "queue": ("0", 0),
    "queue_bytes": ("64", 64),
    "bus_powered": ("1", True),
    "partial_writes": ("1", True),
}


def host(servos: int = 3, **options: Any) -> Host:
    return Host(VirtualBoard(servos, kind=BoardKind(**options)))


def made(**options: object) -> VirtualBoard:
    query = "&".join(f"{name}={value}" for name, value in options.items())
    board = from_address(Address.parse(f"virtual://?{query}")).board
    assert isinstance(board, VirtualBoard)
    return board


def test_the_samples_are_of_all_options() -> None:
    assert [option.name for option in BoardKind.options()] == list(RIGHT) == list(WRONG)


@pytest.mark.parametrize("name", RIGHT)
def test_an_option_of_the_address_is_that_of_the_kind(name: str) -> None:
    text, value = RIGHT[name]
    kind = BoardKind(**{name: value})
    assert kind == msgspec.structs.replace(BoardKind(), **{name: value}) != BoardKind()
    assert made(**{name: text}).kind == kind


@pytest.mark.parametrize(("name", "text"), [(name, text) for name, texts in WRONG.items() for text in texts])
def test_a_wrong_value_is_refused_with_the_option_and_what_it_must_be(name: str, text: str) -> None:
    with pytest.raises(InvalidAddress, match=rf"option {name} must be .*(, not |, and )"):
        made(**{name: text})


def test_a_kind_checks_what_a_program_gives() -> None:
    with pytest.raises(ValueError, match=r"^queue must be an integer from 0 to 1000, not True$"):
        BoardKind(queue=True)
    with pytest.raises(ValueError, match=r"^turnaround must be a number from 0 to 3600, not nan$"):
        BoardKind(turnaround=float("nan"))
    with pytest.raises(ValueError, match="'Fly' is not one"):
        BoardKind(unsupported=("QueryServo", "Fly"))


def test_a_board_in_the_old_protocol_is_silent_until_its_mode_is_set_and_again_after_power_off() -> None:
    old = host(mode=0)
    assert old.tell(QueryServoListRequest()) == []
    assert old.ask(TransmissionModeSettingRequest(1)).result == 1
    assert old.ask(QueryServoListRequest()).servo_id_list == (1, 2, 3)
    old.board.power_cycle(START)
    assert old.tell(QueryServoListRequest()) == []


@pytest.mark.parametrize(
    ("options", "sizes"),
    [
        ({"memory": 2048}, (2000, 2048)),
        ({"memory": 2048, "memory_unit": 1024}, (1, 2)),
        ({"memory": 2048, "memory_reported": 100}, (52, 100)),
        ({"memory": 2048, "memory_reported": 10}, (0, 10)),
        ({"memory": 2048, "memory_reported": 2**31 - 1}, (2**31 - 49, 2**31 - 1)),
        ({"memory": 2048, "memory_unit": 1024, "memory_reported": 2**31 - 1}, (2**31 - 2, 2**31 - 1)),
        ({"memory": 48}, (0, 48)),
    ],
)
def test_memory_is_counted_in_its_unit_and_may_be_a_lie(options: dict[str, Any], sizes: tuple[int, int]) -> None:
    board = host(**options)
    board.store_action(1, (1, 10, 0), (2, 10, 0))  # 38 bytes, and 5 for each step
    answer = board.ask(QueryMemorySizeRequest())
    assert (answer.size, answer.total_size) == sizes


def test_a_lie_about_the_memory_changes_nothing_else() -> None:
    board = host(memory=60, memory_reported=100_000)
    board.store_action(1)
    assert board.ask(AddActionRequest(2)).result == 0


@pytest.mark.parametrize(
    ("bits", "written", "kept"),
    [(32, -5, -5), (32, 70_000, 70_000), (16, 70_000, 4464), (16, -1, 65535), (16, 9, 9), (0, 70_000, 0)],
)
def test_it_keeps_as_many_bits_of_the_project_id_as_it_has(bits: Any, written: int, kept: int) -> None:
    board = host(project_id_bits=bits)
    assert board.ask(WriteProjectIDRequest(written)).result == 1
    assert board.ask(QueryProjectIDRequest()).project_id == kept


def test_a_silent_board_does_not_answer_queries_of_what_does_not_exist() -> None:
    board = host(unknown_ids="silent")
    for query in (QueryActionRequest(7), QueryMacroRequest(7), QueryJoystickTableRequest(7), QueryServoRequest(9)):
        assert board.tell(query) == []
    board.store_action(7)
    assert board.ask(QueryActionRequest(7)).action_id == 7
    assert len(board.ask(QueryServoRequest(3)).servos) == 1
    assert len(board.ask(QueryServoRequest(255)).servos) == 3
    assert host(0, unknown_ids="silent").ask(QueryServoRequest(255)).servos == ()


def test_unsupported_requests_have_no_effect_and_no_answer() -> None:
    board = host(unsupported=("QueryMemorySize", "AddAction", "ExecuteAction"))
    assert board.tell(QueryMemorySizeRequest()) == []
    assert board.tell(AddActionRequest(1)) == []
    board.tell(ExecuteActionRequest((Step(1, 90, 0),)))
    assert board.angle(1, START) != 90
    assert board.ask(QueryActionRequest(1)) == QueryActionResponse(0)


def test_intervals_can_be_in_milliseconds() -> None:
    board = host(interval_unit=0.001)
    board.store_action(1, (2, 90, 1000))
    board.tell(ExecuteActionRequest((Step(1, 90, 1000),)), START)
    board.tell(ExecuteActionExRequest(1), START)
    assert board.angle(1, START + 0.9) < 90
    assert (board.angle(1, START + 1.0), board.angle(2, START + 1.0)) == (90, 90)
    board.store_action(2, (2, 0, 1000))
    board.store_macro(1, *[MacroCommand(action_id) for action_id in (2, 1)])
    board.ask(ExecuteMacroRequest(1), START + 2)
    assert (board.angle(2, START + 3.0), board.angle(2, START + 4.0)) == (0, 90)


async def test_a_client_meets_several_kinds_at_once() -> None:
    url = (
        "virtual://?servos=2&mode=0&byte_order=big&caption_encoding=utf-16-le&memory_unit=1024&project_id_bits=16"
        "&unknown_ids=silent&unsupported=QueryRemainPower&turnaround=0.002&queue=4&patience=0.2"
    )
    async with connect(url) as board:
        await board.add_action(Action(1, "élan"))
        assert (await board.action(1)).action_caption == "élan"
        assert (await board.memory()).total_size == 64
        with pytest.raises(RequestTimeout):
            await board.battery()


def test_captions_are_stored_in_the_encoding_of_the_address() -> None:
    async def main() -> bytes:
        virtual = VirtualBoard(2)
        async with connect(VirtualTransport(virtual), caption_encoding="utf-16-le") as board:
            await board.add_action(Action(1, "ab"))
            with pytest.raises(NotFound):
                await board.run_action(2)
            await board.run_action(1)
        return next(content for _, content in virtual.storage.all(ACTION))

    assert run(main())[4:10] == b"a\0b\0\0\0"


@pytest.mark.parametrize("option", BoardKind.options(), ids=lambda option: option.name)
def test_the_page_describes_every_option(option: KindOption) -> None:
    page = (Path(__file__).parents[2] / "docs/reference/virtual-board.md").read_text(encoding="utf-8")
    flag = "--" + option.name.replace("_", "-") + (f" {option.unit}" if option.unit.isupper() else "")
    default = "" if option.is_flag else f" ({option.default_text})"
    assert f"| `{flag}` | `{option.name}` | {option.allowed} | {option.meaning}{default} |\n" in page


def test_an_unknown_option_is_answered_with_all_options() -> None:
    with pytest.raises(InvalidAddress, match=r"virtual:// has: seed, .*, servos, .*, twin, state; every"):
        from_address(Address.parse("virtual://?kind=late"))
