"""Firmware that makes a board of a Raspberry Pi Pico: its image, how it is built, and how it gets onto a Pico."""
