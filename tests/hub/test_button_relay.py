"""Button events: the subscription of each program among those of others."""

from __future__ import annotations

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from servolink.hub.engine.button_relay import Subscribers

programs = st.sampled_from(["ann", "bob", "cid"])


class Subscriptions(RuleBasedStateMachine):
    """Programs come, go and lose responses; each is one program on a board, which must look as if it were alone."""

    def __init__(self) -> None:
        super().__init__()
        self.subscribers = Subscribers()
        self.wanted: set[str] = set()
        self.board_is_on: bool | None = None  # unknown, as after another hub
        self.is_in_doubt = False

    @rule(program=programs, subscribe=st.booleans(), fate=st.sampled_from(["done", "lost before", "lost after"]))
    def set_subscription(self, program: str, *, subscribe: bool, fate: str) -> None:
        if self.subscribers.must_ask(program, subscribe=subscribe):
            self.subscribers.asking()
            self.is_in_doubt = fate != "done"
            if fate != "lost before":
                self.board_is_on = subscribe
            if fate != "done":
                return
            self.subscribers.answered(subscribe=subscribe)
        self.subscribers.change(program, subscribe=subscribe)
        self.wanted = self.wanted | {program} if subscribe else self.wanted - {program}

    @rule(program=programs, is_lost=st.booleans())
    def leave(self, program: str, *, is_lost: bool) -> None:
        if self.subscribers.left(program):
            self.subscribers.asking()
            self.board_is_on = False
            self.is_in_doubt = is_lost
            if not is_lost:
                self.subscribers.answered(subscribe=False)
        self.wanted.discard(program)

    @rule()
    def reconnect(self) -> None:
        self.board_is_on = False
        self.subscribers.asking()
        if self.subscribers.is_wanted:
            self.board_is_on, self.is_in_doubt = True, False
            self.subscribers.answered(subscribe=True)

    @invariant()
    def events_reach_those_who_asked(self) -> None:
        assert {program for program in ("ann", "bob", "cid") if program in self.subscribers} == self.wanted
        assert self.subscribers.is_wanted == bool(self.wanted)

    @invariant()
    def nobody_is_told_that_the_board_did_what_it_did_not(self) -> None:
        for program in ("ann", "bob", "cid"):
            if not self.subscribers.must_ask(program, subscribe=True):
                assert self.board_is_on is True
            if not self.subscribers.must_ask(program, subscribe=False):
                assert self.board_is_on is False or self.wanted - {program}

    @invariant()
    def events_do_not_end_for_others(self) -> None:
        if self.wanted and not self.is_in_doubt:
            assert self.board_is_on is True


TestSubscriptions = Subscriptions.TestCase
