"""Each connection begins with the same handshake, so that byte counts mean the same place each time."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="package", autouse=True)
def _same_handshake() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "urandom", bytes)  # from which the first connection draws its queries
        yield
