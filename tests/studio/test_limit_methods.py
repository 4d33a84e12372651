"""Limits of servos that a page keeps in the profile of the board.

Module: servolink.studio.limit_methods.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from threading import Barrier, BrokenBarrierError
from typing import Any

import pytest

from servolink.boards import Alias, Aliases, BoardProfile, ProfileFile, SafetyLimits
from tests.studio.serving import Place, call, run, welcomed


@pytest.fixture(autouse=True)
def config(user: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give profiles and names a folder of their own."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(user / "config"))


async def saved(place: Place, servo: int, low: float | None, high: float | None) -> dict[str, Any]:
    async with place.page() as page:
        await welcomed(page, place.gate.new_token("edit"))
        return await call(page, "studio.limits.save", servo=servo, low=low, high=high)


def test_limits_are_added_to_the_profile_and_removed_again() -> None:
    ProfileFile("virtual").save(BoardProfile(limits=SafetyLimits(speed_cap=90, angles={1: (-10, 10)})))

    async def test(place: Place) -> None:
        assert (await saved(place, 3, -20, 30))["result"] == {"angles": {"1": [-10, 10], "3": [-20, 30]}}
        profile = ProfileFile("virtual").load()
        assert profile is not None
        assert profile.limits == SafetyLimits(speed_cap=90, angles={1: (-10, 10), 3: (-20, 30)})
        assert (await saved(place, 1, None, None))["result"] == {"angles": {"3": [-20, 30]}}

    run(test)


def test_a_board_with_a_name_and_no_profile_gets_a_profile() -> None:
    Aliases.save("virtual", Alias("tcp://robot:1"))

    async def test(place: Place) -> None:
        assert "result" in await saved(place, 3, -20, 30)
        assert ProfileFile("virtual").load() is not None

    run(test)


def test_limits_of_a_board_without_a_name_are_refused_with_a_remedy() -> None:
    async def test(place: Place) -> None:
        error = (await saved(place, 3, -20, 30))["error"]
        assert "has no name" in error["message"]
        assert "servolink name" in error["data"]["remedy"]
        assert ProfileFile("virtual").load() is None
        assert "above the highest" in (await saved(place, 3, 30, -20))["error"]["message"]

    run(test)


def test_pages_that_save_together_keep_the_limits_of_both(monkeypatch: pytest.MonkeyPatch) -> None:
    ProfileFile("virtual").save(BoardProfile())
    both = Barrier(2)

    load = ProfileFile.load

    def load_with_another(file: ProfileFile) -> BoardProfile | None:
        with suppress(BrokenBarrierError):
            both.wait(0.1)
        return load(file)

    monkeypatch.setattr(ProfileFile, "load", load_with_another)

    async def test(place: Place) -> None:
        await asyncio.gather(*(saved(place, servo, -20, 30) for servo in (3, 4)))
        profile = ProfileFile("virtual").load()
        assert profile is not None
        assert profile.limits.angles == {3: (-20, 30), 4: (-20, 30)}

    run(test)


def test_limits_belong_to_the_board_of_the_page_also_while_the_studio_changes_it() -> None:
    for name in ("virtual", "other"):
        ProfileFile(name).save(BoardProfile())

    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            place.studio.begin("other")
            assert "result" in await call(page, "studio.limits.save", servo=3, low=-20, high=30)
        assert ProfileFile("other").load() == BoardProfile()
        profile = ProfileFile("virtual").load()
        assert profile is not None
        assert profile.limits.angles == {3: (-20, 30)}

    run(test)
