"""Boards of the firmware for the tests here."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.firmware.host import HARDWARE, LIBRARY, HostBoard, compile_once, load
from tests.firmware.test_core import READY, move


@pytest.fixture(scope="session")
def functions(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the firmware as a library."""
    return load(compile_once(tmp_path_factory, "board.so", [HARDWARE], *LIBRARY))


@pytest.fixture
def board(functions: Any) -> Iterator[HostBoard]:
    """Return a board that was just switched on."""
    made = HostBoard(functions)
    yield made
    made.close()


@pytest.fixture
def ready(board: HostBoard) -> HostBoard:
    """Return a board whose servos stand at 0 degrees."""
    board.ask(READY)
    board.receive(move(*((servo, 0, 0) for servo in range(1, 17))))
    board.run(1.1)
    assert board.pulses == [1500] * 16
    return board
