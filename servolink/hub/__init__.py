"""The hub: one process owns a board and shares it with any number of programs."""
