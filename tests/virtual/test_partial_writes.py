"""What is left of a torn write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random

import pytest

from servolink.protocol import (
    ACTION,
    HEADER_SIZE,
    MACRO,
    SERVO_PARAMETER,
    STORED_TYPES,
    TABLE,
    AddActionRequest,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    Codec,
    MacroCommand,
    Packet,
    Step,
)
from servolink.protocol import ServoParameter as Parameter
from servolink.virtual.kind import BoardKind
from servolink.virtual.storage import AnyType, Contents, Record, Storage, partial_write

TRIES = 600
"""So many seeds that each state of a write is met."""

PACKETS: dict[AnyType, type[Packet]] = {
    ACTION: AddActionRequest,
    MACRO: AddMacroRequest,
    TABLE: AddJoystickTableRequest,
}


def content(packet: Packet) -> bytes:
    return Codec().encode(packet)[HEADER_SIZE:-1]


def records(number: int) -> dict[AnyType, bytes]:
    """One record of each kind with the id 7; another `number`, others."""
    name = "".join(chr(ord("a") + number + at % 3) for at in range(30))
    parameter = content(AddServoParameterRequest((Parameter(7, number, name),)))[2:]
    return {
        ACTION: content(AddActionRequest(7, name, tuple(Step(at, number, 9) for at in range(4)))),
        MACRO: content(AddMacroRequest(7, name, tuple(MacroCommand(number, loop=at) for at in range(4)))),
        TABLE: content(AddJoystickTableRequest(7, name, tuple(Button(at, name, number) for at in range(4)))),
        SERVO_PARAMETER: parameter,
    }


def outcomes(before: Contents, after: Contents) -> Iterator[Contents]:
    for seed in range(TRIES):
        yield partial_write(before, after, Random(seed), "little")


def storage_with(kind: AnyType, *found: bytes) -> Storage:
    storage = Storage(BoardKind(memory=10_000, on_duplicate="append"))
    for record in found:
        storage.put(kind, {7: record})
    return storage


def is_half(kind: AnyType, torn: bytes, whole: bytes) -> bool:
    """Tell whether `torn` is `whole` without its tail, its id and an honest length left."""
    same = next((at for at, (one, other) in enumerate(zip(torn, whole, strict=False)) if one != other), len(torn))
    if same < (1 if kind is SERVO_PARAMETER else 4):
        return False
    if kind is not SERVO_PARAMETER:
        Codec().decode(PACKETS[kind].packet_id, torn)
    missing = len(torn) < len(whole) or set(torn[same:]) == {0}
    rest = torn[same:] if kind is SERVO_PARAMETER or same >= 38 else torn[same:36] + torn[38:]
    return missing or set(rest) <= {0xFF}


def write(storage: Storage, change: Callable[[Storage], object]) -> tuple[Contents, Contents]:
    before = storage.contents
    change(storage)
    return before, storage.contents


@pytest.mark.parametrize("kind", list(STORED_TYPES))
def test_an_added_record_is_there_or_not_or_without_its_tail(kind: AnyType) -> None:
    whole = records(1)[kind]
    before, after = write(Storage(BoardKind(memory=10_000)), lambda storage: storage.put(kind, {7: whole}))
    seen = {dict(left.records[kind]).get(7) for left in outcomes(before, after)}
    assert {None, whole} < seen
    torn = seen - {None, whole}
    assert len(torn) > 20
    assert all(record is not None and is_half(kind, record, whole) for record in torn)
    lengths = {len(record) for record in torn if record is not None}
    assert lengths == (
        {35} if kind is SERVO_PARAMETER else {len(whole) - at * (len(whole) - 38) // 4 for at in range(5)}
    )


@pytest.mark.parametrize("kind", list(STORED_TYPES))
def test_a_replaced_record_is_old_or_new_or_neither(kind: AnyType) -> None:
    old, new = records(1)[kind], records(5)[kind]
    storage = Storage(BoardKind(memory=10_000))
    storage.put(kind, {7: old})
    before, after = write(storage, lambda storage: storage.put(kind, {7: new}))
    seen = {dict(left.records[kind]).get(7) for left in outcomes(before, after)}
    assert {None, old, new} < seen
    halves = [(is_half(kind, record, old), is_half(kind, record, new)) for record in seen if record]
    assert (True, False) in halves
    assert (False, True) in halves
    assert (False, False) not in halves


def test_a_record_written_anew_with_the_same_bytes_can_tear_too() -> None:
    record = records(1)[ACTION]
    storage = Storage(BoardKind(memory=10_000))
    storage.put(ACTION, {7: record, 8: record})
    before, after = write(storage, lambda storage: storage.put(ACTION, {7: record}))
    seen = [dict(left.records[ACTION]) for left in outcomes(before, after)]
    assert any(left.get(7) is None for left in seen)
    assert all(left[8] == record for left in seen)


def test_a_deleted_record_is_there_or_not_or_half_erased_and_the_others_are_left_alone() -> None:
    first, second = records(1)[ACTION], records(5)[ACTION]
    storage = storage_with(ACTION, first, second)
    before, after = write(storage, lambda storage: storage.delete(ACTION, 7))
    seen = {left.records[ACTION] for left in outcomes(before, after)}
    assert {((7, second),), ((7, first), (7, second))} < seen
    assert all(left[-1] == (7, second) for left in seen)
    assert all(is_half(ACTION, left[0][1], first) for left in seen if len(left) == 2)


def test_of_several_servo_parameters_any_may_be_written_and_one_torn() -> None:
    old = content(AddServoParameterRequest((Parameter(1, -3, "old"),)))[2:]
    new = content(AddServoParameterRequest((Parameter(1, 3, "new"),)))[2:]
    storage = Storage(BoardKind(memory=10_000))
    storage.put(SERVO_PARAMETER, dict.fromkeys(range(1, 6), old))
    before, after = write(storage, lambda storage: storage.put(SERVO_PARAMETER, dict.fromkeys(range(1, 6), new)))
    seen = [dict(left.records[SERVO_PARAMETER]) for left in outcomes(before, after)]
    assert all(sum(left.get(at) not in {old, new} for at in range(1, 6)) <= 1 for left in seen)
    written = {tuple(left.get(at) == new for at in range(1, 6)) for left in seen}
    assert len(written) == 32  # in any order


def test_a_clear_that_breaks_off_leaves_some_records_and_each_word_as_it_was_or_zero() -> None:
    storage = Storage(BoardKind(memory=10_000))
    for kind, record in records(1).items():
        storage.put(kind, dict.fromkeys((5, 7), record))
    storage.project_id = 77
    storage.activate(7)
    before, after = write(storage, Storage.clear)
    left = list(outcomes(before, after))
    counts = [sum(len(stored) for stored in contents.records.values()) for contents in left]
    assert set(counts) == set(range(9))
    whole = {(kind, record) for kind in STORED_TYPES for record in before.records[kind]}
    torn = [{(kind, record) for kind in STORED_TYPES for record in contents.records[kind]} - whole for contents in left]
    assert max(map(len, torn)) == 1
    words = {(contents.project_id, contents.chosen_table) for contents in left}
    assert words == {(77, 7), (77, 0), (0, 7), (0, 0)}


def test_the_project_id_is_the_old_or_the_new_one() -> None:
    storage = storage_with(ACTION, records(1)[ACTION])
    storage.project_id = -2
    before = storage.contents
    storage.project_id = 77
    left = list(outcomes(before, storage.contents))
    assert {contents.project_id for contents in left} == {-2, 77}
    assert all(contents.records == before.records for contents in left)


def test_the_length_is_true_in_both_byte_orders() -> None:
    codec = Codec("big")
    whole = codec.encode(AddActionRequest(7, "a", tuple(Step(at % 200, 1, 1) for at in range(300))))[HEADER_SIZE:-1]
    before, after = write(Storage(BoardKind(memory=10_000)), lambda storage: storage.put(ACTION, {7: whole}))
    for seed in range(50):
        for _, record in partial_write(before, after, Random(seed), "big").records[ACTION]:
            torn = codec.decode(AddActionRequest.packet_id, record)
            assert isinstance(torn, AddActionRequest)
            assert torn.action_id == 7
            assert len(torn.steps) <= 300


def test_the_same_chance_tears_the_same() -> None:
    record: Record = (7, records(1)[MACRO])
    after = Contents({**Contents().records, MACRO: (record,)})
    assert list(outcomes(Contents(), after)) == list(outcomes(Contents(), after))
