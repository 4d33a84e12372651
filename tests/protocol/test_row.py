"""Rows are written and read all at once with the same result as one by one."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect

from servolink.errors import EncodeError
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Flag, group, value
from servolink.protocol.records import Button, MacroCommand, ServoParameter, Step
from servolink.protocol.row import Row, Writing
from servolink.protocol.servos import ExecuteActionRequest, ServoState
from tests.protocol.declared import values_of

RECORDS = [ServoState, Step, MacroCommand, ServoParameter, Button]


def row_of(record: Any) -> Row:
    return Row(group(tuple[record, ...])[1], "<")


@pytest.mark.parametrize("record", RECORDS)
@given(data=st.data(), encoding=st.sampled_from(["utf-8", "big5"]), unchecked=st.booleans())
def test_many_rows_are_written_as_each_alone(record: Any, data: st.DataObject, encoding: str, unchecked: bool) -> None:
    row, how = row_of(record), Writing(encoding, plain=not unchecked, narrow=not unchecked)
    captions = st.text(max_size=12) | st.binary(max_size=32).map(lambda raw: raw.decode("utf-8", "surrogateescape"))
    records = data.draw(st.lists(values_of(inspect.type_info(record), captions), max_size=5))
    exclusive: list[Any] = []
    for write in (row.pack_group, row._pack_one_by_one):
        try:
            exclusive.append(write(records, record, "P.rows", how))
        except EncodeError as error:
            exclusive.append(str(error))
    assert exclusive[0] == exclusive[1]


@pytest.mark.parametrize("record", RECORDS)
@given(st.data())
def test_many_rows_are_read_as_each_alone(record: Any, data: st.DataObject) -> None:
    row, encoding = row_of(record), data.draw(st.sampled_from(["utf-8", "big5", "utf-16-le"]))
    size = row.format.size
    content = data.draw(st.binary(min_size=4 * size, max_size=4 * size) | st.just(b""))
    exclusive = [
        record(*row.text([*row.format.unpack(content[at : at + size])], encoding))
        for at in range(0, len(content), size)
    ]
    assert row.reader(record)(content, 0, encoding) == (*exclusive,)


def test_a_record_with_more_to_it_is_written_as_what_it_is_too() -> None:
    class Named(Step, frozen=True, gc=False):
        name: str = "left elbow"

    codec = Codec()
    assert codec.encode(ExecuteActionRequest((Step(1, 2, 3), Named(4, 5, 6)))) == codec.encode(
        ExecuteActionRequest((Step(1, 2, 3), Step(4, 5, 6)))
    )


def test_bare_numbers_have_a_range_as_well() -> None:
    row = Row([value("", Flag)], ">")
    how = Writing("utf-8", plain=True, narrow=True)
    assert row.pack_group((0, 1), None, "P.flags", how) == b"\0\1"
    assert row.pack_group((0, 2), None, "P.flags", Writing("utf-8", plain=True, narrow=False)) == b"\0\2"
    with pytest.raises(EncodeError, match=r"P\.flags\[1\]: 2 is outside 0\.\.1"):
        row.pack_group((0, 2), None, "P.flags", how)
