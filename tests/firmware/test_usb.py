"""USB of the shipped image: the standard requests of chapter 9, and what gives the line back to the UART."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest

from servolink.firmware.compiling import IMAGE
from tests.firmware.conversations import frame
from tests.firmware.emulated import EmulatedPico, emulated, needs_emulator
from tests.firmware.test_core import READY, add_action, answers, move

pytestmark = needs_emulator

_LIST = frame(20010)
_IN, _CLASS, _INTERFACE, _ENDPOINT = 0x80, 0x20, 1, 2
_BULK_IN, _BULK_OUT, _NOTIFY = 0x82, 0x02, 0x81
_CLOSE, _OPEN = (_CLASS | _INTERFACE, 0x22, 0), (_CLASS | _INTERFACE, 0x22, 3)


@pytest.fixture
def pico() -> Iterator[EmulatedPico]:
    with emulated(IMAGE, "usb") as started:
        assert started.is_open
        yield started


def _request(
    pico: EmulatedPico, kind: int, request: int, value: int = 0, index: int = 0, length: int = 0
) -> bytes | None:
    return pico.control(struct.pack("<BBHHH", kind, request, value, index, length))


def _is_line(pico: EmulatedPico) -> tuple[bool, bool]:
    """Return whether a query is answered over the UART, and over USB."""
    found = []
    for line in ("uart", "usb"):
        pico.line = line
        found.append([each[0] for each in answers(pico.ask(_LIST))] == [20011])
    return found[0], found[1]


@pytest.mark.parametrize(
    ("kind", "request_", "value", "index", "length", "answer"),
    [
        (_IN, 0, 0, 0, 2, b"\0\0"),
        (_IN | _INTERFACE, 0, 0, 1, 2, b"\0\0"),
        (_IN | _ENDPOINT, 0, 0, 0, 2, b"\0\0"),
        (_IN | _ENDPOINT, 0, 0, _BULK_IN, 2, b"\0\0"),
        (_IN | _ENDPOINT, 0, 0, _NOTIFY, 2, b"\0\0"),
        (_ENDPOINT, 1, 0, _BULK_OUT, 0, b""),
        (_ENDPOINT, 1, 0, 0, 0, b""),
        (_IN, 6, 0x100, 0, 8, bytes.fromhex("1201000202000040")),
        (_IN, 6, 0x200, 0, 4, bytes.fromhex("09024300")),
        (_IN, 6, 0x302, 0x409, 4, b"\x20\x03s\0"),
        (_IN, 8, 0, 0, 1, b"\1"),
        (_IN | _INTERFACE, 10, 0, 0, 1, b"\0"),
        (_IN | _INTERFACE, 10, 0, 1, 1, b"\0"),
        (_INTERFACE, 11, 0, 0, 0, b""),
        (_INTERFACE, 11, 0, 1, 0, b""),
        (_IN | _CLASS | _INTERFACE, 0x21, 0, 0, 7, bytes(7)),
        # What this device has not, what is not said so, and what is for somebody else, is refused.
        (_IN, 0, 1, 0, 2, None),
        (_IN | _INTERFACE, 0, 0, 2, 2, None),
        (_IN | _ENDPOINT, 0, 0, 3, 2, None),
        (_IN | _ENDPOINT, 0, 0, 0x01, 2, None),
        (0, 3, 1, 0, 0, None),
        (0, 1, 1, 0, 0, None),
        (_INTERFACE, 3, 0, 0, 0, None),
        (_ENDPOINT, 3, 1, _BULK_IN, 0, None),
        (_ENDPOINT, 3, 0, 0, 0, None),
        (0, 5, 128, 0, 0, None),
        (_IN, 6, 0x600, 0, 10, None),
        (_IN, 6, 0x304, 0, 10, None),
        (_IN | _INTERFACE, 6, 0x100, 0, 18, None),
        (0, 6, 0x100, 0, 18, None),
        (0, 7, 0x100, 0, 0, None),
        (0, 8, 0, 0, 1, None),
        (0, 9, 2, 0, 0, None),
        (_IN, 9, 1, 0, 0, None),
        (_IN | _INTERFACE, 10, 0, 2, 1, None),
        (_INTERFACE, 11, 1, 1, 0, None),
        (_IN | _ENDPOINT, 12, 0, _BULK_IN, 2, None),
        (_IN | _CLASS | _INTERFACE, 0x22, 3, 0, 0, None),
        (_CLASS | _INTERFACE, 0x21, 0, 0, 7, None),
        (_IN | 0x40, 6, 0x100, 0, 18, None),
    ],
)
def test_requests_of_chapter_9(
    pico: EmulatedPico, kind: int, request_: int, value: int, index: int, length: int, answer: bytes | None
) -> None:
    assert _request(pico, kind, request_, value, index, length) == answer
    assert _is_line(pico) == (False, True), "and the port goes on"


def test_a_halted_endpoint_says_so_and_goes_on_when_it_is_cleared(pico: EmulatedPico) -> None:
    for endpoint in (_BULK_IN, _BULK_OUT):
        assert _request(pico, _ENDPOINT, 3, 0, endpoint) == b""
        assert _request(pico, _IN | _ENDPOINT, 0, 0, endpoint, 2) == b"\1\0"
        if endpoint == _BULK_IN:
            assert pico.ask(_LIST) == b""
        assert _request(pico, _ENDPOINT, 1, 0, endpoint) == b""
        assert _request(pico, _IN | _ENDPOINT, 0, 0, endpoint, 2) == b"\0\0"
        assert [each[0] for each in answers(pico.ask(_LIST))] == [20011]


def test_a_configuration_can_be_left_and_chosen_again(pico: EmulatedPico) -> None:
    assert _request(pico, 0, 9, 0) == b""
    assert _request(pico, _IN, 8, 0, 0, 1) == b"\0"
    assert _request(pico, _IN | _INTERFACE, 10, 0, 0, 1) is None
    assert _request(pico, _IN | _ENDPOINT, 0, 0, _BULK_IN, 2) is None
    assert _request(pico, *_OPEN) is None
    assert _is_line(pico)[0]
    assert _request(pico, 0, 9, 1) == b""
    assert _request(pico, _IN, 8, 0, 0, 1) == b"\1"
    assert _request(pico, *_OPEN) == b""
    assert _is_line(pico) == (False, True)


def test_the_line_coding_is_kept(pico: EmulatedPico) -> None:
    coding = struct.pack("<IBBB", 115_200, 0, 0, 8)
    assert pico.control(struct.pack("<BBHHH", _CLASS | _INTERFACE, 0x20, 0, 0, 7), coding) == b""
    assert _request(pico, _IN | _CLASS | _INTERFACE, 0x21, 0, 0, 7) == coding
    assert _request(pico, _CLASS | _INTERFACE, 0x20, 0, 0, 8) is None


def test_the_line_is_that_of_the_program_which_has_the_port_open(pico: EmulatedPico) -> None:
    assert _is_line(pico) == (False, True)
    assert _request(pico, *_CLOSE) == b""
    assert _is_line(pico) == (True, False)
    assert _request(pico, *_OPEN) == b""
    assert _is_line(pico) == (False, True)


def test_a_pulled_cable_gives_the_line_to_the_uart(pico: EmulatedPico) -> None:
    pico.command(power=False, run=0.02)
    assert _is_line(pico) == (True, False)
    pico.command(power=True, run=0.05)
    assert _is_line(pico) == (True, False), "a host that comes back has to find the device first"


def test_a_host_that_sleeps_gives_the_line_to_the_uart_until_it_wakes(pico: EmulatedPico) -> None:
    pico.ask(READY)
    pico.ask(move((1, 45, 300)), 0.1)
    pico.command(asleep=True, run=0.01)
    pico.line = "uart"
    assert [each[0] for each in answers(pico.ask(_LIST))] == [20011]
    pico.run(2)
    assert pico.pulses[0][-1][0] > pico.now - 0.05, "motion goes on"
    pico.command(asleep=False, run=0.01)
    assert _is_line(pico) == (False, True)


def test_a_board_without_the_pin_of_the_cable_is_used_over_usb() -> None:
    with emulated(IMAGE, "usb", power=False) as pico:
        assert _is_line(pico) == (False, True)


def test_half_a_response_of_usb_is_not_sent_over_the_uart(pico: EmulatedPico) -> None:
    for number in range(1, 41):
        pico.ask(add_action(number))
    pico.ask(frame(10050, bytes(60))[:30] + frame(30010) * 3, 0)
    pico.command(power=False, run=0.02)
    pico.line = "uart"
    assert [each[0] for each in answers(pico.ask(_LIST, 0.2))] == [20011]
