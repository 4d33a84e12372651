"""Faults that a fuzzer once found stay fixed."""

from __future__ import annotations

import pytest

from tests.proofs.fuzz.recorded import RECORDED, Recorded
from tests.proofs.fuzz.targets import TARGETS


@pytest.mark.parametrize("one", RECORDED, ids=lambda one: f"{one.target}: {one.wrong}")
def test_a_finding_stays_fixed(one: Recorded) -> None:
    TARGETS[one.target].check(one.data)
