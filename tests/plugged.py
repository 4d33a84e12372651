"""Transports of tests at an address: a program finds them as it finds those of other packages."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib.metadata import Distribution, DistributionFinder
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from servolink.transports import Address, DeviceInfo, Transport

here = SimpleNamespace(create=None, found=None)
"""Functions of the package that is installed now."""


class Package(Distribution):
    """Package that brings a kind of address."""

    def __init__(self, entries: str) -> None:
        self._files = {"METADATA": "Name: plugged\nVersion: 1\n", "entry_points.txt": entries}

    def read_text(self, filename: str) -> str | None:
        return self._files.get(filename)

    def locate_file(self, path: Any) -> Path:
        return Path(path)


class Installed(DistributionFinder):
    """Finder of one installed package."""

    def __init__(self, package: Package) -> None:
        self._package = package

    def find_spec(self, *_: object) -> None:
        """Find no module: those of the package are there already."""

    def find_distributions(self, context: DistributionFinder.Context | None = None) -> Iterator[Distribution]:
        if context is None or context.name in {None, "plugged"}:
            yield self._package


def plugged(
    monkeypatch: pytest.MonkeyPatch,
    create: Callable[[str], Transport],
    url: str = "plugged://board",
    *,
    is_found: bool = False,
) -> str:
    """Let `create` make the transports for `url`, also found by a search if it `is_found`; return `url`."""

    def made(address: Address) -> Transport:
        return create(address.url)

    scheme = Address.parse(url).scheme
    entries = f"[servolink.transports]\n{scheme} = {__name__}:here.create\n"
    if is_found:
        entries += f"[servolink.discovery]\n{scheme} = {__name__}:here.found\n"
    monkeypatch.setattr(here, "create", made)
    monkeypatch.setattr(here, "found", lambda: [DeviceInfo(url)])
    others = [each for each in sys.meta_path if not isinstance(each, Installed)]
    monkeypatch.setattr(sys, "meta_path", [*others, Installed(Package(entries))])
    return url
