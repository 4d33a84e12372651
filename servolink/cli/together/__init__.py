"""Commands for sharing a board among programs and people."""
