"""Image for the Pico, down to the pulses at its pins, in an emulator with emulated time."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from servolink.errors import ServolinkError
from servolink.firmware.compiling import IMAGE, build
from servolink.firmware.image import ImageSettings, from_uf2, to_uf2, with_settings
from tests.firmware.conversations import frame
from tests.firmware.emulated import EmulatedPico, emulated, needs_emulator
from tests.firmware.test_core import READY, RELEASE, STOP, add_action, add_macro, answers, move, run_macro

pytestmark = needs_emulator

PERIOD = 0.02


@pytest.fixture
def pico() -> Iterator[EmulatedPico]:
    with emulated(IMAGE) as started:
        yield started


def _at_zero(pico: EmulatedPico) -> None:
    pico.ask(READY)
    pico.ask(move(*((servo, 0, 0) for servo in range(1, 17))), 1.1)


def test_sixteen_servos_get_the_pulses_of_their_angles(pico: EmulatedPico) -> None:
    angles = [-90, -77, -60, -45, -33, -20, -10, -1, 0, 5, 13, 29, 41, 58, 76, 90]
    _at_zero(pico)
    pico.ask(move(*((servo, angle, 20) for servo, angle in enumerate(angles, 1))), 0.3)
    settled = pico.now
    pico.run(0.2)
    for pin, angle in enumerate(angles):
        widths = pico.widths_since(pin, settled)
        assert len(widths) in {9, 10, 11}
        assert all(abs(width - (1500 + angle * 1000 / 90)) <= 2 for width in widths), (pin, widths)
        starts = [start for start, _ in pico.pulses[pin] if start >= settled]
        assert all(abs(after - before - PERIOD) < 1e-5 for before, after in pairwise(starts))


def test_no_pulse_is_ever_made_but_on_request_and_in_range(pico: EmulatedPico) -> None:
    pico.run(0.5)
    pico.ask(READY, 0.2)
    assert not pico.pulses
    pico.ask(move((1, 400, 0), (2, -400, 0)), 1.2)
    pico.command(reset=True, run=2)
    pico.ask(READY + move((1, 90, 10)), 1.2)
    pico.command(hang=True, run=3)
    assert pico.resets == 1
    last = pico.pulses[0][-1][0]
    assert pico.now - last > 2.5, "the watchdog released the servos"
    whole = [width for pin in pico.pulses for _, width in pico.pulses[pin] if width >= 500]
    cut = [width for pin in pico.pulses for _, width in pico.pulses[pin] if width < 500]
    assert max(whole) <= 2500.5
    assert len(cut) <= 2, "only a reset cuts a pulse"
    assert set(pico.pulses) == {0, 1}


@pytest.mark.parametrize(("request_", "is_held"), [(STOP, True), (RELEASE, False)])
def test_stop_and_release_act_within_a_pulse(pico: EmulatedPico, request_: bytes, is_held: bool) -> None:
    _at_zero(pico)
    pico.ask(move((1, 90, 100)), 0.5)
    pico.ask(request_, 0)
    sent = pico.now
    pico.run(0.3)
    widths = pico.widths_since(0, sent + PERIOD)
    if is_held:
        assert len(set(widths)) == 1
        assert len(widths) >= 13
        assert 1900 < widths[0] < 2150
    else:
        assert widths == []


def test_a_macro_begins_and_ends_in_time(pico: EmulatedPico) -> None:
    _at_zero(pico)
    pico.ask(add_action(1, (1, 90, 20)), 0.3)
    pico.ask(add_action(2, (1, -90, 40)), 0.1)
    pico.ask(add_macro(1, (1, 0, 50, 1), (100, 1, 100, 1), (2, 0, 100, 1)), 2)
    pico.ask(run_macro(1), 0)
    begun = pico.now
    pico.run(1.2)
    pulses = [(start - begun, width) for start, width in pico.pulses[0] if start > begun]
    lags = [start - (width - 1500) / 2500 for start, width in pulses if start < 0.4 and width > 1500]
    assert len(lags) > 15
    assert all(0 < lag < PERIOD for lag in lags)
    assert all(width > 1500 for start, width in pulses if PERIOD < start < 0.4), "it has begun within 20 ms"
    assert [width for start, width in pulses if 0.42 < start < 0.48] == [2500] * 3
    assert all(width > 501 for start, width in pulses if start < 0.9)
    ended = [width for start, width in pulses if start > 0.9 + PERIOD]
    assert len(ended) > 10
    assert all(width <= 500.5 for width in ended), "it has ended within 20 ms"


def test_records_outlive_a_reset_and_motion_goes_on_while_flash_is_erased(pico: EmulatedPico) -> None:
    _at_zero(pico)
    pico.ask(move((1, 90, 500)))
    begun = pico.now
    long = [(servo % 16 + 1, 0, 1) for servo in range(1500)]
    for number in range(1, 16):  # more than a bank of flash
        sent = pico.ask(add_action(number % 4 + 1, *long))
        while not sent and pico.now < begun + 60:
            sent = pico.run(0.1)
        assert answers(sent) == [(30031, b"\1")]
    starts = [start for start, _ in pico.pulses[0] if start > begun]
    assert max(after - before for before, after in pairwise(starts)) < PERIOD + 1e-4
    pico.command(erase=0.4)
    pico.ask(move((1, -90, 500)))
    while not pico.is_erasing:
        pico.ask(add_action(1, *long), 0.1)
    pico.ask(STOP, 0)
    stopped = pico.now
    pico.run(0.2)
    assert pico.is_erasing
    assert len(set(pico.widths_since(0, stopped + PERIOD))) == 1, "a stop acts within a pulse while a sector is erased"
    pico.command(reset=True, run=4)
    assert len(answers(pico.ask(frame(30010), 0.3))[0][1]) == 2 + 4 * 36


def test_buttons_and_battery_are_read_at_their_pins(pico: EmulatedPico) -> None:
    pico.ask(frame(40070, b"\1"))
    sent = b"".join(pico.command(pressed=pins, run=0.1) for pins in ([18], [], [28], []))
    events = [struct.unpack("<IB", content) for _, content in answers(sent)]
    assert events == [(1, 1), (1, 4), (7, 1), (7, 4)]
    assert answers(pico.ask(frame(10040))) == [(10041, struct.pack("<h", 1000))], "no battery is measured"


def _image(folder: Path, settings: ImageSettings) -> Path:
    """Return a file with the shipped image and other settings."""
    path = folder / "image.uf2"
    path.write_bytes(to_uf2(with_settings(from_uf2(IMAGE.read_bytes()), settings)))
    return path


def test_the_battery_is_measured_at_its_pin(tmp_path: Path) -> None:
    with emulated(_image(tmp_path, ImageSettings(battery_empty=6000, battery_full=8400))) as pico:
        for millivolts in (8400, 7200, 6010, 5000, 9800):
            pico.command(battery=millivolts / 3000)  # a third, by the divider
            ((packet_id, content),) = answers(pico.ask(frame(10040)))
            expected = min(max((millivolts - 6000) / 2.4, 0), 1000)
            assert packet_id == 10041
            assert struct.unpack("<h", content)[0] == pytest.approx(expected, abs=2)


def test_the_eighth_button_has_the_pin_of_the_uart_which_is_off_then(tmp_path: Path) -> None:
    image = _image(tmp_path, ImageSettings(buttons=8))
    with emulated(image, "usb") as pico:
        pico.ask(frame(40070, b"\1"))
        sent = b"".join(pico.command(pressed=pins, run=0.1) for pins in ([17], [], [28], []))
        assert [struct.unpack("<IB", content) for _, content in answers(sent)] == [(8, 1), (8, 4), (7, 1), (7, 4)]
    with emulated(image) as pico:
        assert pico.ask(frame(20010)) == b""


def test_usb_is_a_serial_port() -> None:
    with emulated(IMAGE, "usb") as pico:
        assert pico.is_open
        assert answers(pico.ask(frame(20010)))[0][0] == 20011
        _at_zero(pico)
        assert pico.pulses[15][-1][1] == 1500
        for size in (55, 56, 119):  # with the header, whole packets of 64 bytes and others
            listing = answers(pico.ask(frame(10050, bytes(size)) + frame(20020, b"\xff") * 3, 0.2))
            assert [len(content) for _, content in listing] == [1 + 11 * 16] * 3


def test_the_image_has_the_bytes_that_its_sources_make(tmp_path: Path) -> None:
    try:
        built = build(tmp_path)
    except ServolinkError as error:
        pytest.skip(str(error))
    assert built.read_bytes() == IMAGE.read_bytes()
