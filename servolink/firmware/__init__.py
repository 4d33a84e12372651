"""Firmware for boards made of a Raspberry Pi Pico: C sources, image, compilation and installation."""
