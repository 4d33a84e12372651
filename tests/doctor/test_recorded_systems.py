"""Each cause is found in the facts of a system that has it, and not in those of one that has not.

Modules: servolink.doctor.environment, servolink.doctor.examination, servolink.doctor.finding, servolink.doctor.system.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from servolink.doctor.environment import (
    check_address,
    check_brltty,
    check_hid,
    check_holders,
    check_latency_timer,
    check_libusb,
    check_modem_manager,
    check_round_trips,
    check_surroundings,
)
from servolink.doctor.examination import checks_before_opening
from servolink.doctor.finding import Finding
from servolink.doctor.permissions import check_permissions
from servolink.doctor.system import SystemFacts
from tests.doctor.recorded import SYSTEMS, RecordedFacts

ACM, FTDI = "serial:///dev/ttyACM0", "serial:///dev/ttyUSB0"
HID, USB = "hid://1234:5678", "usb://1234:5678/A1"
ADDRESSES = [ACM, FTDI, HID, USB, "hid://", "serial://COM3", "tcp://127.0.0.1:1", "virtual://", "/dev/tty.usbmodem1101"]


def one(findings: object) -> Finding:
    """Return the only finding."""
    (finding,) = list(findings)  # type: ignore[call-overload]
    assert isinstance(finding, Finding)
    return finding


@pytest.mark.parametrize("url", [ACM, "/dev/serial/by-id/usb-Servo_board_A1-if00"])
def test_a_port_of_a_group_one_is_not_in(url: str, tmp_path: Path) -> None:
    found = one(check_permissions(RecordedFacts("desktop", tmp_path), url))
    assert found.check == "permissions"
    assert "/dev/ttyACM0 belongs to root:dialout with mode 0660; ada is in ada, video" in found.observation
    assert found.remedy.splitlines() == ["sudo usermod -aG dialout ada", "log out and in again"]


@pytest.mark.parametrize(("url", "node"), [(HID, "/dev/hidraw3"), (USB, "/dev/bus/usb/001/007")])
def test_a_device_of_root_alone_needs_a_rule(url: str, node: str, tmp_path: Path) -> None:
    found = one(check_permissions(RecordedFacts("desktop", tmp_path), url))
    assert node in found.observation
    assert "no udev rule" in found.meaning
    assert "--print-udev | sudo tee /etc/udev/rules.d/70-servolink.rules" in found.remedy


def test_a_group_that_one_has_just_joined_counts_from_the_next_login(tmp_path: Path) -> None:
    found = one(check_permissions(RecordedFacts("raspberry-pi", tmp_path), ACM))
    assert "the session began before" in found.meaning
    assert "newgrp dialout" in found.remedy


def test_uaccess_is_for_those_at_the_machine(tmp_path: Path) -> None:
    found = one(check_permissions(RecordedFacts("raspberry-pi", tmp_path), HID))
    assert "over the network" in found.meaning
    assert "rule is there" in one(check_permissions(at_the_machine(tmp_path), HID)).meaning


def at_the_machine(tmp_path: Path) -> RecordedFacts:
    return RecordedFacts("raspberry-pi", tmp_path / "seat", environment={"XDG_SESSION_ID": "1"})


def test_a_rule_that_comes_too_late_is_named(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    rules = tmp_path / "etc/udev/rules.d/99-board.rules"
    rules.parent.mkdir(parents=True)
    rules.write_text('ATTRS{idVendor}=="1234", TAG+="uaccess"')
    found = list(check_permissions(facts, HID))[1]
    assert (found.check, "99-board.rules" in found.observation) == ("udev", True)
    rules.rename(rules.with_name("60-board.rules"))
    assert one(check_permissions(facts, HID)).check == "permissions"


def test_what_may_be_used_is_no_finding(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path, nodes={"/dev/ttyACM0": ["root", "dialout", "660", True]})
    assert list(check_permissions(facts, ACM)) == []


@pytest.mark.parametrize(("device", "found"), [("ttyACM0", 1), ("pts/3", 1), ("null", 0)])
def test_who_has_what_is_no_terminal_open_need_not_close_it(device: str, found: int, tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    folder = tmp_path / "proc/900/fd"
    folder.mkdir(parents=True)
    (folder / "3").symlink_to(f"/dev/{device}")
    assert len(list(check_holders(facts, f"serial:///dev/{device}"))) == found


def test_modem_manager_is_named_unless_it_keeps_away(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    found = one(check_modem_manager(facts, ACM))
    assert ("/dev/ttyACM0" in found.observation, "20 s" in found.meaning) == (True, True)
    (tmp_path / "run/udev/data/c166:0").write_text("E:ID_MODEL=Servo_board\nE:ID_MM_DEVICE_IGNORE=1\n")
    assert list(check_modem_manager(facts, ACM)) == []
    assert list(check_modem_manager(facts, HID)) == []
    assert list(check_modem_manager(RecordedFacts("raspberry-pi", tmp_path / "pi"), ACM)) == []


def test_brltty_is_named_when_an_adapter_has_lost_its_port(tmp_path: Path) -> None:
    found = one(check_brltty(RecordedFacts("brltty", tmp_path)))
    assert "CH340 adapter (1a86:7523)" in found.observation
    assert "sudo apt remove brltty" in found.remedy
    assert "/etc/udev/rules.d/85-brltty.rules" in found.remedy
    (tmp_path / "sys/devices/usb1/1-4/1-4:1.0/ttyUSB0").mkdir()
    assert list(check_brltty(RecordedFacts("brltty", tmp_path, files={}, links={}))) == []
    assert list(check_brltty(RecordedFacts("desktop", tmp_path / "desktop"))) == []


def test_the_latency_timer_of_an_ftdi_adapter(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    found = one(check_latency_timer(facts, FTDI))
    assert found.observation == "/sys/bus/usb-serial/devices/ttyUSB0/latency_timer is 16 ms"
    assert "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer" in found.remedy
    (tmp_path / "sys/devices/usb1/1-2/1-2:1.0/ttyUSB0/latency_timer").write_text("1\n")
    assert list(check_latency_timer(facts, FTDI)) == []
    assert list(check_latency_timer(facts, ACM)) == []


@pytest.mark.parametrize(
    ("system", "cure"), [("desktop", "sudo tee"), ("windows", "Device Manager"), ("macos", "1 ms")]
)
def test_round_trips_that_cluster_at_16_ms(system: str, cure: str, tmp_path: Path) -> None:
    facts = RecordedFacts(system, tmp_path)
    found = one(check_round_trips(facts, FTDI, [0.0161] * 40 + [0.002] * 20))
    assert (found.check, "40 of 60 responses" in found.observation, cure in found.remedy) == (
        "latency timer",
        True,
        True,
    )


@pytest.mark.parametrize("times", [[], [0.016] * 9, [0.001] * 60, [0.03] * 60, [0.016] * 29 + [0.001] * 31])
def test_other_round_trips_are_no_finding(times: list[float], tmp_path: Path) -> None:
    assert list(check_round_trips(RecordedFacts("desktop", tmp_path), FTDI, times)) == []


def test_the_wrong_hid_package_and_no_libusb(tmp_path: Path) -> None:
    windows = RecordedFacts("windows", tmp_path)
    found = one(check_hid(windows))
    assert "hid\\__init__.py" in found.observation
    assert found.remedy.splitlines() == ["py -m pip uninstall hid", "py -m pip install --force-reinstall hidapi"]
    assert "libusb-package" in one(check_libusb(windows)).remedy
    no_libusb = RecordedFacts("desktop", tmp_path / "desktop", libusb=False)
    assert one(check_libusb(no_libusb)).observation == "pyusb finds no libusb"
    assert one(check_hid(RecordedFacts("wsl", tmp_path / "wsl"))).remedy == "python3 -m pip install hidapi"


def test_the_right_packages_are_no_finding(tmp_path: Path) -> None:
    facts = RecordedFacts("desktop", tmp_path)
    assert [*check_hid(facts), *check_libusb(facts)] == []
    beside = {"hidraw": "/x/hidraw.abi3.so", "hid": "/x/hid/__init__.py"}  # on Linux hidraw is what is used
    assert list(check_hid(RecordedFacts("desktop", tmp_path / "beside", modules=beside))) == []


@pytest.mark.parametrize(
    ("system", "changed", "check", "do"),
    [
        ("wsl", {}, "WSL", "usbipd attach --wsl --busid BUSID"),
        ("container", {}, "container", "docker run --device="),
        ("desktop", {"environment": {"container": "podman"}}, "container", "--device=/dev/hidraw0"),
        ("desktop", {"environment": {"SNAP": "/snap/x"}}, "sandbox", "python3 -m venv"),
    ],
)
def test_what_hides_devices(system: str, changed: dict[str, Any], check: str, do: str, tmp_path: Path) -> None:
    found = one(check_surroundings(RecordedFacts(system, tmp_path, **changed)))
    assert (found.check, do in found.remedy) == (check, True)


@pytest.mark.parametrize("system", ["desktop", "macos", "windows", "raspberry-pi"])
def test_nothing_hides_devices_elsewhere(system: str, tmp_path: Path) -> None:
    assert list(check_surroundings(RecordedFacts(system, tmp_path))) == []


def test_the_port_that_waits_on_macos(tmp_path: Path) -> None:
    facts = RecordedFacts("macos", tmp_path)
    found = one(check_address(facts, "/dev/tty.usbmodem1101"))
    assert found.remedy == "use the other port: --board serial:///dev/cu.usbmodem1101"
    assert list(check_address(facts, "/dev/cu.usbmodem1101")) == []
    assert list(check_address(RecordedFacts("desktop", tmp_path / "x"), "/dev/tty.usbmodem1101")) == []


@pytest.mark.parametrize("system", [path.stem for path in SYSTEMS.iterdir()])
def test_every_check_runs_on_every_system(system: str, tmp_path: Path) -> None:
    for finding in checks_before_opening(RecordedFacts(system, tmp_path), ADDRESSES):
        assert finding.check
        assert finding.observation
        assert finding.meaning
        assert finding.remedy


def test_a_system_without_proc_and_sys_is_not_in_the_way(tmp_path: Path) -> None:
    facts = SystemFacts(tmp_path)
    assert {finding.check for finding in checks_before_opening(facts, ADDRESSES)} <= {
        "hid package",
        "libusb",
        "container",
    }
    assert (facts.names("/proc"), facts.text("/x"), facts.link("/x"), facts.node("/x")) == ([], "", "", None)
    assert (facts.text("/\0"), facts.node("/\0"), facts.names("/\0"), facts.link("/\0")) == ("", None, [], "")
    assert list(facts.processes()) == []
