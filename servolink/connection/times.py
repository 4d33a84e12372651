"""Times of a connection, in seconds unless said otherwise. docs/design/opening.md has the reasons."""

from __future__ import annotations

# --- requests ---------------------------------------------------------------------------------------------------------

PATIENCE = 3.0
"""Time after which a request is given up, unless told otherwise."""
SLOW_PATIENCE = 30.0
"""Time after which deleting everything is given up: a board may erase its memory for long before it answers."""
HUB_MARGIN = 1.0
"""Time that a hub gets beyond the patience: its own may begin a little later."""
ROUNDING = 1e-9
"""Time by which a timer fires early where the clock has no finer steps."""

# --- deadline of one sending ------------------------------------------------------------------------------------------

FIRST_TRY = 0.25
"""Time until a request is sent again, before any response has been timed."""
COMMAND_TRY = 1.0
"""Time until a fence follows a request that is sent once, before any response to its kind has been timed."""
AFTER_WRITE = 0.5
"""Least time for a request behind one that is sent once: the board may be writing its memory."""
LONGEST_TRY = 0.5
"""Longest time until a request is sent again, before it grows by `BACKOFF`."""
BACKOFF = 1.5
"""Factor of the time of each try after the second one."""
OTHER_KIND = 0.1
"""Time that an untimed kind gets beyond the quickest one."""
LEAST_MARGIN, MOST_MARGIN = 0.04, 0.3
"""Time for a response beyond the usual time: on a line without delays, and on a late line."""
FORGOTTEN = 0.98
"""Factor of a grown margin for each response in time."""
QUICK = 0.75
"""Share of the time of the quickest response below which another may be a copy of an earlier one."""
QUICK_FROM = 0.0005
"""Least time of the quickest response with which others are compared: quicker boards are in this computer."""

# --- silence of a board -----------------------------------------------------------------------------------------------

ARRIVAL_PAUSE = 0.05
"""Time without a byte after which the rest of a partial frame is no longer expected."""
LONGEST_ARRIVAL = 20.0
"""Longest time for the arrival of a response. A partial frame with a slower rate is a false start."""
GONE_PATIENCES = 2
"""Patiences of complete silence, after several requests, until a board is considered gone."""

# --- what may be under way --------------------------------------------------------------------------------------------

MOST_OWED = 0.045
"""Time of the line for responses that are owed. A stop comes to the board within 50 ms: fences need some of them."""
MOST_OWED_IN_BULK = 0.09
"""Time of the line for responses that are owed during an import, where a stop may take 100 ms."""

# --- opening ----------------------------------------------------------------------------------------------------------

TRIES_IN_PATIENCE = 12
"""Share of the patience that a try gets at most, as its divisor: with growing pauses, five fit into the patience."""
SILENT_TRIES_IN_PATIENCE = 6
"""The same share before any response, however long the pauses have grown."""
LONGEST_OPENING_TRY = 1.5
"""Longest time of a try on a slow line, as one and a half of its round trip."""
AFTER_MODE = 0.06
"""Time in which a board may drop what comes behind the mode setting."""
QUERY_PAUSE = 0.02
"""Least time between two queries of an opening that needs many."""
NOISY_PATIENCES = 1.7
"""Patiences after which a board is given up that sends other bytes, such as the text of a boot loader."""
QUIET_PATIENCES = 2
"""Patiences without a further response after which a board is given up that has answered."""
OPENING_PATIENCES = 4
"""Patiences of a whole opening with responses, beside the time of a whole word."""
REOPENING_PAUSE = 10.0
"""Least time between two openings for stray responses."""

# --- copies of responses, and several boards on one line --------------------------------------------------------------

LONGEST_DELAY = 5.0
"""Time within which a copy may come."""
PROOFS_AFTER_STRAY = 10.0
"""Time of proofs after a stray response."""
PROOFS_AFTER_QUICK = 2.0
"""Time of proofs after a response that was too quick."""
PROOF_PAUSE = 0.01
"""Time between two proofs of one request: copies of its responses get fewer."""
ANSWER_TIME = 1.0
"""Time in which all boards of a line answer one question."""
COMPARISON_PAUSE, LONGEST_COMPARISON_PAUSE = 0.1, 0.5
"""Time in which all boards of a line have answered a short query, by their round trip."""
LONGEST_COMPARISON = 2 * LONGEST_DELAY
"""Longest time of a comparison of boards."""
