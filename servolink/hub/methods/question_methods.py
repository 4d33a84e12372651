"""Methods of the control interface for questions to a person before a motion."""

from __future__ import annotations

from servolink.control.messages import Answer, AnswerGiven, Done, NoParams, QuestionAsk
from servolink.control.roles import Role
from servolink.hub.methods.methods import METHODS, Caller


@METHODS.add("question.ask", Role.MOVE)
async def question_ask(caller: Caller, params: QuestionAsk) -> Answer:
    """Ask a person at another program whether a motion may begin, and return the answer. Nothing moves.

    The question is open for 30 s; a later question of the program replaces the earlier one. NotFound: no program shows
    questions to a person. MotionRefused: no answer in time, or a stop.
    """
    return await caller.control.hub.questions.ask(caller.control.session, params)


@METHODS.add("question.withdraw", Role.MOVE)
def question_withdraw(caller: Caller, params: NoParams) -> Done:
    """End the open question of this program."""
    caller.control.hub.questions.withdraw(caller.control.session)
    return Done()


@METHODS.add("question.show", Role.MOVE)
def question_show(caller: Caller, params: NoParams) -> Done:
    """Send the notifications `question` and `question.over` from now on, for the person at this program.

    A question may come again, with the same number.
    """
    caller.control.hub.questions.show(caller.control.session)
    return Done()


@METHODS.add("question.answer", Role.MOVE)
def question_answer(caller: Caller, params: AnswerGiven) -> Done:
    """Answer a question of another program for the person at this program. NotFound if it is not open any more."""
    caller.control.hub.questions.answer(caller.control.session, params.number, is_yes=params.is_yes)
    return Done()
