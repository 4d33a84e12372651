from __future__ import annotations

import os
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import TransportUnavailable
from servolink.transports.address import Address
from servolink.transports.faults import Faults, LineFaults

MANY = 100_000
ZEROS = bytes(100)


def _damaged(faults: Faults, data: bytes, *, size: int = 100, seed: int = 1) -> bytes:
    line = LineFaults(faults, seed)
    pieces = (line.apply(data[at : at + size], 0.0) for at in range(0, len(data), size))
    return b"".join(piece for some in pieces for _, piece in some)


def test_a_good_line_changes_nothing() -> None:
    data = os.urandom(5000)
    assert LineFaults(Faults(), 1).apply(data, 7.0) == [(7.0, data)]


def test_bytes_are_dropped_as_often_as_asked() -> None:
    left = _damaged(Faults(drop=0.1), bytes(MANY))
    assert len(left) == pytest.approx(MANY * 0.9, rel=0.01)


def test_one_bit_of_a_byte_is_flipped_as_often_as_asked() -> None:
    out = _damaged(Faults(flip=0.1), bytes(MANY))
    flipped = [byte for byte in out if byte]
    assert len(out) == MANY
    assert len(flipped) == pytest.approx(MANY * 0.1, rel=0.05)
    assert set(flipped) == {1 << bit for bit in range(8)}


def test_random_bytes_are_inserted_as_often_as_asked() -> None:
    out = _damaged(Faults(insert=0.1), b"\xff" * MANY)
    assert len(out) == pytest.approx(MANY * 1.1, rel=0.01)
    assert len(set(out)) == 256


def test_faults_of_bytes_do_not_weaken_each_other() -> None:
    out = _damaged(Faults(drop=0.2, flip=0.3, insert=0.4), bytes(MANY))
    assert len(out) == pytest.approx(MANY * (0.8 + 0.4), rel=0.02)
    zeros = MANY * (0.8 * 0.7 + 0.4 / 256)
    assert out.count(0) == pytest.approx(zeros, rel=0.03)


@pytest.mark.parametrize("faults", [Faults(drop=1.0), Faults(drop=1.0, flip=0.5)])
def test_a_line_that_drops_all_brings_nothing(faults: Faults) -> None:
    assert _damaged(faults, bytes(1000)) == b""


def test_a_line_that_flips_all_leaves_no_byte_alone() -> None:
    out = _damaged(Faults(flip=1.0), bytes(1000))
    assert len(out) == 1000
    assert 0 not in out


def test_the_rarest_fault_takes_no_time() -> None:
    assert _damaged(Faults(drop=1e-15), bytes(MANY)) == bytes(MANY)


def test_faults_of_bytes_do_not_depend_on_how_they_are_cut() -> None:
    faults, data = Faults(drop=0.01, flip=0.02, insert=0.03), bytes(10_000)
    assert _damaged(faults, data, size=7) == _damaged(faults, data, size=1000) != data


def test_chunks_are_duplicated_as_often_as_asked() -> None:
    assert len(_damaged(Faults(duplicate=0.25), bytes(MANY), size=10)) == pytest.approx(MANY * 1.25, rel=0.03)


def test_a_cut_keeps_the_beginning_of_a_chunk() -> None:
    line = LineFaults(Faults(cut=1.0), 3)
    chunk = bytes(range(100))
    lengths = set()
    for _ in range(2000):
        pieces = [piece for _, piece in line.apply(chunk, 0.0)]
        left = b"".join(pieces)
        assert chunk.startswith(left)
        lengths.add(len(left))
    assert lengths == set(range(100))


def test_a_delay_holds_back_what_follows() -> None:
    line = LineFaults(Faults(delay=0.3, delay_time=1.0), 1)
    times = [line.apply(ZEROS, number / 10)[0][0] for number in range(1000)]
    assert times == sorted(times)
    late = [at - number / 10 for number, at in enumerate(times)]
    assert max(late) == pytest.approx(1.0)
    assert min(late) == 0


def test_an_unplugged_line_brings_so_many_bytes_and_no_more() -> None:
    line = LineFaults(Faults(unplug=250), 1)
    brought = [sum(len(piece) for _, piece in line.apply(ZEROS, 0.0)) for _ in range(5)]
    assert brought == [100, 100, 50, 0, 0]
    assert line.unplugged


def test_a_line_is_plugged_in_until_then() -> None:
    line = LineFaults(Faults(unplug=250), 1)
    line.apply(bytes(249), 0.0)
    assert not line.unplugged
    assert not LineFaults(Faults(), 1).unplugged


probabilities = st.floats(0, 1)
any_faults = st.builds(
    Faults,
    drop=probabilities,
    flip=probabilities,
    insert=probabilities,
    delay=probabilities,
    delay_time=st.floats(0, 10),
    duplicate=probabilities,
    cut=probabilities,
    unplug=st.integers(0, 500),
)


@given(any_faults, st.integers(), st.lists(st.binary(max_size=100), max_size=10))
def test_the_same_seed_gives_the_same_faults(faults: Faults, seed: int, chunks: list[bytes]) -> None:
    one, other = LineFaults(faults, seed), LineFaults(faults, seed)
    for now, chunk in enumerate(chunks):
        pieces = one.apply(chunk, now)
        assert pieces == other.apply(chunk, now)
        assert all(piece for _, piece in pieces)
        assert all(at >= now for at, _ in pieces)


def test_another_seed_gives_other_faults() -> None:
    data = bytes(1000)
    assert _damaged(Faults(flip=0.1), data, seed=1) != _damaged(Faults(flip=0.1), data, seed=2)


def test_all_are_read_from_a_text_or_from_an_address() -> None:
    expected = Faults(
        drop=0.01, flip=0.02, insert=0.03, delay=0.04, delay_time=0.5, duplicate=0.05, cut=0.06, unplug=700
    )
    text = "drop=0.01,flip=0.02,insert=0.03,delay=0.04,delay_time=0.5,duplicate=0.05,cut=0.06,unplug=700"
    assert all(getattr(expected, field.name) != field.default for field in fields(Faults))
    assert Faults.parse(text) == expected
    assert Faults.from_address(Address.parse("x://?" + text.replace(",", "&"))) == expected
    assert Faults.parse("") == Faults()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "drp=0.1",
            "unknown option drp; faults:// has: drop, flip, insert, delay, delay_time, duplicate, cut, unplug",
        ),
        ("drop=2", "option drop must be a number from 0 to 1, not '2'"),
        ("drop", "must be written name=value"),
        ("unplug=0.5", "an integer"),
        ("delay_time=-1", "a number from 0 to 3600"),
    ],
)
def test_what_is_no_fault_is_refused(text: str, reason: str) -> None:
    with pytest.raises(TransportUnavailable) as caught:
        Faults.parse(text)
    assert reason in str(caught.value)
