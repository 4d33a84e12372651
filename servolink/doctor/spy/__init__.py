"""Between a program and a board: pass on every byte, and learn from the packets (docs/how-to/spy.md)."""
