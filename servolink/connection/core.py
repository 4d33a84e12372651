"""ConnectionCore: state that the sending and the receiving half of a connection share."""

from __future__ import annotations

import asyncio

from servolink.connection.deadlines import ResponseTimes
from servolink.connection.options import ConnectionOptions
from servolink.connection.repeating_slots import RepeatingSlots
from servolink.connection.repeats import Repeats
from servolink.connection.scheduler import RequestScheduler, Window
from servolink.connection.slots import Slots
from servolink.connection.state import Lifecycle
from servolink.connection.stats import Stats
from servolink.connection.taps import Taps
from servolink.connection.times import HUB_MARGIN
from servolink.protocol import Codec


class ConnectionCore:
    """State of one connection: requests under way, properties of the line, listeners."""

    def __init__(
        self,
        url: str,
        options: ConnectionOptions,
        *,
        bytes_per_second: float = 0.0,
        learn: bool = True,
        through_hub: bool = False,
        stats: Stats | None = None,
        taps: Taps | None = None,
    ) -> None:
        """Have as much under way as `options` allow, on a line that carries `bytes_per_second`, or 0 if unknown.

        How many requests under way pay is learnt, unless `learn` is False: then as many as allowed are sent from the
        beginning. A board that may answer twice, or sends late copies, gets one at a time.
        """
        twice = options.answers_twice and not through_hub
        late_copies = options.late_copies and not through_hub
        self.url = url
        """The address."""
        self.codec = Codec(options.byte_order, options.caption_encoding)
        self.patience = options.patience
        """Seconds to ask for one response, repeats included."""
        self.call_patience = options.patience + (HUB_MARGIN if through_hub else 0.0)
        """Seconds until a call is given up: a hub gets more, as its own patience may begin a little later."""
        self.through_hub = through_hub
        """Whether a hub repeats requests, so that each is sent once, and the hub may go on without its board."""
        self.loop = asyncio.get_running_loop()
        self.stats = stats or Stats()
        """Counters of all frames and bytes seen."""
        self.taps = taps or Taps()
        """Listeners to bytes and requests."""
        self.repeats = Repeats(url, self.stats, self.loop.time, twice=twice, late_copies=late_copies)
        """Copies of responses, and answers of several boards."""
        self.times = ResponseTimes()
        """Response times of each kind of request."""
        self.slots: Slots = RepeatingSlots() if twice else Slots()
        depths = (1, 1) if twice or late_copies else (options.depth, options.write_depth)
        self.scheduler = RequestScheduler(Window(*depths, learn=learn, bytes_per_second=bytes_per_second), self.slots)
        self.lifecycle = Lifecycle(outlasts_silence=through_hub)
        """State in the life of the connection."""
