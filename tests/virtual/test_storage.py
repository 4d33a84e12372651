"""What fits into the memory, and what is there afterwards."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.virtual.storage import Kind, Storage


def test_what_was_put_is_there_until_it_is_deleted() -> None:
    storage = Storage(100)
    assert storage.put(Kind.ACTION, {7: b"seven"})
    assert storage.get(Kind.ACTION, 7) == b"seven"
    assert storage.get(Kind.MACRO, 7) is None
    assert storage.free == 95
    assert storage.delete(Kind.ACTION, 7)
    assert not storage.delete(Kind.ACTION, 7)
    assert storage.get(Kind.ACTION, 7) is None
    assert storage.free == 100


def test_the_same_id_replaces_and_only_the_difference_counts() -> None:
    storage = Storage(10)
    assert storage.put(Kind.MACRO, {1: b"12345678"})
    assert storage.put(Kind.MACRO, {1: b"1234567890"})
    assert storage.free == 0
    assert not storage.put(Kind.MACRO, {1: b"12345678901"})
    assert storage.get(Kind.MACRO, 1) == b"1234567890"


def test_of_several_records_all_are_stored_or_none() -> None:
    storage = Storage(10)
    assert not storage.put(Kind.SERVO, {1: b"12345", 2: b"123456"})
    assert storage.all(Kind.SERVO) == {}
    assert storage.put(Kind.SERVO, {1: b"12345", 2: b"12345"})
    assert storage.all(Kind.SERVO) == {1: b"12345", 2: b"12345"}


@pytest.mark.parametrize("kind", list(Kind))
def test_nothing_is_stored_under_id_0(kind: Kind) -> None:
    storage = Storage(10)
    assert not storage.put(kind, {0: b"1"})
    assert storage.used == 0


def test_the_active_table_is_the_chosen_one_or_the_only_one() -> None:
    storage = Storage(100)
    assert storage.active_table == 0
    assert not storage.activate(1)
    storage.put(Kind.TABLE, {1: b"a"})
    assert storage.active_table == 1
    storage.put(Kind.TABLE, {2: b"b"})
    assert storage.active_table == 0
    assert storage.activate(2)
    assert storage.active_table == 2
    storage.put(Kind.TABLE, {2: b"c"})
    assert storage.active_table == 2
    storage.delete(Kind.TABLE, 2)
    assert storage.active_table == 1


def test_a_deleted_active_table_is_not_active_when_it_comes_back() -> None:
    storage = Storage(100)
    storage.put(Kind.TABLE, {1: b"a", 2: b"b", 3: b"c"})
    storage.activate(2)
    storage.delete(Kind.TABLE, 2)
    storage.put(Kind.TABLE, {2: b"b"})
    assert storage.active_table == 0


def test_clear_forgets_everything() -> None:
    storage = Storage(100)
    for kind in Kind:
        storage.put(kind, {1: b"1"})
    storage.project_id = 5
    storage.activate(1)
    storage.clear()
    assert [storage.all(kind) for kind in Kind] == [{}] * len(Kind)
    assert (storage.project_id, storage.chosen_table, storage.free) == (0, 0, 100)


records = st.dictionaries(st.integers(-1, 3), st.binary(max_size=30), max_size=3)


@given(st.lists(st.tuples(st.sampled_from(Kind), records | st.integers(-1, 3)), max_size=30))
def test_used_is_always_the_sum_of_what_is_there(changes: list[tuple[Kind, dict[int, bytes] | int]]) -> None:
    storage = Storage(60)
    for kind, change in changes:
        if isinstance(change, int):
            storage.delete(kind, change)
        else:
            storage.put(kind, change)
        assert storage.used == sum(len(record) for kind in Kind for record in storage.all(kind).values()) <= 60
