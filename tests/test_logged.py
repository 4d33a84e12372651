"""What tests find in the log is theirs, not what asyncio says of an earlier test."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import pytest


async def _fail() -> None:
    raise ValueError("nobody waits for this")


async def _leave_an_error() -> None:
    task = asyncio.create_task(_fail())
    await asyncio.wait((task,))


def test_a_log_is_without_what_asyncio_says(caplog: pytest.LogCaptureFixture) -> None:
    asyncio.run(_leave_an_error())
    logging.getLogger("servolink.client").warning("ours")
    assert caplog.messages == ["ours"]


def test_warnings_are_those_of_the_package_and_of_asyncio(warnings_logged: Callable[[], list[str]]) -> None:
    logging.getLogger("servolink.client").warning("ours")
    logging.getLogger("servolink.client").info("no warning")
    asyncio.run(_leave_an_error())
    ours, theirs = warnings_logged()
    assert ours == "ours"
    assert theirs.startswith("Task exception was never retrieved")
