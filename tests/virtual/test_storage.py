"""What fits into the memory, and what is there afterwards."""

from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.protocol import ACTION, MACRO, SERVO_PARAMETER, STORED_TYPES, TABLE
from servolink.virtual.kind import BoardKind, OnDuplicate
from servolink.virtual.storage import AnyType, Contents, Storage


def test_what_was_put_is_there_until_it_is_deleted() -> None:
    storage = Storage(BoardKind(memory=100))
    assert storage.put(ACTION, {7: b"seven"})
    assert storage.get(ACTION, 7) == b"seven"
    assert storage.get(MACRO, 7) is None
    assert storage.free == 95
    assert storage.delete(ACTION, 7)
    assert not storage.delete(ACTION, 7)
    assert storage.get(ACTION, 7) is None
    assert storage.free == 100


def test_the_same_id_replaces_and_only_the_difference_counts() -> None:
    storage = Storage(BoardKind(memory=10))
    assert storage.put(MACRO, {1: b"12345678"})
    assert storage.put(MACRO, {1: b"1234567890"})
    assert storage.free == 0
    assert not storage.put(MACRO, {1: b"12345678901"})
    assert storage.get(MACRO, 1) == b"1234567890"


def test_of_several_records_all_are_stored_or_none() -> None:
    storage = Storage(BoardKind(memory=10))
    assert not storage.put(SERVO_PARAMETER, {1: b"12345", 2: b"123456"})
    assert storage.all(SERVO_PARAMETER) == ()
    assert storage.put(SERVO_PARAMETER, {1: b"12345", 2: b"12345"})
    assert storage.all(SERVO_PARAMETER) == ((1, b"12345"), (2, b"12345"))


@pytest.mark.parametrize("kind", list(STORED_TYPES))
def test_nothing_is_stored_under_id_0(kind: AnyType) -> None:
    storage = Storage(BoardKind(memory=10))
    assert not storage.put(kind, {0: b"1"})
    assert storage.used == 0


def test_the_active_table_is_the_chosen_one_or_the_only_one() -> None:
    storage = Storage(BoardKind(memory=100))
    assert storage.active_table == 0
    assert not storage.activate(1)
    storage.put(TABLE, {1: b"a"})
    assert storage.active_table == 1
    storage.put(TABLE, {2: b"b"})
    assert storage.active_table == 0
    assert storage.activate(2)
    assert storage.active_table == 2
    storage.put(TABLE, {2: b"c"})
    assert storage.active_table == 2
    storage.delete(TABLE, 2)
    assert storage.active_table == 1


def test_a_deleted_active_table_is_not_active_when_it_comes_back() -> None:
    storage = Storage(BoardKind(memory=100))
    storage.put(TABLE, {1: b"a", 2: b"b", 3: b"c"})
    storage.activate(2)
    storage.delete(TABLE, 2)
    storage.put(TABLE, {2: b"b"})
    assert storage.active_table == 0


def test_clear_forgets_everything() -> None:
    storage = Storage(BoardKind(memory=100))
    for kind in STORED_TYPES:
        storage.put(kind, {1: b"1"})
    storage.project_id = 5
    storage.activate(1)
    storage.clear()
    assert storage.contents == Contents()
    assert storage.free == 100


@pytest.mark.parametrize("kind", [ACTION, MACRO, TABLE])
def test_appended_records_are_found_and_deleted_first_come_first(kind: AnyType) -> None:
    storage = Storage(BoardKind(memory=10, on_duplicate="append"))
    assert storage.put(kind, {1: b"first"})
    assert storage.put(kind, {2: b"2"})
    assert storage.put(kind, {1: b"1"})
    assert not storage.put(kind, {1: b"long"})  # both count
    assert storage.all(kind) == ((1, b"first"), (2, b"2"), (1, b"1"))
    assert storage.get(kind, 1) == b"first"
    assert storage.delete(kind, 1)
    assert storage.all(kind) == ((2, b"2"), (1, b"1"))
    assert storage.get(kind, 1) == b"1"
    assert storage.free == 8


