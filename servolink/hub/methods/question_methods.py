"""Methods of the control interface for questions to a person before a motion."""

from __future__ import annotations

from servolink.control import Answer, Done, NoParams, Role, Touches
from servolink.hub.method_messages import AnswerGiven, QuestionAsk
from servolink.hub.methods.methods import METHODS, Caller


@METHODS.add("question.ask", Role.MOVE, touches=Touches.SESSION)
async def question_ask(caller: Caller, params: QuestionAsk) -> Answer:
    """Ask a person at another program whether a motion may begin, and return the answer. Nothing moves.

    The question is open for 30 s; a later question of the program replaces the earlier one. NotFound: no program shows
    questions to a person. MotionRefused: no answer in time, or a stop.
    """
    return await caller.control.questions.ask(caller.control.session, params)


@METHODS.add("question.withdraw", Role.MOVE, touches=Touches.SESSION)
def question_withdraw(caller: Caller, params: NoParams) -> Done:
    """End the open question of this program."""
    caller.control.questions.withdraw(caller.control.session)
    return Done()


@METHODS.add("question.show", Role.MOVE, touches=Touches.SESSION)
def question_show(caller: Caller, params: NoParams) -> Done:
    """Send the notifications `question` and `question.over` from now on, for the person at this program.

    A question may come again, with the same number.
    """
    caller.control.questions.show(caller.control.session)
    return Done()


@METHODS.add("question.answer", Role.MOVE, touches=Touches.SESSION)
def question_answer(caller: Caller, params: AnswerGiven) -> Done:
    """Answer a question of another program for the person at this program, after `question.show`.

    NotFound if it is not open any more, or was not shown here.
    """
    caller.control.questions.answer(caller.control.session, params.number, is_yes=params.is_yes)
    return Done()
