"""`python -m servolink` is the `servolink` command."""

import sys

from servolink.cli.main import main

sys.exit(main())
