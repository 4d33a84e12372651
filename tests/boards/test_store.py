"""A profile is kept whole, read back as it was, and refused by file and line when it is damaged.

Module: servolink.boards.profile.
"""

from __future__ import annotations

import os
import stat
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from servolink.boards.profile import (
    BoardIdentityRecord,
    BoardProfile,
    BoardSettings,
    Evidence,
    SafetyLimits,
    fields_of,
    query_names,
)
from servolink.boards.store import ProfileFile, format_profile, parse_profile
from servolink.boards.toml_text import TextError
from servolink.errors import ProfileError, escape
from tests.support.platforms.homeless import lose_home

FULL = BoardProfile(
    identity=BoardIdentityRecord(
        servo_ids=(1, 2, 254), memory_total=1 << 20, vendor_id=0x1A86, product_id=0x7523, serial_number="A\x1b1"
    ),
    settings=BoardSettings(
        byte_order="big",
        caption_encoding="big5",
        power_up_mode=0,
        transmission_mode=1,
        unsupported=("QueryMemorySize", "QueryRemainPower"),
        unknown_ids="silent",
        turnaround=0.00125,
        depth=4,
        write_depth=2,
        memory_unit=1024,
        project_id_bits=16,
        on_duplicate="append",
        clear="records",
        clear_seconds=1.5,
        interval_unit=0.01,
        when_started="turns",
    ),
    limits=SafetyLimits(
        angle_range=(-100, 165),
        angles={3: (20, 160), 10: (-90.5, 90)},
        speed_cap=120,
        speed_caps={3: 90},
        soft_start=60,
        guard=False,
        temperature=620,
        ease_off=(3, 4),
    ),
    evidence={
        "depth": Evidence("likely", 'four of four "queries"\n\u202e', datetime(2026, 1, 31, 12, tzinfo=UTC)),
        "byte_order": Evidence("certain", ""),
    },
)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]))


@pytest.fixture(autouse=True)
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = ProfileFile("rex").path
    assert path.is_relative_to(tmp_path)
    return path


