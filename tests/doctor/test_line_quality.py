"""What is made of the responses to sixty queries."""

from __future__ import annotations

import pytest

from servolink.doctor.line_quality import REQUESTS, LineCounts, check_line
from servolink.protocol import encode_frame


@pytest.mark.parametrize(
    ("unanswered", "late", "observation"),
    [
        (0, 0, ""),
        (0, 2, ""),  # the computer stood still for a moment
        (0, 3, "0 of 60 queries had no response in 0.5 s, and 3 responses came late"),
        (1, 0, "1 of 60 queries had no response in 0.5 s"),
        (1, 1, "1 of 60 queries had no response in 0.5 s, and 1 response came late"),
    ],
)
def test_a_few_late_responses_count_only_beside_missing_ones(unanswered: int, late: int, observation: str) -> None:
    line = LineCounts(900, 0, REQUESTS, unanswered, late, (0.001,) * REQUESTS)
    assert [finding.observation for finding in check_line(line)] == [observation] * bool(observation)


@pytest.mark.parametrize(
    ("between", "words"),
    [
        ([b"\r\n"] * 9, "marks the ends of frames"),
        ([b"\xc0\xc0"] * 9, "marks the ends of frames"),
        ([b"\xc0"] * 3, "the line damages bytes"),
        ([bytes((40 * at,)) for at in range(1, 6)] * 2, "the line damages bytes"),
    ],
)
def test_the_same_bytes_between_all_frames_are_no_damage(between: list[bytes], words: str) -> None:
    frame = encode_frame(30131, b"\x92\x10\0\0", "little")
    received = b"".join(frame + each for each in between) + frame
    noise = sum(map(len, between))
    line = LineCounts(len(received), noise, REQUESTS, 0, 0, (0.001,) * REQUESTS, received=received)
    (found,) = check_line(line)
    assert words in found.meaning
    assert ("cable" in found.remedy) == ("damages" in words)
