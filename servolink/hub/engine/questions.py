"""Questions of programs: motions that begin only after the yes of a person at another program, such as a page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import NamedTuple

import msgspec
from msgspec import Struct

from servolink.control import Answer, ProgramNotice, QuestionNotice, QuestionOver
from servolink.errors import MotionRefused, NotFound, Reason
from servolink.hub.engine.stop_order import MotionsCancelled
from servolink.hub.method_messages import QuestionAsk
from servolink.motion import STOPPED

OPEN = 30.0
"""Seconds in which a question must be answered."""


class _Open(NamedTuple):
    """Question that waits for an answer."""

    asker: str
    notice: QuestionNotice
    answer: asyncio.Future[Answer]
    of_hub: bool
    """Whether the hub asks about a motion of the program, so that the person at its own page may answer."""


class Questions:
    """Open questions, at most one of each program, and the programs that show questions to a person."""

    def __init__(self, tell: Callable[[Struct, str], None], who_of: Callable[[str], str]) -> None:
        """Pass notices to `tell`; `who_of` returns the name of a session for people."""
        self.shown_by = set[str]()
        """Sessions that show questions to a person."""
        self._tell = tell
        self._who_of = who_of
        self._open: dict[int, _Open] = {}
        self._count = 0

    def show(self, session: str) -> None:
        """Show questions at `session` from now on, and tell again those that are open."""
        self.shown_by.add(session)
        for each in self._open.values():
            self._tell(each.notice, each.asker)

    async def ask(self, session: str, asked: QuestionAsk, *, of_hub: bool = False) -> Answer:
        """Return the answer to a question of `session`; an earlier question of the program is withdrawn.

        With `of_hub`, the hub asks about a motion of the program, and the person at its own page may answer.

        Raises:
            MotionRefused: Nobody has answered in time, or a stop came first.
            NotFound: No other program shows questions.
        """
        self.withdraw(session)
        if all(self._is_same(session, each) and not of_hub for each in self.shown_by):
            raise NotFound("nobody can be asked: no page that may move the robot is open in a studio of this board")
        self._count += 1
        number = self._count
        notice = QuestionNotice(number, self._who_of(session), **msgspec.structs.asdict(asked))
        answer: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._open[number] = _Open(session, notice, answer, of_hub)
        self._tell(notice, "" if of_hub else session)
        try:
            async with asyncio.timeout(OPEN):
                return await answer
        except TimeoutError:
            raise MotionRefused(f"nothing was moved: nobody has answered within {OPEN:g} s") from None
        finally:
            self._open.pop(number)
            self._tell(QuestionOver(number), session)

    def answer(self, session: str, number: int, *, is_yes: bool) -> None:
        """Answer an open question for the person at `session`.

        Raise NotFound for any other, for one of its own program, and for a session that shows no questions.
        """
        found = self._open.get(number)
        if found is None or found.answer.done() or (self._is_same(found.asker, session) and not found.of_hub):
            raise NotFound("this question is not open any more")
        if session not in self.shown_by:
            raise NotFound("this question was not shown here: call question.show, and ask the person")
        found.answer.set_result(Answer(is_yes, self._who_of(session)))

    def withdraw(self, session: str) -> None:
        """End the question of a program, if one is open."""
        self._end("the question was withdrawn", Reason.OTHER, session)

    def hear(self, notice: Struct, session: str) -> None:
        """Take a notice of the hub: a stop voids all questions, and a program that leaves asks and shows nothing."""
        match notice:
            case MotionsCancelled(are_all=True):
                self._end(STOPPED, Reason.STOP)
            case ProgramNotice(event="left"):
                self.shown_by.discard(session)
                self.withdraw(session)
                if not self.shown_by:
                    self._end("the page with the question was closed", Reason.OTHER)
            case _:
                pass

    def _is_same(self, asker: str, session: str) -> bool:
        """Return whether two sessions belong to one program, which names all its connections alike."""
        return asker == session or self._who_of(asker) == self._who_of(session)

    def _end(self, why: str, reason: Reason, session: str = "") -> None:
        """Refuse the questions of a program, or of all programs."""
        for each in self._open.values():
            if not each.answer.done() and session in ("", each.asker):
                each.answer.set_exception(MotionRefused(f"nothing was moved: {why}", reason=reason))
