"""A system on which a program may open few files."""

from __future__ import annotations

import pytest


def allow_files(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Let the system allow `most` open files and connections; skip where it has no such limit."""
    resource = pytest.importorskip("resource", reason="the limit of open files is that of Unix")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (most, most))
