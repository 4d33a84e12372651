"""The access lists of the documentation, and a broker that has read one."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from servolink.fleet.access import BrokerAccess, parse_broker
from tests import processes
from tests.fleet.mosquitto import FOUND, Broker

PASSWD = FOUND and shutil.which("mosquitto_passwd")
USERS = ("teacher", "rex", "eve", "pupil", "homeassistant")
_PAGES = [Path(__file__).parents[2] / "docs/how-to" / name for name in ("fleet-classroom.md", "home-assistant.md")]


def page_lists() -> list[str]:
    """Return the access list of a classroom, the lines for somebody who watches and stops, and for Home Assistant."""
    text = "".join(page.read_text(encoding="utf-8") for page in _PAGES)
    return re.findall(r"^```text\n(user .*?)^```", text, re.MULTILINE | re.DOTALL)


def broker_with(folder: Path, access: str) -> Broker:
    """Return a broker with an access list, at which each user has the password `pw` and the name."""
    hashed = folder / "passwords"
    hashed.write_text("".join(f"{user}:pw{user}\n" for user in USERS), encoding="utf-8")
    processes.run([str(PASSWD), "-U", str(hashed)], check=True)
    (folder / "access").write_text(access, encoding="utf-8")
    lines = ["allow_anonymous false", f"password_file {hashed}", f"acl_file {folder / 'access'}"]
    broker = Broker(folder, lines)
    broker.start()
    return broker


def as_user(broker: Broker, user: str) -> BrokerAccess:
    """Return the access of a user to a broker of `broker_with`."""
    return BrokerAccess(parse_broker(broker.url), user, f"pw{user}")
