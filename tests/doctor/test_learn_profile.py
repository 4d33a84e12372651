"""What was measured is merged into what is kept.

Module: servolink.doctor.learn_captions.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.boards import (
    BoardIdentityRecord,
    BoardProfile,
    BoardSettings,
    Confidence,
    Evidence,
    Measured,
    SafetyLimits,
    format_profile,
    parse_profile,
)
from servolink.doctor.learn_captions import encoding_finding

NOW, BEFORE = datetime(2026, 2, 1, tzinfo=UTC), datetime(2026, 1, 1, tzinfo=UTC)
REX = BoardIdentityRecord(servo_ids=(1, 2), memory_total=65536)


@pytest.mark.parametrize(
    ("kept", "evidence", "found", "confidence", "result"),
    [
        (None, None, 4, "guess", 4),
        (8, "likely", 4, "certain", 4),
        (8, "certain", 4, "guess", 4),  # the board does not do what it did
        (8, "certain", 8, "guess", 8),
        (8, "certain", None, "guess", 8),
        (8, None, 4, "likely", 8),  # the user has set it
        (8, None, 4, "certain", 4),
    ],
)
def test_which_finding_is_kept(
    kept: int | None, evidence: Confidence | None, found: int | None, confidence: Confidence, result: int
) -> None:
    old = {"depth": Evidence(evidence, "old", BEFORE)} if evidence else {}
    profile = BoardProfile(settings=BoardSettings(depth=kept, clear="all"), evidence=old)
    merged = profile.merged([Measured("depth", found, confidence, "new")], REX, NOW)
    assert merged.settings == BoardSettings(depth=result, clear="all")
    is_new = found is not None and (result != kept or evidence is None)
    assert merged.evidence == ({"depth": Evidence(confidence, "new", NOW)} if is_new and result == found else old)
    assert merged.identity == REX


ANYTHING = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.integers(-2, 70)
    | st.floats()
    | st.text(st.characters(exclude_categories=["Cs"]))
    | st.sampled_from(["little", "big", "all", "silent", "replace", "stays", "keep", "utf-8", "QueryAction"])
    | st.lists(st.integers(-1, 256)).map(tuple)
    | st.lists(st.sampled_from(["QueryAction", "QueryMacro", "Query", ""])).map(tuple)
)


@given(st.dictionaries(st.sampled_from(BoardSettings.__struct_fields__), ANYTHING), st.data())
def test_whatever_was_measured_can_be_saved(values: dict[str, Any], data: st.DataObject) -> None:
    measured = [Measured(name, value, "certain", "measured") for name, value in values.items()]
    found = {name: data.draw(ANYTHING, name) for name in BoardIdentityRecord.__struct_fields__}
    profile = BoardProfile().merged(measured, BoardIdentityRecord.of(**found), NOW)
    assert parse_profile(format_profile("rex", profile)) == profile
    for each in measured:
        assert getattr(profile.settings, each.setting) == each.value
        assert each.value is not None or values[each.setting] is None or "too unlikely to be saved" in each.evidence


@pytest.mark.parametrize(("field", "value"), [("memory_total", -1), ("servo_ids", (1, 255)), ("vendor_id", 1 << 16)])
def test_an_identity_is_kept_without_what_no_board_has(field: str, value: Any) -> None:
    assert BoardIdentityRecord.of(**{"serial_number": "A1", field: value}) == BoardIdentityRecord(serial_number="A1")


def test_what_was_set_by_hand_is_replaced_only_by_what_is_certain() -> None:
    by_hand = {"depth": Evidence("certain", Evidence.BY_HAND, BEFORE)}
    profile = BoardProfile(settings=BoardSettings(depth=8), evidence=by_hand)
    assert profile.merged([Measured("depth", 4, "likely", "new")], REX, NOW).settings.depth == 8
    assert profile.merged([Measured("depth", 4, "certain", "new")], REX, NOW).settings.depth == 4


def test_equal_evidence_is_renewed_and_limits_stay() -> None:
    limits = SafetyLimits(speed_cap=90, angles={1: (0, 90)})
    profile = BoardProfile(
        settings=BoardSettings(depth=8), limits=limits, evidence={"depth": Evidence("certain", "old", BEFORE)}
    )
    merged = profile.merged([Measured("depth", 8, "certain", "new")], REX, NOW)
    assert merged.evidence == {"depth": Evidence("certain", "new", NOW)}
    assert merged.limits == limits


def test_what_is_not_found_of_the_identity_stays() -> None:
    found = BoardIdentityRecord(servo_ids=(1, 2), serial_number="A1")
    merged = BoardProfile(identity=REX).merged([], found, NOW)
    assert merged.identity == BoardIdentityRecord(servo_ids=(1, 2), memory_total=65536, serial_number="A1")


def test_boards_differ_where_both_are_known() -> None:
    assert BoardIdentityRecord(servo_ids=(2, 1)).fits(REX)
    assert REX.fits(BoardIdentityRecord(memory_total=65536, serial_number="A1"))
    assert not REX.fits(BoardIdentityRecord(servo_ids=(1, 2, 3), memory_total=65536))


@pytest.mark.parametrize(
    ("captions", "encoding", "found"),
    [
        (["挥手", "左手"], "gbk", ("gb18030", "certain")),
        (["走"], "gbk", ("gb18030", "likely")),
        (["揮手"], "big5", ("big5", "likely")),
        (["Grüße", "Füße"], "utf-8", ("utf-8", "certain")),
        (["👋 hi"], "utf-8", ("utf-8", "likely")),
        (["挥手", "wave"], "utf-16-be", ("utf-16-be", "likely")),
        (["挥手"], "utf-16-le", (None, "guess")),  # the same bytes as "%cKb"
        (["손 흔들기", "왼손"], "euc_kr", ("euc_kr", "likely")),
        (["手を振る", "歩く", "お辞儀", "左腕"], "shift_jis", ("shift_jis", "certain")),
        (["齧る", "蹲踞", "跋扈"], "shift_jis", ("shift_jis", "certain")),
        (["手を振る", "歩く", "お辞儀", "左腕"], "euc_jp", ("euc_jp", "certain")),
        (["Привет", "Шаг вперёд"], "cp1251", (None, "guess")),
        (["Grüße"], "latin-1", (None, "guess")),
        (["wave", ""], "utf-8", (None, "guess")),
        ([], "utf-8", (None, "guess")),
    ],
)
def test_encodings_of_captions(captions: list[str], encoding: str, found: Any) -> None:
    measured = encoding_finding([caption.encode(encoding).ljust(32, b"\0") for caption in captions])
    assert (measured.value, measured.confidence) == found


@pytest.mark.parametrize("padding", [b"\0", b"\xff", b" "])
@pytest.mark.parametrize("size", [32, 31, 15])
@pytest.mark.parametrize(
    ("captions", "encoding"),
    [
        (["x揮手", "x走路", "x鞠躬", "x左手"], "utf-8"),
        (["x挥手", "x走路", "x鞠躬", "x左手"], "gb18030"),
        (["x揮手", "x走路", "x鞠躬", "x左手"], "big5"),
        (["xお辞儀", "x左腕", "x蹴る"], "shift_jis"),
        (["x걷기", "x왼손들기", "x인사하기"], "euc_kr"),
        (["揮手", "走路", "鞠躬", "左手"], "utf-16-le"),
    ],
)
def test_cut_characters_and_padding_hide_no_encoding(
    captions: list[str], encoding: str, size: int, padding: bytes
) -> None:
    for times in (1, 20):
        stored = [(caption * times).encode(encoding)[:size].ljust(32, padding) for caption in captions]
        assert encoding_finding(stored).value == encoding
