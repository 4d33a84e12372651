"""The flight recorder: what passed between programs and a board, in one MCAP file (docs/design/recorder.md)."""
