"""The rules give users at the machine access to the board only, and hold no text of a device that could change them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.doctor.permissions import rules
from servolink.doctor.system import ListedUsbDevice, usb_device
from tests.doctor.recorded import RecordedFacts

RULE = re.compile(r'#?([A-Z]+({\w+})?(==|\+=|=)"[^"\\\n]*"(, )?)+')


def rule_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def test_a_board_of_its_own_id(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    device = usb_device(facts, "hid://1234:5678/A1")
    assert device is not None
    text = rules(facts, [device, device])
    assert text.startswith("# /etc/udev/rules.d/70-servolink.rules")
    tty, hidraw, usb = rule_lines(text)
    for line, subsystem in ((tty, "tty"), (hidraw, "hidraw"), (usb, "usb")):
        assert f'SUBSYSTEM=="{subsystem}"' in line
        assert 'TAG+="uaccess", MODE="0660", GROUP="dialout"' in line
        assert '{idVendor}=="1234"' in line
        assert '{idProduct}=="5678"' in line
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in tty
    assert "0666" not in text


def test_an_adapter_that_cannot_be_told_from_others_is_left_to_the_user(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    device = usb_device(facts, "serial:///dev/ttyUSB0")
    assert device is not None
    text = rules(facts, [device])
    assert rule_lines(text) == []
    assert '#ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio"' in text


def test_an_adapter_with_a_number_is_told_by_it(tmp_path: Path) -> None:
    device = ListedUsbDevice("", 0x0403, 0x6001, "A50285BI", "FT232R")
    lines = rule_lines(rules(RecordedFacts("desktop", tmp_path), [device]))
    assert len(lines) == 4
    assert all('{serial}=="A50285BI"' in line for line in lines)
    assert 'ATTR{latency_timer}="1"' in lines[3]


@given(st.text(), st.text(), st.sampled_from([(0x1234, 0x5678), (0x0403, 0x6001)]))
def test_no_word_of_a_device_changes_what_a_rule_means(
    tmp_path_factory: pytest.TempPathFactory, serial: str, product: str, ids: tuple[int, int]
) -> None:
    facts = RecordedFacts("wsl", tmp_path_factory.mktemp("wsl"))
    for hostile in ("", '"', '", RUN+="/bin/sh -c x', "\n", "\\", "$"):
        text = rules(facts, [ListedUsbDevice("", *ids, serial + hostile, product + hostile)])
        assert "RUN+" not in text
        assert "GROUP" not in text
        for line in rule_lines(text):
            assert RULE.fullmatch(line)
