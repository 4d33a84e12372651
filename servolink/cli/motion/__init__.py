"""Commands that move servos or show movements."""
