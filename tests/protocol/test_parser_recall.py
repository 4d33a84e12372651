"""Every intact frame on a damaged line is found; `python -m benchmarks recall` tries 400,000 frames."""

from __future__ import annotations

import pytest

from benchmarks.streams import lucky_line
from benchmarks.textbook import TextbookParser
from servolink.protocol.frame import encode_frame
from servolink.protocol.parser import FrameParser
from tests.proofs.recall import Recall, measure


@pytest.mark.parametrize("seed", [434, 1000, 3000, 4002])
def test_recall_is_exactly_all(seed: int) -> None:
    recall = measure(FrameParser, 10_000, seed)
    assert recall.intact == 10_000
    assert recall.complete
    assert recall.false < 100


def test_hardly_any_is_lost_where_every_damaged_frame_has_the_right_sum() -> None:
    recall, textbook = (measure(kind, 4_000, line=lucky_line) for kind in (FrameParser, TextbookParser))
    assert recall.found >= 3_992
    assert textbook.found < 2_800


def test_the_measure_sees_losses() -> None:
    recall = measure(TextbookParser, 2000)
    assert not recall.complete
    assert recall.found < recall.intact


def test_the_measure_sees_losses_doubles_and_disorder() -> None:
    frames = [(10020, b""), (10010, b"\1")]
    sent = [encode_frame(*frame, "big") for frame in frames]
    for came, expected in (
        (frames, Recall(intact=2, found=2)),
        (frames[::-1], Recall(intact=2, found=2, disordered=1)),
        (frames[:1] * 2, Recall(intact=2, found=1, false=1, disordered=1)),
    ):
        recall = Recall()
        recall.add(sent, came, "big")
        assert recall == expected
        assert recall.complete is (came == frames)