@pytest.mark.parametrize("profile", [BoardProfile(), FULL, BoardProfile(identity=BoardIdentityRecord())])
def test_a_profile_is_read_as_it_was_written(profile: BoardProfile, path: Path) -> None:
    assert ProfileFile("rex").load() is None
    assert ProfileFile("rex").save(profile) == path
    assert ProfileFile("rex").load() == profile
    assert ProfileFile.names() == ["rex"]
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_every_setting_has_a_comment_and_a_place(path: Path) -> None:
    lines = format_profile("rex", BoardProfile(identity=BoardIdentityRecord())).splitlines()
    for part in (BoardIdentityRecord, BoardSettings, SafetyLimits):
        for name, (_, description) in fields_of(part).items():
            at = lines.index(f"# {description.meaning}")
            assert lines[at + 1].strip("# ") in {f"{name} =", f"[limits.{name}]"}
    assert max(map(len, lines)) <= 100


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
def test_a_profile_is_for_its_owner(path: Path) -> None:
    ProfileFile("rex").save(FULL)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    path.chmod(0o644)
    ProfileFile("rex").save(FULL)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@given(TEXTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@example("\x1b]0;owned\a")
@example('"""\n[settings]\ndepth = 64\n')
def test_hostile_text_stays_text(text: str) -> None:
    profile = BoardProfile(
        identity=BoardIdentityRecord(serial_number=text), evidence={"depth": Evidence("guess", text)}
    )
    written = format_profile("rex", profile)
    assert parse_profile(written) == profile
    assert escape(written.replace("\n", "")) == written.replace("\n", "")


DAMAGES = [
    ("depth = 900", 1, "'depth' is unknown; the file can have identity, settings, limits, evidence"),
    ("[settings]\ndepth = 900", 2, "depth must be 1..64, not 900"),
    ("[settings]\r\n\r\ndepth = true", 3, "depth must be 1..64, not true"),
    ("[settings]\n'depth' = 4.5", 2, "depth must be 1..64, not 4.5"),
    ("settings.depth = 0", 1, "depth must be 1..64, not 0"),
    ("\nsettings = {depth = 0}", 2, "depth must be 1..64, not 0"),
    ("[settings]\nx = '''\ndepth = 3\n'''\ndepth = 0", 2, "'x' is unknown; [settings] can have byte_order, "),
    ("[settings]\ncaption_encoding = '''\nno\ndepth = 3'''", 2, "caption_encoding: caption encoding "),
    ("[identity]\nserial_number = '''\n[settings]\ndepth = 3'''\n[settings]\ndepth = 0", 6, "depth must be 1..64, "),
    ("[settings]\nbyte_order = 'x'", 2, 'byte_order must be "little" or "big", not \'x\''),
    ("[settings]\n# why\nmemory_unit = 2", 3, "memory_unit must be 1 or 1024, not 2"),
    ("[settings]\nturnaround = nan", 2, "turnaround must be 0..3600 seconds, not nan"),
    ("[settings]\ncaption_encoding = 'no'", 2, "caption_encoding: caption encoding 'no' cannot be used; choose one "),
    ("[settings]\nunsupported = ['QueryX']", 2, "unsupported: 'QueryX' is not a query of the protocol; the queries "),
    ("[settings]\nunsupported = 3", 2, "unsupported must be a list of queries, not 3"),
    ("[identity]\nservo_ids = [\n1,\n255]", 2, "servo_ids must be a list of servo ids, 0..254, not [1, 255]"),
    ("identity = 3", 1, "identity must be a table, not 3"),
    ("[limits]\nspeed_cap = inf", 2, "speed_cap must be 0.001..100000 degrees per second, not inf"),
    ("[limits]\nsoft_start = 0", 2, "soft_start must be 0.001..100000 degrees per second, not 0"),
    ("[limits.angles]\n3 = [20]", 2, "angles.3 must be the lowest and the highest angle in degrees, such as "),
    ("[limits.angles]\n1 = [1, 2]\n3 = [160, 20]", 3, "angles.3: no angle is within 160..20; write the lowest angle "),
    ("[limits.angles]\n255 = [1, 2]", 2, "angles.255 must be a servo id, 0..254, not 255"),
    ("[limits.speed_caps]\narm = 3", 2, "speed_caps.arm must be a servo id, 0..254, not 'arm'"),
    ("[limits.speed_caps]\n1 = 3\n01 = 5", 3, "speed_caps.01 must be a servo id, 0..254, not '01'"),
    ("[evidence.depth]\nconfidence = 'certain'", 1, "text is missing in [evidence.depth]"),
    (
        "[evidence.depth]\ntext = ''\nconfidence = 'sure'",
        3,
        'depth.confidence must be "certain", "likely" or "guess", ',
    ),
    ("[evidence.deep]", 1, "evidence.deep: is not a setting; the settings are byte_order, "),
    ("[settings]\n\ndepth = ", 3, "is not TOML: Invalid value"),
    ("[settings]\ndepth = 1\ndepth = 2", 3, "is not TOML: Cannot overwrite a value"),
    ("[settings", 1, "is not TOML: Expected ']' at the end of a table declaration"),
    ("a = '\x07'", 1, "is not TOML: Found invalid character '\\x07'"),
    (f"a = 1\nb = {'9' * 5000}", 2, "is not TOML: a number or a date is impossible"),
    (f"a = {'[' * 3000}", 1, "is nested too deeply"),
    (f"# {'.' * 2000}\n{'a.' * 30_000}b = 1", 2, "has 1,000 dots or more in line 2"),
]


@pytest.mark.parametrize(("text", "line", "reason"), DAMAGES)
def test_a_damaged_profile_is_refused_by_file_and_line(text: str, line: int, reason: str, path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(ProfileError) as refused:
        ProfileFile("rex").load()
    assert str(refused.value).startswith(f"{path}, line {line}: {reason}")


def test_other_bytes_than_text_are_refused(path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.write_bytes(b"\xef\xbb\xbf[settings]\ndepth = 2\n")
    assert ProfileFile("rex").load() == BoardProfile(settings=BoardSettings(depth=2))
    path.write_bytes(b"[settings]\n# \xff\n")
    with pytest.raises(ProfileError, match=r"rex\.toml, line 2: is not text in UTF-8; save the file as UTF-8$"):
        ProfileFile("rex").load()


@pytest.mark.skipif(sys.platform == "win32", reason="links and pipes of POSIX")
def test_what_is_no_file_is_refused_at_once(path: Path) -> None:
    path.mkdir(parents=True)
    _refused("Is a directory")
    path.rmdir()
    os.mkfifo(path)
    _refused("is not a regular file")
    path.unlink()
    path.symlink_to(path)
    _refused("Too many levels of symbolic links")
    with pytest.raises(ProfileError, match="cannot be written: Too many levels"):
        ProfileFile("rex").save(FULL)
    path.unlink()
    path.symlink_to("nothing")
    _refused("the link leads to no file")
    path.unlink()
    path.write_bytes(b"#" * (1 << 16) + b"\n")
    _refused("is larger than 65,536 bytes, the limit")
    path.unlink()
    path.parent.rmdir()
    path.parent.touch()
    _refused("Not a directory")


def _refused(why: str) -> None:
    with pytest.raises(ProfileError) as refused:
        ProfileFile("rex").load()
    assert str(refused.value).startswith(f"{ProfileFile('rex').path} cannot be used: {why}")


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_damaged_anywhere_is_read_or_refused_by_line(data: st.DataObject) -> None:
    text = format_profile("rex", FULL)
    at = data.draw(st.integers(0, len(text)))
    text = text[:at] + data.draw(TEXTS) + text[data.draw(st.integers(at, len(text))) :]
    assert 1 <= _damaged_line(text) <= text.count("\n") + 1


def _damaged_line(text: str) -> int:
    try:
        parse_profile(text)
    except TextError as error:
        return error.line
    return 1


@pytest.mark.parametrize(
    "profile",
    [
        BoardProfile(settings=BoardSettings(depth=900)),
        BoardProfile(limits=SafetyLimits(angles={3: (20, 10)})),
        BoardProfile(evidence={"deep": Evidence("guess", "")}),
    ],
)
def test_what_could_not_be_read_again_is_not_written(profile: BoardProfile, path: Path) -> None:
    ProfileFile("rex").save(FULL)
    with pytest.raises(ValueError, match=r"must be 1\.\.64|no angle is within|is not a setting"):
        ProfileFile("rex").save(profile)
    assert ProfileFile("rex").load() == FULL


def test_a_profile_is_removed_damaged_or_not(path: Path) -> None:
    assert not ProfileFile("rex").remove()
    ProfileFile("rex").save(FULL)
    path.write_text("damaged")
    assert ProfileFile("rex").remove()
    assert ProfileFile("rex").load() is None
    path.mkdir()
    with pytest.raises(ProfileError, match="cannot be removed"):
        ProfileFile("rex").remove()


@pytest.mark.parametrize("name", ["", "../rex", "a/b", "x.toml", "COM3", "\x1b"])
def test_a_profile_has_the_name_of_a_board(name: str) -> None:
    with pytest.raises(ProfileError, match="cannot be a board's name: names have only letters"):
        ProfileFile(name).load()


def test_a_user_without_a_home_has_no_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_home(monkeypatch)
    assert ProfileFile("rex").load() is None
    assert ProfileFile.names() == []
    with pytest.raises(ProfileError, match=r"profiles of boards cannot be stored: could not .* set HOME"):
        ProfileFile("rex").save(FULL)


def test_all_queries_are_known() -> None:
    assert {"QueryMemorySize", "QueryServo", "QueryProjectID", "QueryActiveJoystickTable"} <= query_names()
    assert len(query_names()) == 13


def test_the_documentation_shows_the_whole_file() -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/learn-a-board.md").read_text(encoding="utf-8")
    shown = page.partition("```toml\n")[2].partition("```")[0]
    profile = parse_profile(shown)
    assert profile.identity is not None
    for part in (profile.identity, profile.settings, profile.limits):
        assert None not in [getattr(part, name) for name in part.__struct_fields__]
    assert shown == format_profile("rex", profile).partition("unknown.\n\n")[2]
