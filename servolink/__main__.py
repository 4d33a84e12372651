"""The `servolink` command, also as `python -m servolink`."""

from __future__ import annotations

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (sys.argv without it) and return the exit code, 130 for Ctrl-C at any time."""
    try:
        from servolink.cli.main import run  # inside: importing takes long enough to be interrupted

        return run(argv)
    except KeyboardInterrupt:
        return 130
    except RuntimeError as error:  # Python before 3.12 wraps what is raised while a class is made
        if isinstance(error.__cause__, KeyboardInterrupt):
            return 130
        raise


if __name__ == "__main__":
    sys.exit(main())
