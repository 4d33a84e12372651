"""Goals as data, with the figures measured: the page counts them, so it cannot claim more than was reached."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypedDict


class Goal(TypedDict):
    """A goal of one benchmark, ready for JSON."""

    name: str
    """The quantity, on which stream or line and beside which peer."""
    goal: str
    figure: str
    met: bool


def at_most(name: str, figure: float, limit: float, form: str = "{:.2f}x") -> Goal:
    """Return a goal that a figure above `limit` misses; `form` writes both."""
    return Goal(name=name, goal=f"at most {form.format(limit)}", figure=form.format(figure), met=figure <= limit)


def at_least(name: str, figure: float, limit: float, form: str = "{:.2f}x") -> Goal:
    """Return a goal that a figure below `limit` misses; `form` writes both."""
    return Goal(name=name, goal=f"at least {form.format(limit)}", figure=form.format(figure), met=figure >= limit)


def missed(goals: Iterable[Goal]) -> list[Goal]:
    """Return the goals that are not met."""
    return [goal for goal in goals if not goal["met"]]


def sentence(goal: Goal) -> str:
    """Return a goal with its figure as one line of text."""
    return f"{goal['name']}: {goal['figure']}, the goal is {goal['goal']}"
