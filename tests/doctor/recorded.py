"""The facts of other systems, as recorded in `systems/`, in place of this one's."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from servolink.doctor.system import Node, SystemFacts

SYSTEMS = Path(__file__).parent / "systems"


class RecordedFacts(SystemFacts):
    """The facts in a file of TOML; the files of that system are made below `root`."""

    def __init__(self, name: str, root: Path, **changed: Any) -> None:
        """Play the recorded system `name`, with the entries in `changed` replaced."""
        system = tomllib.loads((SYSTEMS / f"{name}.toml").read_text(encoding="utf-8")) | changed
        super().__init__(root, system["platform"])
        self.environment = system.get("environment", {})
        self.python = system.get("python", "python3")
        self.pid = 0
        self._system = system
        for path, text in system.get("files", {}).items():
            self._make(path).write_text(text, encoding="utf-8")
        for path, target in system.get("links", {}).items():
            self._make(path).symlink_to(target)
        for path in system.get("nodes", {}):
            self._make(path).touch()

    @property
    def user(self) -> str:
        return str(self._system["user"])

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(self._system.get("groups", ()))

    def members(self, group: str) -> list[str] | None:
        members: dict[str, list[str]] = self._system.get("members", {})
        return members.get(group)

    def node(self, path: str) -> Node | None:
        nodes = self._system.get("nodes", {})
        if path in nodes:
            owner, group, mode, usable = nodes[path]
            return Node(owner, group, int(mode, 8), usable)
        return super().node(path)

    def module(self, name: str) -> str:
        return str(self._system.get("modules", {}).get(name, ""))

    def libusb(self) -> bool:
        return bool(self._system.get("libusb", True))

    def _make(self, path: str) -> Path:
        file = self.root / path.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        return file
