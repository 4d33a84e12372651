"""Lines about what passes fit the terminal."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.cli.developers.spy import PacketPrinter, shortened
from servolink.cli.screen.output import text_width
from servolink.doctor import Learner
from servolink.protocol import Codec, QueryServoResponse, encode_frame


@given(st.text(st.characters(categories=("L", "N", "P", "Zs")), max_size=120), st.integers(10, 90))
def test_a_line_is_cut_to_the_columns_that_there_are(text: str, columns: int) -> None:
    line = shortened(text, columns)
    assert text_width(line) <= columns
    assert line == text or (line.endswith("...") and text.startswith(line[:-3]) and text_width(line) > columns - 3)


def test_what_is_no_good_packet(capsys: pytest.CaptureFixture[str]) -> None:
    learner, lines = Learner(), PacketPrinter()
    damaged = Codec().encode(QueryServoResponse())[:-1] + b"\xff"
    lying = encode_frame(QueryServoResponse.packet_id, b"\2" + bytes(11), "little")
    for passed in learner.feed(5.0, "received", b"noise" + damaged + lying + damaged[:3]) + learner.finish(5.0):
        lines.show(passed)
    assert capsys.readouterr().out.splitlines() == [
        "    0.000  board    5 bytes outside of frames: 6e6f697365",
        f"    0.000  board    packet 20021 with a wrong checksum: {damaged.hex()}",
        f"    0.000  board    packet 20021 whose content contradicts itself: {lying[:16].hex()}...",
        f"    0.000  board    3 bytes outside of frames: {damaged[:3].hex()}",
    ]
