"""Each connection begins with the same handshake, so that byte counts mean the same place each time."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from servolink.connection import opener


@pytest.fixture(scope="package", autouse=True)
def _same_handshake() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opener, "random_of", lambda _: Random(1))
        yield
