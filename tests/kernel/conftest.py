"""What runs in the guest is collected there only."""

from __future__ import annotations

import os

collect_ignore = [] if os.environ.get("SERVOLINK_GUEST") else ["guest"]
