"""Start of the programs of tests with `--board firmware`: their virtual boards get the core of the firmware."""

from tests.firmware import stand_in

stand_in.install()
