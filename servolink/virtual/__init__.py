"""The virtual board: a servo control board without the hardware."""
