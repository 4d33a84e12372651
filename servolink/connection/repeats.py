"""Repeats: responses beyond the requests of a connection, from late copies or from several boards on one line.

A response that comes again unchanged is a copy. Copies that come late, between other responses, break the order on
which matching relies, so readings are proved: a fence follows each request, and of all answers before the response to
the fence the one counts that was not heard before. Two new answers to one request come from two boards.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from msgspec import Struct, field

from servolink.connection.stats import Stats
from servolink.connection.times import ANSWER_TIME, LONGEST_DELAY, PROOFS_AFTER_QUICK, PROOFS_AFTER_STRAY
from servolink.errors import Reason, RequestRefused, escape
from servolink.motion import Ticket
from servolink.protocol import Frame, Packet, Query

SURE_COPIES = 3
"""Copies after which chance is excluded."""

_MOST_KNOWN = 4096  # contents
_MOST_DOUBTS = 2  # calls in a row without one certain answer, each asked for the whole patience
_FASTER, _SLOWER = 0.02, 0.5  # weights of a trip: copies may come at once, and look like quick answers
_MOST_DIFFERING = 3  # questions with two answers that may be explained otherwise
_MOST_FOREIGN = 12  # proofs beside which a content came that is hardly ever the certain one
_IN_A_ROW = 2
"""Requests to which two responses must differ, so that copies of earlier responses are excluded."""
_COPIES = 3  # most copies of one response
_logger = logging.getLogger(__name__)


class Inquiry(Struct):
    """Answers on one lane since the latest sending."""

    sent_at: float
    is_single: bool
    """Whether no earlier sending on the lane may still be answered."""
    owes: bool = False
    """Whether the board owes answers to earlier sendings on the lane, which are late and no copies."""
    answers: dict[bytes, bool] = field(default_factory=dict)
    """Whether the same content was heard before the sending, by content."""
    certain: bytes | None = None
    """Content that a proof has found."""

    @property
    def fresh(self) -> list[bytes]:
        """Contents of responses that were not heard before."""
        return [content for content, was_known in self.answers.items() if not was_known]


class HeardContents:
    """Contents of responses heard lately, and how often each came beside another one that was certain."""

    def __init__(self) -> None:
        """Start with no heard contents and no proofs."""
        self.is_copy = False
        """Whether the latest content was known."""
        self._heard_at: dict[Frame, float] = {}  # by response, the latest last
        self._foreign: dict[Frame, int] = {}  # by response: proofs of other responses, less its own proofs

    def add(self, frame: Frame, now: float) -> None:
        """Take a response heard `now` into account."""
        self.is_copy = now - self._heard_at.pop(frame, -LONGEST_DELAY) < LONGEST_DELAY
        self._heard_at[frame] = now
        if len(self._heard_at) > _MOST_KNOWN:
            self._foreign.pop(oldest := next(iter(self._heard_at)), None)
            del self._heard_at[oldest]

    def has_foreign(self, response_id: int, question: Inquiry) -> bool:
        """Return whether an answer came more often, while others were certain, than it was: a copy has an original."""
        for content in question.answers:
            frame = response_id, content
            self._foreign[frame] = self._foreign.get(frame, 0) + (-_COPIES if content == question.certain else 1)
        return any(self._foreign[response_id, content] >= _MOST_FOREIGN for content in question.answers)

    def clear(self) -> None:
        """Forget all contents that were heard."""
        self._heard_at.clear()
        self._foreign.clear()


class Repeats:
    """Knowledge of copies and of several boards on the line of one connection."""

    def __init__(
        self, url: str, stats: Stats, now: Callable[[], float], *, twice: bool = False, late_copies: bool = False
    ) -> None:
        """Keep contents from the first stray response on; from the beginning for a board known to send copies.

        `twice`: each response may come twice in a row. `late_copies`: copies may come later, and all is proved.
        """
        self.is_on = twice or late_copies
        """Whether contents are kept for comparison."""
        self.several = ""
        """Reason to believe that several boards answer; empty without any."""
        self.is_proving = late_copies
        """Whether requests are proved, or refused because of several boards."""
        self._url = url
        self._stats = stats
        self._now = now
        self._twice = twice
        self._always = late_copies
        self._complete_at = now() if twice and not late_copies else now() + LONGEST_DELAY
        self._proved_until = 0.0
        self._contents = HeardContents()
        self._questions: dict[int, Inquiry] = {}
        self._differing = self._doubts = 0
        self._trip = 0.0  # seconds to an answer, rather the slow ones

    # --- from the sending half ----------------------------------------------------------------------------------

    def asked(self, response_id: int, *, counts: bool = True, owes: bool = False) -> None:
        """Begin a question: a request is sent whose response has this id. Unless it `counts`, differences do not.

        `owes` says whether earlier sendings on the lane are not answered.
        """
        before = self._questions.get(response_id)
        if before and before.certain is not None and self._contents.has_foreign(response_id, before) and self._is_clean:
            self.found_several(f"sent the same response {response_id} to many requests that had another")
        is_single = counts and not owes and (before is None or bool(before.answers))
        self._questions[response_id] = Inquiry(self._now(), is_single, owes)

    def forget_questions(self) -> None:
        """Compare later responses with none so far: an opening begins."""
        self._questions.clear()

    def answers(self, response_id: int) -> Inquiry:
        """Return the answers to the latest question of this lane."""
        return self._questions.get(response_id) or Inquiry(0.0, is_single=False)

    # --- from the receiving half --------------------------------------------------------------------------------

    def heard(self, frame: Frame) -> None:
        """Take a response into account."""
        now, packet_id = self._now(), frame[0]
        self._contents.add(frame, now)
        question = self._questions.get(packet_id)
        if question is None or frame[1] in question.answers:
            return
        if not question.answers:
            trip = now - question.sent_at
            self._trip += (trip - self._trip) * (_FASTER if trip < self._trip else _SLOWER)
        question.answers[frame[1]] = self._contents.is_copy
        is_sure = question.is_single and now >= self._complete_at and now <= question.sent_at + ANSWER_TIME
        if is_sure:
            self._compare(question, packet_id)

    def _compare(self, question: Inquiry, packet_id: int) -> None:
        """Look for two answers to one question. Only new ones are no copies, where copies come late."""
        is_certain = len(question.fresh) > 1 and self._is_clean
        if is_certain or (self._twice and len(question.answers) > 1):
            question.is_single = False  # counted once
            self._differing += 1
            if self._differing >= (1 if is_certain else _MOST_DIFFERING):
                self.found_several(f"sent two different responses {packet_id} to one request")

    def heard_in_opening(self, frame: Frame) -> None:
        """Take a response of an opening into account, though nothing is compared otherwise."""
        if not self.is_on:
            self.heard(frame)

    def stray(self, frame: Frame) -> None:
        """Take a response to nothing into account, after `heard`: readings are proved until there are no more."""
        if not self.is_on:
            self._begin()
            self.heard(frame)
        if not self._contents.is_copy and self._stats.noise:
            return  # a damaged frame
        self._prove_for(PROOFS_AFTER_STRAY)
        if self._contents.is_copy:
            self._stats.late_copies += 1
            if self._stats.late_copies == SURE_COPIES and not self._always:
                _logger.warning(
                    "%s sends copies of its responses again later; from now on each reading is proved, which takes "
                    "twice the time. late_copies=yes in the address does so from the beginning",
                    escape(self._url),
                )

    def suspect(self) -> bool:
        """Prove readings for a moment, unless they are: a response came so quickly that it may be a copy."""
        if self.is_on:
            return False
        self._begin()
        self._prove_for(PROOFS_AFTER_QUICK)
        return True

    def prove_always(self) -> None:
        """Prove all requests from now on: no handshake can tell owed responses from copies."""
        self._always = self.is_proving = True
        if not self.is_on:
            self._begin()

    def _begin(self) -> None:
        self._complete_at = self._now() + LONGEST_DELAY
        self.is_on = True

    def _prove_for(self, seconds: float) -> None:
        self.is_proving = True
        self._proved_until = max(self._proved_until, self._now() + seconds)

    def found_several(self, observation: str) -> None:
        """Refuse all but stops from now on."""
        if not self.several:
            self.several = (
                f"{escape(self._url)} {observation}: two boards, or more, answer on this line, and nothing but a stop "
                "is sent; leave one board connected, or give each a line of its own"
            )
            self.is_proving = True
            _logger.warning("%s", self.several)

    @property
    def _is_clean(self) -> bool:
        """Whether nothing was lost, late or damaged: what a bad line brings says nothing of other boards."""
        return not (self._stats.noise or self._stats.timeouts)

    # --- proofs -------------------------------------------------------------------------------------------------

    @property
    def has_many_copies(self) -> bool:
        """Whether copies are no accident, so that a stray response says nothing of an opening."""
        return self._always or self._stats.late_copies >= SURE_COPIES

    def refusal(self, packet: Packet, ticket: Ticket | None = None) -> RequestRefused | None:
        """Refuse all while several boards answer: a gate."""
        if not self.several:
            return None
        return RequestRefused(
            f"{type(packet).__name__} was not sent: {self.several}", packet, reason=Reason.SEVERAL_BOARDS
        )

    def end_proofs(self) -> None:
        """End proofs after a time without stray responses, unless copies are no accident."""
        if not (self.has_many_copies or self.several or self._now() <= self._proved_until):
            self.is_proving = False
            self.is_on = self._twice
            self._contents.clear()
            self._questions.clear()

    def trusts_order(self, question: Inquiry) -> bool:
        """Return whether responses are late and no copies, so that their order says which one is the answer."""
        return question.owes and not (self._always or self.several or self._stats.late_copies)

    def certain(self, question: Inquiry, accepted: list[bytes]) -> bytes | None:
        """Return the certain one of `accepted` answers to a question behind which a fence was answered; else None."""
        if self.several or (question.owes and len(accepted) > 1):
            return None  # a late original is as new as the answer
        fresh = [content for content in accepted if not question.answers[content]]
        is_complete = self._now() >= self._complete_at
        if len(accepted) == 1 or (is_complete and len(fresh) == 1):
            self._doubts = 0
            question.certain = accepted[0] if len(accepted) == 1 else fresh[0]
            return question.certain
        return None

    def believe(self, question: Inquiry) -> None:
        """Take the first answer to a fence for the certain one."""
        question.certain = next(iter(question.answers), None)

    def proof_time(self, question: Inquiry) -> float:
        """Return when the answer to a question must have come, and that to a fence behind it (loop time)."""
        return question.sent_at + 2 * self._trip

    def doubt(self) -> None:
        """Count a call that has ended without a certain answer."""
        self._doubts += self._now() >= self._complete_at
        if self._doubts >= _MOST_DOUBTS and self._is_clean:
            self.found_several("sends different responses to one request again and again")


async def compare_boards(
    repeats: Repeats, queries: Iterable[Query[Any]], ask: Callable[[Query[Any]], Awaitable[bool]]
) -> list[Query[Any]]:
    """Compare all answers to `queries`: boards of one line differ twice in a row, copies do not.

    `ask` asks a query alone and waits for all answers, or returns False, with nothing asked, on a line without pauses:
    then the comparison ends without a result. Return the queries without an answer.
    """
    unanswered: list[Query[Any]] = []
    for query in queries:
        for _ in range(_IN_A_ROW):
            if not await ask(query):
                return unanswered
            answers = repeats.answers(query.packet_id + 1).answers
            unanswered += [] if answers else [query]
            if len(answers) <= 1:
                break
        else:
            repeats.found_several(f"sent different responses {query.packet_id + 1} to each request")
            return unanswered
    return unanswered
