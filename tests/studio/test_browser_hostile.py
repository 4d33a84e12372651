"""Captions that try to be more than text, in every screen: 450 of them on one board."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.proofs.hostile.corpus import PAYLOADS, controls
from tests.proofs.hostile.world import World
from tests.studio.browser import SCREENS, Studio, in_browser, opened, running, show

pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")

pytestmark = in_browser

WIDTHS = (320, 1440)
_EVERY_TEXT = """() => {
  const found = [document.title, document.body.innerText];
  for (const element of document.querySelectorAll("*")) {
    for (const { value } of element.attributes) found.push(value);
    if ("value" in element) found.push(String(element.value));
    if (element.tagName === "OPTION") found.push(element.text);
  }
  return found.join("\\n");
}"""
_CHANGE_ALL = """async () => {
  const { edit } = await import("/state/project.js");
  const without = (records, part) => records.map((record) => ({ ...record, [part]: [] }));
  edit(["edit.did_keep_mine", { name: "" }], (project) => ({
    ...project,
    actions: without(project.actions, "steps"),
    macros: without(project.macros, "commands"),
    joystick_tables: without(project.joystick_tables, "buttons"),
  }));
}"""
_STRANGE = (
    "script:not([src='app.js']), iframe, object, embed, base, body img, [onerror], [onload], [href^='javascript:' i]"
)
_MEETS = """() => {
  const labels = [...document.querySelectorAll(".padsvg .lab")].map((label) => label.getBoundingClientRect());
  const pad = document.querySelector(".padsvg").getBoundingClientRect();
  const isBeside = (one, other) => one.right <= other.left || other.right <= one.left;
  const gap = 5; // of the lines above and below small letters
  const isBelow = (one, other) => one.bottom - gap <= other.top || other.bottom - gap <= one.top;
  const meet = (one, other) => !isBeside(one, other) && !isBelow(one, other);
  const isOutside = labels.some(({ left, right }) => left < pad.left || right > pad.right);
  const doMeet = labels.some((one, at) => labels.slice(at + 1).some((other) => meet(one, other)));
  return labels.length < 12 || isOutside || doMeet;
}"""
_LONGEST = """async () => {
  const { edit } = await import("/state/project.js");
  const macro = (macro_id) => ({ macro_id, macro_caption: "W".repeat(32), commands: [] });
  const free = { button_caption: "", button_long_press_macro: 0, button_up_macro: 0, uninterruptible: 0 };
  const buttons = Array.from({ length: 12 }, (_, at) => ({ ...free, button_id: at + 1, button_press_macro: 1 }));
  const joystick_tables = [{ table_id: 1, table_caption: "", buttons }];
  const made = { macros: [macro(1)], joystick_tables, active_joystick_table: 1 };
  edit(["edit.did_keep_mine", { name: "" }], (project) => ({ ...project, ...made }));
}"""
_FITS = "document.documentElement.scrollWidth <= innerWidth && document.body.scrollWidth <= innerWidth"


def test_hostile_captions_are_text_on_every_screen(tmp_path: Path, user: Path, browser: Any) -> None:
    world = World.hostile(tmp_path / "world")
    world.build()
    with running("--board", world.url("all"), "studio") as url, opened(browser, url) as page:
        page.on("dialog", lambda dialog: pytest.fail(dialog.message))
        for screen in SCREENS:
            show(page, screen)
            check(page, screen)
            for pressed in page.locator(".pose, .mrow").all()[3 :: len(PAYLOADS) // 4]:
                pressed.click()
                check(page, screen)
        page.evaluate(_CHANGE_ALL)
        show(page, "Project")
        page.get_by_text("<script>").first.wait_for()
        check(page, "Project")


def test_long_names_of_macros_meet_nothing_on_the_pad(studio: Studio, browser: Any) -> None:
    for size in ("desktop", "tablet"):
        with opened(browser, studio.url, size) as page:
            show(page, "Buttons")
            page.evaluate(_LONGEST)
            page.locator(".padsvg .lab").nth(11).wait_for()
            assert not page.evaluate(_MEETS)


def check(page: Any, screen: str) -> None:
    assert not controls(page.evaluate(_EVERY_TEXT)), screen
    assert page.locator(_STRANGE).count() == 0, screen
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate(_FITS), (screen, width)
