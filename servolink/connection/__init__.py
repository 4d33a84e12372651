"""The conversation with one board: order of sending, matching of responses to requests, repeats."""
