"""Between a program and a board: pass every byte on, and learn from what they say (docs/how-to/spy.md)."""
