"""What may be done from afar."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.errors import ServolinkError
from servolink.fleet.policy import BoardPolicy, load_fleet_file

pytestmark = pytest.mark.usefixtures("user")

FILE = """
[default]
allow = "run"
max_speed = 90
forecast = true

[boards.rex]
allow = "edit"
angles.3 = [-20, 160]
angles.all = [-90.5, 90]

[groups]
front = ["rex"]
"""


def test_without_a_file_others_may_watch() -> None:
    assert load_fleet_file().policy_of("rex") == BoardPolicy("watch")
    assert BoardPolicy().tightening() is None


def test_a_board_has_the_default_unless_it_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "fleet.toml"
    path.write_text(FILE, encoding="utf-8")
    policies = load_fleet_file(path)
    assert policies.policy_of("fido") == BoardPolicy("run", 90, forecast=True)
    rex = policies.policy_of("rex")
    assert rex == BoardPolicy("edit", 90, {"3": (-20, 160), "all": (-90.5, 90)}, forecast=True)
    assert rex.tightening() == {"angles": rex.angles, "speed_cap": 90, "source": "fleet.toml"}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[default", "Expected"),
        ('[default]\nallow = "fly"', "Invalid enum value 'fly'"),
        ("[default]\nspeed = 1", "unknown field `speed`"),
        ("[default]\nmax_speed = 0", "max_speed"),
        ('[default]\nforecast = "robot.json"', "forecast"),
        ('[boards."a/b"]', "'a/b' cannot be a name"),
        ("[boards.rex.angles]\nhip = [0, 1]", "boards.rex.angles: 'hip' must be a servo id"),
        ("[boards.rex.angles]\n3 = [1, 0]", "no angle is within 1.0..0.0"),
        ("[boards.rex.angles]\n300 = [0, 1]", "outside 0..254"),
    ],
)
def test_a_file_that_cannot_be_meant_so_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ServolinkError, match=r"fleet.toml cannot be used: ") as error:
        load_fleet_file(path)
    assert why in str(error.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ServolinkError, match="does not exist"):
        load_fleet_file(tmp_path / "none")
    with pytest.raises(ServolinkError, match="cannot be read: Is a directory"):
        load_fleet_file(tmp_path)
