"""A program asks before it moves the robot, and the person at a page of the studio answers: in a real browser."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from servolink.errors import ServolinkError
from servolink.gateways import supervised
from tests.studio.browser import Studio, in_browser, new_profile, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

TARGET = 15


async def move() -> str:
    """Ask in the studio and move servo 2; return what came of it."""
    async with supervised("virtual", may_move=True, speed_cap=60.0, log=lambda line: None) as supervisor:
        try:
            motion = await supervisor.check_move({"2": TARGET}, 0.5, None)
            await supervisor.perform(await supervisor.ask_in_studio(motion))
        except ServolinkError as error:
            return str(error)
    return "moved"


def asked(pool: ThreadPoolExecutor) -> Future[str]:
    """Begin to ask, beside Playwright, which has an event loop of its own."""
    return pool.submit(asyncio.run, move())


def test_a_person_allows_or_refuses_a_motion_and_stop_is_a_no(studio: Studio, browser: Any) -> None:
    before = studio.angle(2)
    assert before != TARGET
    with ThreadPoolExecutor() as pool, opened(browser, studio.url) as page:
        page.get_by_label("Target of servo 2,").wait_for()
        note = page.get_by_role("alert").filter(has_text="asks to move the robot")
        for button, outcome in (("Refuse", "the person said no"), ("Allow once", "moved")):
            moving = asked(pool)
            expect(note).to_contain_text(f"to {TARGET}°, in 0.50 s.")
            assert studio.angle(2) == before
            note.get_by_role("button", name=button).click()
            assert outcome in moving.result()
            expect(note).to_have_count(0)
        assert studio.angle(2) == TARGET
        moving = asked(pool)
        expect(note).to_be_visible()
        page.locator(".stop:visible").click()
        assert "stop" in moving.result()
        expect(note).to_have_count(0)


@pytest.mark.parametrize(
    ("locale", "title", "key", "outcome"),
    [
        ("zh-CN", "请求移动机器人", "Enter", "the person said no"),
        ("zh-TW", "想要移動機器人", "Escape", "a stop came first"),
    ],
)
def test_the_question_is_in_the_language_of_the_page_and_answered_with_keys(
    studio: Studio, browser: Any, locale: str, title: str, key: str, outcome: str
) -> None:
    profile = new_profile(browser, "phone", locale=locale)
    with ThreadPoolExecutor() as pool, opened(browser, studio.url, profile=profile) as page:
        page.locator(".stop:visible").wait_for()
        page.evaluate("document.querySelector('main').scrollTop = 10_000")
        moving = asked(pool)
        note = page.get_by_role("alert").filter(has_text=title)
        expect(note).to_be_in_viewport()
        page.locator(".stop:visible").click(trial=True)
        note.get_by_role("button").last.focus()
        page.keyboard.press(key)
        assert outcome in moving.result()
