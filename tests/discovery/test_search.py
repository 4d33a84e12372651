"""The search finds every kind and opens nothing."""

from __future__ import annotations

import os
from importlib import import_module
from types import SimpleNamespace

import pytest
import serial  # type: ignore[import-untyped]
from serial.tools import list_ports, list_ports_common  # type: ignore[import-untyped]

from servolink.discovery import search
from servolink.discovery.announcements import announced
from servolink.transports import serial_ports
from servolink.transports.device_info import DeviceInfo


def port(device: str, vid: int | None = None, product: str | None = None, number: str | None = None) -> object:
    found = list_ports_common.ListPortInfo(device)
    found.vid, found.product, found.serial_number = vid, product, number
    return found


def test_serial_ports_on_usb_can_be_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [port("COM4", 1, "board", "A1"), port("COM1"), port("COM%3", 1)]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert serial_ports.candidates() == [DeviceInfo("serial://COM4", "board", "A1"), DeviceInfo("serial://COM%253")]


def test_a_device_that_vanishes_while_ports_are_listed_hides_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[Exception | None] = [TypeError("int() can't convert non-string with explicit base"), None]

    def comports() -> list[object]:
        if error := looks.pop(0):
            raise error
        return [port("COM4", 1)]

    monkeypatch.setattr(list_ports, "comports", comports)
    assert serial_ports.candidates() == [DeviceInfo("serial://COM4")]
    looks[:] = [OSError()] * 3
    assert serial_ports.present() == []


def test_a_port_that_may_not_be_opened_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", lambda: [port(os.devnull, 1)])
    assert serial_ports.candidates()[0].problem == ""
    monkeypatch.setattr(serial_ports, "is_accessible", lambda path: False)
    assert "servolink doctor" in serial_ports.candidates()[0].problem


def test_every_kind_is_searched() -> None:
    assert all(callable(import_module(kind).candidates) for kind in search._KINDS)


def test_a_library_that_is_missing_or_broken_hides_only_its_own_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> list[DeviceInfo]:
        raise RuntimeError("no such thing")

    kinds = {
        "a": SimpleNamespace(candidates=broken),
        "b": SimpleNamespace(candidates=lambda: [DeviceInfo("tcp://x:1")]),
    }
    monkeypatch.setattr(search, "_KINDS", ("a", "missing", "b"))
    monkeypatch.setattr(search, "import_module", kinds.__getitem__)
    assert search.search() == [DeviceInfo("tcp://x:1")]


def test_nothing_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(self: object) -> None:
        raise AssertionError

    monkeypatch.setattr(list_ports, "comports", lambda: [port(os.devnull, 1)])
    monkeypatch.setattr(serial.Serial, "open", opened)
    with announced(DeviceInfo("tcp://127.0.0.1:1")):
        found = {candidate.url for candidate in search.search()}
    assert {f"serial://{os.devnull}", "tcp://127.0.0.1:1"} <= found