@pytest.mark.parametrize("kind", [ACTION, MACRO, TABLE])
def test_rejected_records_change_nothing(kind: AnyType) -> None:
    storage = Storage(BoardKind(memory=100, on_duplicate="reject"))
    assert storage.put(kind, {1: b"first"})
    before = storage.contents
    assert not storage.put(kind, {2: b"2", 1: b"1"})
    assert storage.contents is before
    assert storage.delete(kind, 1)
    assert storage.put(kind, {2: b"2", 1: b"1"})


@pytest.mark.parametrize("on_duplicate", ["replace", "append", "reject"])
def test_servo_parameters_are_always_replaced(on_duplicate: OnDuplicate) -> None:
    storage = Storage(BoardKind(memory=100, on_duplicate=on_duplicate))
    assert storage.put(SERVO_PARAMETER, {1: b"1", 2: b"2"})
    assert storage.put(SERVO_PARAMETER, {3: b"3", 1: b"one"})
    assert storage.all(SERVO_PARAMETER) == ((1, b"one"), (2, b"2"), (3, b"3"))


def test_the_active_table_stays_active_while_one_with_its_id_is_left() -> None:
    storage = Storage(BoardKind(memory=100, on_duplicate="append"))
    storage.put(TABLE, {1: b"a"})
    storage.put(TABLE, {1: b"b"})
    assert storage.active_table == 1
    storage.put(TABLE, {2: b"c"})
    assert storage.active_table == 0
    storage.activate(1)
    storage.delete(TABLE, 1)
    assert storage.active_table == 1
    storage.delete(TABLE, 1)
    assert storage.contents.chosen_table == 0


def test_clearing_records_leaves_project_id_and_servo_parameters() -> None:
    storage = Storage(BoardKind(memory=100, clear="records"))
    for kind in STORED_TYPES:
        storage.put(kind, {1: b"1"})
    storage.project_id = 5
    storage.activate(1)
    storage.clear()
    assert {kind: storage.all(kind) for kind in STORED_TYPES if storage.all(kind)} == {SERVO_PARAMETER: ((1, b"1"),)}
    assert (storage.project_id, storage.contents.chosen_table, storage.free) == (5, 0, 99)


def test_kept_contents_bring_their_moment_back() -> None:
    storage = Storage(BoardKind(memory=100))
    storage.put(ACTION, {1: b"a"})
    storage.project_id = 3
    moment = storage.contents
    storage.put(ACTION, {1: b"b", 2: b"c"})
    storage.clear()
    storage.contents = moment
    assert storage.all(ACTION) == ((1, b"a"),)
    assert (storage.project_id, storage.used) == (3, 1)


def test_values_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ValueError, match="on_duplicate must be one of replace, append, reject, not 'update'"):
        Storage(BoardKind(memory=1, on_duplicate="update"))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="clear must be one of all, records, not 'most'"):
        Storage(BoardKind(memory=1, clear="most"))  # type: ignore[arg-type]


records = st.dictionaries(st.integers(-1, 3), st.binary(max_size=30), max_size=3)
changes = st.lists(st.tuples(st.sampled_from(STORED_TYPES), records | st.integers(-1, 3)), max_size=30)


@given(st.sampled_from(get_args(OnDuplicate)), changes)
def test_used_is_always_the_sum_of_what_is_there(
    on_duplicate: OnDuplicate, changes: list[tuple[AnyType, dict[int, bytes] | int]]
) -> None:
    storage = Storage(BoardKind(memory=60, on_duplicate=on_duplicate))
    for kind, change in changes:
        if isinstance(change, int):
            storage.delete(kind, change)
        else:
            storage.put(kind, change)
        assert storage.used == sum(len(record) for kind in STORED_TYPES for _, record in storage.all(kind)) <= 60
        ids = [record_id for record_id, _ in storage.all(kind)]
        assert on_duplicate == "append" or len(ids) == len(set(ids))
