"""Files of a release: units and rules for Linux, workflows, and the changelog beside the version."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from servolink.doctor import ListedUsbDevice, SystemFacts, rules
from servolink.firmware import PRODUCT, USB_ID
from tests import processes

ROOT = Path(__file__).parents[1]
SYSTEM = ROOT / "docs/examples/system"
SYSTEMD = shutil.which("systemd-analyze")
UNITS = sorted(SYSTEM.glob("*.service"))


class Debian(SystemFacts):
    """A system on which serial ports belong to the group dialout."""

    def members(self, group: str) -> list[str] | None:
        return [] if group == "dialout" else None


@pytest.mark.slow
@pytest.mark.skipif(SYSTEMD is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_understands_a_unit(unit: Path, tmp_path: Path) -> None:
    program = tmp_path / ".local/bin/servolink"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n", encoding="ascii")
    program.chmod(0o700)
    copy = tmp_path / unit.name.replace("@.", "@rex.")
    copy.write_text(unit.read_text(encoding="utf-8").replace("%h", str(tmp_path)), encoding="utf-8")
    said = processes.run((SYSTEMD or "", "verify", "--man=no", str(copy)))
    assert (said.returncode, said.stderr) == (0, "")


def test_the_rules_are_those_that_the_doctor_prints_for_the_pico() -> None:
    pico = ListedUsbDevice("", *USB_ID, "", PRODUCT)
    assert (SYSTEM / "70-servolink.rules").read_text(encoding="utf-8") == rules(Debian(), [pico])


def test_the_changelog_fits_the_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    headings = re.findall(
        r"^## \[?([^\]\n]+)\]?(.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert headings[0] == ("Unreleased", "")
    released = [tuple(map(int, number.split("."))) for number, _ in headings[1:]]
    assert released == sorted(released, reverse=True)
    assert all(re.fullmatch(r" - \d{4}-\d\d-\d\d", date) for _, date in headings[1:])
    assert not released or tuple(map(int, version.split("."))) >= released[0]
