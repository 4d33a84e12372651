"""Depth of requests under way at once: the smallest number to fill the line, found by trying.

No response tells how full the queue of a board is, and a loss does not tell either: a bad line loses as much at depth
1. So a depth is judged by what it brings. Measured are *epochs*: a number of responses, all of them while as many
requests were under way as the depth allows. The depth is doubled for an epoch, and stays if responses come faster and
hardly more is lost (docs/design/depth.md has the figures).

This file knows no clock, no event loop and no bytes.
"""

from __future__ import annotations

LEAST_RESPONSES = 32
"""Least number of responses in an epoch; it also has at least four times the depth."""
RISE = 1.1
"""Least ratio of the rates of responses at the greater depth and at the smaller one."""
CLEAN_RISE = 1.03
"""The same if nothing was lost in either epoch: then nothing but the depth makes a difference."""
MORE_LOSS = 0.05
"""Share of what is sent that may be lost at the greater depth beyond the loss at the smaller one."""
FIRST_WAIT, LONGEST_WAIT = 8, 256
"""Epochs until a depth that did not pay is tried again; twice as many each time."""

_MOST_EPOCHS = 4  # in one trial decided by losses: among 32 requests, losses are mostly chance
_HOPELESS_LOSSES, _HOPELESS_LOSS = (
    4,
    0.25,
)  # number of losses, and share beyond that before, which together end a trial at once


class Epoch:
    """Measurement of responses at one depth."""

    def __init__(self, depth: int) -> None:
        """Start without responses."""
        self.depth = depth
        self.responses = self.lost = 0
        self.seconds = 0.0
        self.length = max(LEAST_RESPONSES, 4 * depth)
        """Responses needed for a judgement."""

    def lose(self) -> None:
        """Count a loss. A judgement needs more responses then, as a loss costs the time of many."""
        if not self.lost:
            self.length *= 4
        self.lost += 1

    @property
    def rate(self) -> float:
        """Responses per second at this depth."""
        return self.responses / max(self.seconds, 1e-9)

    @property
    def loss(self) -> float:
        """The share of requests without a response."""
        return self.lost / max(self.responses + self.lost, 1)

    def is_faster_than(self, other: Epoch) -> bool:
        """Return whether responses came faster, by more than chance or a busy machine explains."""
        return self.rate > other.rate * (RISE if self.lost or other.lost else CLEAN_RISE)

    def loses_more_than(self, other: Epoch) -> bool:
        """Return whether clearly more was lost."""
        return self.loss > other.loss + MORE_LOSS


class DepthClimb:
    """The depth to work with."""

    def __init__(self, bound: int) -> None:
        """Start at depth 1, and never exceed `bound`."""
        self.bound = bound
        self.depth = 1
        """How many requests may be under way now."""
        self._epoch = Epoch(1)
        self._settling = 0  # responses due to requests sent at another depth
        self._answered_at: float | None = None
        self._rival: Epoch | None = None  # during a trial: the epoch at the depth before
        self._loss = self._usual_loss = 0.0  # at this depth: smoothed, and when the depth was found
        self._wait = self._epochs_to_trial = 0  # until a greater depth is tried
        self._has_tried = False  # any other depth than 1

    def answered(self, now: float, responses: int = 1, *, full: bool, has_backlog: bool) -> None:
        """Count responses received together at `now`, in seconds.

        `full`: as many requests were under way as the depth allows; `has_backlog`: more of them wait.
        """
        since, self._answered_at = self._answered_at, now if full else None
        if self._settling:
            settled = min(self._settling, responses)
            self._settling -= settled
            responses -= settled
            since = self._answered_at
        if full and since is not None and responses:
            epoch = self._epoch
            epochs = epoch.responses // epoch.length
            epoch.responses += responses
            epoch.seconds += now - since
            if epoch.responses // epoch.length > epochs:
                self._judge(epoch, has_backlog=has_backlog)

    def leap(self) -> None:
        """Try the bound at once, unless another depth was tried: a transfer may be over before a climb is.

        It is a trial beside depth 1, which is the depth again if much is lost.
        """
        if not self._has_tried and self.bound > 1:
            self._epoch = Epoch(1)  # responses to other requests, perhaps shorter ones, say nothing about the pace
            self._try(self.bound)

    def lost(self) -> None:
        """Count a request whose response did not come."""
        epoch, rival = self._epoch, self._rival
        if not self._settling:
            epoch.lose()
            if rival is not None and rival.depth < epoch.depth and _is_hopeless(rival, epoch):
                self._return_to(rival)

    def _judge(self, epoch: Epoch, *, has_backlog: bool) -> None:
        """End an epoch: go on, try another depth, or end a trial."""
        rival = self._rival
        if rival is None:
            self._look_around(epoch, has_backlog=has_backlog)
            return
        less, more = sorted((rival, epoch), key=lambda each: each.depth)
        faster, loses_more = more.is_faster_than(less), more.loses_more_than(less)
        if faster and loses_more and epoch.responses < _MOST_EPOCHS * epoch.length:
            return  # measure on
        if (more if faster and not loses_more else less) is rival:
            self._return_to(rival)
            return
        self._rival = None
        self._wait = 0
        self._loss = epoch.loss
        if epoch is more:
            self._usual_loss, self._epochs_to_trial = epoch.loss, 0
        else:
            self._epochs_to_trial = FIRST_WAIT
        self._look_around(epoch, has_backlog=has_backlog)

    def _look_around(self, epoch: Epoch, *, has_backlog: bool) -> None:
        """Try another depth after an epoch if a trial is due."""
        self._loss += (epoch.loss - self._loss) / 4
        if self._loss > self._usual_loss + MORE_LOSS and epoch.depth > 1:
            self._try((epoch.depth + 1) // 2)
        elif has_backlog and self._epochs_to_trial <= 0 and epoch.depth < self.bound:
            self._try(min(2 * epoch.depth, self.bound))
        else:
            self._epochs_to_trial -= 1
            self._epoch = Epoch(epoch.depth)

    def _try(self, depth: int) -> None:
        self._has_tried = True
        self._rival = self._epoch
        self._go_to(depth)

    def _return_to(self, rival: Epoch) -> None:
        """End an unsuccessful trial of a greater depth."""
        if rival.depth < self.depth:
            self._wait = min(max(FIRST_WAIT, 2 * self._wait), LONGEST_WAIT)
            self._epochs_to_trial = self._wait
        self._usual_loss = self._loss
        self._rival = None
        self._go_to(rival.depth)

    def _go_to(self, depth: int) -> None:
        self._settling = max(depth, self.depth)
        self.depth = depth
        self._epoch = Epoch(depth)


def _is_hopeless(less: Epoch, more: Epoch) -> bool:
    return more.lost >= _HOPELESS_LOSSES and more.loss > less.loss + _HOPELESS_LOSS
