"""The board as a person sees it: its commands, events and limits, across losses of the connection."""
