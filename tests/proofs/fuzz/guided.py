"""One target under atheris, which changes inputs so that they reach new branches: a process of its own.

`python -m tests.proofs.fuzz.guided TARGET CORPUS OPTION...`, with the options of libFuzzer. It never returns to Python.
"""

from __future__ import annotations

import importlib
import sys


def main() -> None:
    """Fuzz the target that the command line names."""
    atheris = importlib.import_module("atheris")
    with atheris.instrument_imports(include=["servolink", "tests"]):
        for module in ("device", "usbip_messages"):  # first: the other modules of tests only drive what is tried
            importlib.import_module(f"tests.lab.usbip.{module}")
    with atheris.instrument_imports(include=["servolink"]):
        from tests.proofs.fuzz.targets import TARGETS
    name, *options = sys.argv[1:]
    atheris.Setup([sys.argv[0], *options], TARGETS[name].check)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
