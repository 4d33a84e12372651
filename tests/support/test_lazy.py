"""Doors whose names are imported on first use."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import pytest

from servolink.errors import ServolinkError, TransportUnavailable
from servolink.support.lazy import lazy_names


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Namespace of a room that has the modules of `json`, and one that needs a missing package."""
    door = ModuleType("json")
    monkeypatch.setitem(sys.modules, "json", door)
    monkeypatch.setitem(sys.modules, "json.decoder", ModuleType("json.decoder"))
    monkeypatch.setattr(sys.modules["json.decoder"], "JSONDecoder", "found", raising=False)
    return vars(door)


def test_a_name_is_imported_at_its_first_use_and_kept(room: dict[str, Any]) -> None:
    find = lazy_names("json", {"decoder": ("JSONDecoder",)})
    assert "JSONDecoder" not in room
    assert find("JSONDecoder") == room["JSONDecoder"] == "found"


def test_a_name_that_the_door_does_not_have_is_no_attribute(room: dict[str, Any]) -> None:
    with pytest.raises(AttributeError, match=r"^module 'json' has no attribute 'x'$"):
        lazy_names("json", {"decoder": ("JSONDecoder",)})("x")


@pytest.mark.parametrize(
    ("extra", "kind", "text"),
    [
        ("fleet", ServolinkError, r"^json needs paho-mqtt; .*pip install '\.\[fleet\]'$"),
        ("", TransportUnavailable, r"^json\.connect needs paho-mqtt; pip install paho-mqtt$"),
    ],
)
def test_a_missing_package_is_named_with_the_way_to_install_it(
    room: dict[str, Any], monkeypatch: pytest.MonkeyPatch, extra: str, kind: type[Exception], text: str
) -> None:
    def importing(module: str) -> None:
        raise ModuleNotFoundError("no paho", name="paho.mqtt")

    monkeypatch.setattr("servolink.support.lazy.import_module", importing)
    with pytest.raises(kind, match=text) as refused:
        lazy_names("json", {"client": ("connect",)}, extra=extra)("connect")
    assert type(refused.value) is kind


def test_a_fault_of_servolink_is_no_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def importing(module: str) -> None:
        raise ModuleNotFoundError("no module", name="servolink.fleet.x")

    monkeypatch.setattr("servolink.support.lazy.import_module", importing)
    with pytest.raises(ModuleNotFoundError):
        lazy_names("servolink.fleet", {"x": ("y",)}, extra="fleet")("y")
