"""Odd boards: a board written from the document without the rest of servolink, and its variants."""
