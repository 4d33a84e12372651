"""When a ticket holds."""

from __future__ import annotations

import math

from servolink.motion.ticket import StopCounter, Ticket


def test_a_ticket_holds_until_the_next_stop() -> None:
    stops = StopCounter()
    ticket = stops.ticket()
    assert stops.holds(ticket)
    stops.stop()
    assert not stops.holds(ticket)
    assert stops.holds(stops.ticket())
    assert stops.count == 1


def test_tickets_of_another_counter_never_hold() -> None:
    one, other = StopCounter(), StopCounter()
    for _ in range(3):
        assert not one.holds(other.ticket())
        assert not one.issued(other.ticket())
        assert one.issued(one.ticket())
        one.stop()
    before = one.ticket()
    one.stop()
    assert one.issued(before)


def test_a_ticket_says_by_when_and_by_whom() -> None:
    ticket = StopCounter().ticket(until=12.5, who="a session")
    assert (ticket.until, ticket.who, ticket.units_sent) == (12.5, "a session", None)
    assert ticket.begun() == Ticket(ticket.epoch, math.inf, "a session")
    assert ticket.checked(3).units_sent == 3
