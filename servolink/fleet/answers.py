"""Answers: the result of each command, on the way to the sender of the command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from servolink.control import ErrorObject, encode
from servolink.fleet.broker_messages import Publication
from servolink.fleet.command_log import CommandLog
from servolink.fleet.hub_session import HubError
from servolink.fleet.outbox import Outbox
from servolink.fleet.topics import Topics

_EARLIER = (
    "a program of an earlier servolink sends commands, and does not hear the answers: the topics of results and the "
    "access list of the broker have changed; install this version on its machine, too (docs/how-to/fleet-classroom.md)"
)
_LONGEST_NOTED = 65536  # bytes of a result that is remembered for the case of a crash


class Sender(NamedTuple):
    """Destination of a result: response topic and correlation data."""

    response_topic: str | None
    correlation: bytes | None
    qos: int = 1  # of a refusal: a broker confirms only some hundred a second of the thousands that a flood asks for


class Answers:
    """Sender of answers for a board."""

    def __init__(
        self,
        board: str,
        topics: Topics,
        outbox: Outbox,
        command_log: CommandLog | None = None,
        *,
        on_problem: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Answer through `outbox`; a noted command ends in `command_log` when the broker has the answer.

        `on_problem` is called with a notice for people, once.
        """
        self._on_problem: Callable[[str], None] | None = on_problem
        self._board = board
        self._topics = topics
        self._outbox = outbox
        self._command_log = command_log

    def succeed(self, command_id: str, sender: Sender, result: Any) -> None:
        """Send the result of a command."""
        self._finish(command_id, sender, {"ok": True, "result": {} if result is None else result})

    def fail(self, command_id: str, sender: Sender, error: Exception) -> None:
        """Send why a command was not done."""
        self._finish(command_id, sender, _failure(error))

    def refuse(
        self, command_id: str | None, sender: Sender, error: Exception, on_sent: Callable[[], None] | None = None
    ) -> str:
        """Send the refusal of a command that was not noted; `command_id` is None if unreadable.

        `on_sent` is called when the broker has the answer, which is returned, to be repeated.
        """
        text = self._text(command_id, _failure(error))
        self._put(sender, text, on_sent, sender.qos)
        return text

    def report(self, command_id: str, sender: Sender, progress: dict[str, Any]) -> None:
        """Send how far a command is."""
        self._put(sender, self._text(command_id, {"progress": progress}))

    def repeat(self, command_id: str, sender: Sender, text: str) -> None:
        """Send a result again, because the broker may not have the first copy."""
        self._put(sender, text, self._over(command_id))

    def _finish(self, command_id: str, sender: Sender, answer: dict[str, Any]) -> None:
        text = self._text(command_id, answer)
        noted = self._command_log and self._command_log.find(command_id)
        if not noted or noted.is_over or not self._command_log:
            self._put(sender, text)
            return
        if len(text) <= _LONGEST_NOTED:
            self._command_log.answered(noted.id, text)
        self._put(sender, text, self._over(noted.id))

    def _text(self, command_id: str | None, answer: dict[str, Any]) -> str:
        return encode({"id": command_id, "board": self._board, **answer}).decode()

    def _over(self, noted: str) -> Callable[[], None] | None:
        """Return the callback for the broker's confirmation of the answer to a noted command."""
        command_log = self._command_log
        return None if command_log is None else lambda: command_log.over(noted)

    def _put(self, sender: Sender, text: str, on_sent: Callable[[], None] | None = None, qos: int = 1) -> None:
        topic = sender.response_topic
        if topic is None or not self._topics.may_answer(self._board, topic):
            if topic is not None and self._on_problem is not None and self._topics.is_earlier_reply(topic):
                self._on_problem(_EARLIER)
                self._on_problem = None
            topic = self._topics.board(self._board, "result")
        message = Publication(topic, text, qos, correlation=sender.correlation)
        self._outbox.put(message, on_sent)


def _failure(error: Exception) -> dict[str, Any]:
    return {"ok": False, "error": error.told if isinstance(error, HubError) else ErrorObject.of(error)}
