"""The `servolink` command, also as `python -m servolink`."""

from __future__ import annotations

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

_INTERRUPTED = 130
_OBJECTS = 20_000
"""New objects between two looks for garbage: loading modules makes as many, and all of those stay."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (by default sys.argv) and return the exit code, 130 for Ctrl-C at any time."""
    try:
        import signal  # imported inside, like all modules here: Ctrl-C may come during an import

        if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            return _run(argv)
        signal.signal(signal.SIGINT, interrupt)
        try:
            return _run(argv)
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    except KeyboardInterrupt:
        return _INTERRUPTED
    except RuntimeError as error:  # Python before 3.12 wraps an error raised while a class is made
        if isinstance(error.__cause__, KeyboardInterrupt):
            return _INTERRUPTED
        raise


def _run(argv: Sequence[str] | None) -> int:
    import atexit
    import gc

    gc.set_threshold(_OBJECTS)
    atexit.register(gc.freeze)  # all is closed by then; looking for garbage would take 7 % of a short command
    from servolink.cli import run

    return run(argv)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt for Ctrl-C; during an import, end the process at once.

    Modules in C may ignore the exception while they are imported and crash when they are used, and Python ignores it
    where it cleans up after an import: the command would go on.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            import os

            os._exit(_INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
