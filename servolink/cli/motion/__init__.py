"""Commands that move servos, or show them moving."""
