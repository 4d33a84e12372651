"""The conversation with a board: link, lanes, events, and the board as a person sees it."""
