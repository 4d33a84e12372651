"""Questions to a person at another program: one yes for one motion, void after a stop, and no without an answer.

Modules: servolink.hub.engine.questions, servolink.hub.methods.question_methods.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared

MOVE = {"seconds": 2.0, "targets": {"1": 30}}


@asynccontextmanager
async def asking() -> AsyncIterator[tuple[Shared, RpcProgram, RpcProgram]]:
    """Connect a program that asks, and a page that shows questions."""
    async with shared() as here, here.program("model", "move") as model, here.program("page", "move") as page:
        await page.call("question.show")
        yield here, model, page


@pytest.mark.parametrize("is_yes", [True, False])
async def test_the_answer_at_one_page_reaches_the_program_and_ends_the_question_everywhere(is_yes: bool) -> None:
    async with asking() as (here, model, page):
        answer = model.begin("question.ask", **MOVE)
        question = await page.until("question")
        expected = {"number": 1, "who": "model", "seconds": 2.0, "targets": {"1": 30.0}, "record": None, "caption": ""}
        assert question == {**expected, "warning": ""}
        async with here.program("late page") as late, here.program("watcher", "watch") as watcher:
            await late.call("question.show")
            assert await late.until("question") == question
            with pytest.raises(RpcFailed, match="needs the role move"):
                await watcher.call("question.answer", number=1, is_yes=True)
            await late.call("question.answer", number=1, is_yes=is_yes)
            assert await answer == {"is_yes": is_yes, "by": "late page"}
            assert await page.until("question.over") == await late.until("question.over") == {"number": 1}
            with pytest.raises(RpcFailed, match="not open any more"):
                await page.call("question.answer", number=1, is_yes=True)
            assert watcher.heard == []
        assert model.of("question") == []


@pytest.mark.parametrize(
    ("end", "why"),
    [
        ("stop", "a stop came first"),
        ("silence", "nobody has answered within 30 s"),
        ("withdrawal", "was withdrawn"),
        ("other question", "was withdrawn"),
        ("page", "was closed"),
    ],
)
async def test_a_question_without_an_answer_moves_nothing(end: str, why: str) -> None:
    async with asking() as (_, model, page):
        answer = model.begin("question.ask", **MOVE)
        await page.until("question")
        if end == "stop":
            await page.call("stop")
        elif end == "withdrawal":
            await model.call("question.withdraw")
        elif end == "other question":
            model.tell("question.ask", seconds=1.0)
        elif end == "page":
            await page.channel.close()
        with pytest.raises(RpcFailed, match=why) as failed:
            await answer
        assert failed.value.kind == "MotionRefused"
        if end != "page":
            assert await page.until("question.over") == {"number": 1}


async def test_a_program_is_asked_about_only_by_others() -> None:
    async with shared() as here, here.program("model", "move") as model:
        with pytest.raises(RpcFailed, match="nobody can be asked") as failed:
            await model.call("question.ask", **MOVE)
        assert failed.value.kind == "NotFound"
        await model.call("question.show")
        with pytest.raises(RpcFailed, match="nobody can be asked"):
            await model.call("question.ask", **MOVE)
        async with here.program("page") as page:
            await page.call("question.show")
            answer = model.begin("question.ask", **MOVE)
            await page.until("question")
            with pytest.raises(RpcFailed, match="not open"):
                await model.call("question.answer", number=1, is_yes=True)
            await page.call("question.answer", number=1, is_yes=True)
            assert (await answer)["is_yes"]


async def test_an_answer_counts_only_from_a_program_that_was_shown_the_question() -> None:
    async with asking() as (here, model, page), here.program("somebody", "edit") as other:
        answer = model.begin("question.ask", **MOVE)
        question = await page.until("question")
        with pytest.raises(RpcFailed, match="was not shown here") as failed:
            await other.call("question.answer", number=question["number"], is_yes=True)
        assert failed.value.kind == "NotFound"
        assert not answer.done()
        with pytest.raises(RpcFailed, match="not open"):  # of the next question, which nobody has seen yet
            await page.call("question.answer", number=question["number"] + 1, is_yes=True)
        await page.call("question.answer", number=question["number"], is_yes=True)
        assert (await answer)["by"] == "page"


async def test_another_connection_of_the_program_that_asks_answers_nothing_for_a_person() -> None:
    async with asking() as (here, model, page), here.program("second", "edit") as second:
        await second.call("question.show")
        await second.call("rename", who="model")  # a program names all its connections alike
        answer = model.begin("question.ask", **MOVE)
        number = (await second.until("question"))["number"]
        with pytest.raises(RpcFailed, match="not open"):
            await second.call("question.answer", number=number, is_yes=True)
        await page.channel.close()
        here.hub.questions.withdraw("session of model")
        with pytest.raises(RpcFailed, match="was withdrawn"):
            await answer
        with pytest.raises(RpcFailed, match="nobody can be asked"):
            await model.call("question.ask", **MOVE)


async def test_a_program_that_joins_the_session_of_a_page_does_not_answer_as_the_page() -> None:
    async with asking() as (here, model, page):
        answer = model.begin("question.ask", **MOVE)
        number = (await page.until("question"))["number"]
        session = page.channel.control.session  # `status` lists it
        async with here.program("model", "move", session) as disguised:
            for method, params in (("answer", {"number": number, "is_yes": True}), ("show", {}), ("ask", MOVE)):
                with pytest.raises(RpcFailed, match="belongs to a program that has a board of its own"):
                    await disguised.call(f"question.{method}", **params)
        assert not answer.done()
