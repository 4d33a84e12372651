"""`python -m servolink` is the `servolink` command."""

from __future__ import annotations

import sys

from servolink.cli.main import main

sys.exit(main())
