from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from servolink.transports.hid import Report, Way, cut, declared
from tests.transports.fake_hid import VENDOR_DESCRIPTOR

KEYBOARD = bytes.fromhex(
    "05010906a101050719e029e71500250175019508810295017508810395057501050819012905910295017503910395067508150025650507"
    "190029658100c0"
)
NUMBERED = bytes.fromhex("0600ffa1018505750895208102850675089510910285077508953f9102c0")


def test_an_unnumbered_pair_of_reports_is_found() -> None:
    assert declared(VENDOR_DESCRIPTOR) == [Report(Way.IN, 0, 0xFF00, 64), Report(Way.OUT, 0, 0xFF00, 64)]


def test_numbered_reports_have_their_own_sizes() -> None:
    assert declared(NUMBERED) == [
        Report(Way.IN, 5, 0xFF00, 32),
        Report(Way.OUT, 6, 0xFF00, 16),
        Report(Way.OUT, 7, 0xFF00, 63),
    ]


def test_fields_of_one_report_add_up_and_belong_to_the_outermost_page() -> None:
    assert declared(KEYBOARD) == [Report(Way.IN, 0, 1, 8), Report(Way.OUT, 0, 1, 1)]


def test_collections_after_each_other_keep_their_pages() -> None:
    assert [report.usage_page for report in declared(KEYBOARD + VENDOR_DESCRIPTOR)] == [1, 1, 0xFF00, 0xFF00]


def test_pushed_items_come_back() -> None:
    pushed = bytes.fromhex("0600ffa10175089504a47510b481029102c0")
    assert declared(pushed) == [Report(Way.IN, 0, 0xFF00, 4), Report(Way.OUT, 0, 0xFF00, 4)]


def test_long_items_are_skipped() -> None:
    assert declared(b"\xfe\x02\x00\xa1\x01" + VENDOR_DESCRIPTOR) == declared(VENDOR_DESCRIPTOR)


@given(st.binary(max_size=80))
def test_any_bytes_are_read(descriptor: bytes) -> None:
    assert all(report.size > 0 for report in declared(descriptor))


@given(st.integers(0, 24))
def test_what_is_cut_off_adds_nothing(end: int) -> None:
    assert set(declared(VENDOR_DESCRIPTOR[:end])) <= set(declared(VENDOR_DESCRIPTOR))


@given(st.binary(max_size=300), st.integers(0, 255), st.integers(1, 70))
def test_reports_carry_the_frame_and_are_filled_with_zeros(frame: bytes, report_id: int, size: int) -> None:
    reports = list(cut(frame, report_id, size))
    assert all(report[0] == report_id and len(report) == 1 + size for report in reports)
    carried = b"".join(report[1:] for report in reports)
    assert carried[: len(frame)] == frame
    assert not any(carried[len(frame) :])
    assert len(carried) - len(frame) < size
