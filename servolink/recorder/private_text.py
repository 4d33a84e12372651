"""Texts without private parts: names of people, programs, boards and files, and serial numbers.

More is blanked than necessary: a text of a report only needs the kind of fault, and the numbers.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from servolink.recorder.channels import CHANNELS, CommandDone, Event, Message, PacketSeen, ServosRead
from servolink.support import login_name

_HIDDEN = "***"
_QUOTED = re.compile(r"['\"`\u2018\u201c].*['\"`\u2019\u201d]", re.DOTALL)  # captions may hold quotes themselves
_ADDRESS = re.compile(r"\b[a-z][a-z0-9+.-]*://\S*", re.IGNORECASE)
_PATH = re.compile(r"(?:[A-Za-z]:\\|\\\\|~|\.{0,2}/)\S*")
_MAIL = re.compile(r"\S+@\S+")
_NUMBERED = re.compile(r"\b(?=\w*\d)(?=\w*[A-Za-z])\w{6,}\b")  # serial numbers, names of hosts and ports
_LONG_NUMBER = re.compile(r"\b\d{8,}\b")
_FOREIGN = re.compile(r"[^\x20-\x7e]+")
_MOST_SECRETS = 20_000
_LONGEST = 400


class PrivateText:
    """Private texts, with a placeholder for each."""

    def __init__(self, secrets: Iterable[str] = ()) -> None:
        """Start with `secrets`, and with the names of the user and the computer."""
        self._secrets: set[str] = set()
        self._people: dict[str, str] = {}
        self._sessions: dict[str, str] = {}
        self._pattern: re.Pattern[str] | None = None
        for secret in (*secrets, *_of_this_machine()):
            self.hide(secret)

    def learn(self, messages: Iterable[Message]) -> None:
        """Add the captions and names in messages."""
        for message in messages:
            if isinstance(message, ServosRead):
                for servo in message.servos:
                    self.hide(servo.caption)
            elif isinstance(message, (CommandDone, PacketSeen)):
                self._add_texts(message.fields)
            if isinstance(message, (CommandDone, Event)):
                self.hide(message.who)
                self.hide(message.session)
            if isinstance(message, CommandDone):
                self.hide(message.lease)

    def blank(self, text: str) -> str:
        """Return `text` with private parts blanked."""
        if not text:
            return ""
        text = self._hidden().sub(_HIDDEN, text[:_LONGEST])
        for pattern in (_QUOTED, _ADDRESS, _MAIL, _PATH, _NUMBERED, _LONG_NUMBER, _FOREIGN):
            text = pattern.sub(_HIDDEN, text)
        return text

    def blank_all(self, value: Any) -> Any:
        """Return a JSON value with all inner texts blanked, names of fields included."""
        if isinstance(value, str):
            return self.blank(value)
        if isinstance(value, dict):
            return {self.blank(str(name)): self.blank_all(one) for name, one in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.blank_all(one) for one in value]
        return value

    def blank_name(self, channel: str) -> str:
        """Return the name of a channel of a recorder; empty for any other name."""
        return channel if channel in CHANNELS else ""

    def person(self, name: str) -> str:
        """Return the placeholder of a program or a person, always the same."""
        return self._people.setdefault(name, f"program {len(self._people) + 1}") if name else ""

    def session(self, name: str) -> str:
        """Return the placeholder of a session, always the same."""
        return self._sessions.setdefault(name, f"session {len(self._sessions) + 1}") if name else ""

    def _add_texts(self, value: Any, depth: int = 0) -> None:
        if isinstance(value, str):
            self.hide(value)
        elif depth < 8 and isinstance(value, (dict, list)):
            for one in value.values() if isinstance(value, dict) else value:
                self._add_texts(one, depth + 1)

    def hide(self, secret: str) -> None:
        """Add a secret to blank from now on."""
        secret = secret.strip()
        if secret and not secret.isdigit() and len(self._secrets) < _MOST_SECRETS:
            self._secrets.add(secret)
            self._pattern = None

    def _hidden(self) -> re.Pattern[str]:
        if self._pattern is None:
            longest = sorted(self._secrets, key=len, reverse=True)
            short = [rf"\b{re.escape(each)}\b" for each in longest if len(each) < 3]
            self._pattern = re.compile(
                "|".join([re.escape(each) for each in longest if len(each) >= 3] + short) or r"(?!)", re.IGNORECASE
            )
        return self._pattern


def _of_this_machine() -> list[str]:
    """Return the names of the user and the computer."""
    found = [socket.gethostname(), socket.gethostname().partition(".")[0], login_name()]
    with suppress(RuntimeError):
        found.append(str(Path.home()))
    return [each for each in found if each not in ("", "root", "localhost", "/", "/root")]
