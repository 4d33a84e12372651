"""The rules of Home Assistant for what it finds over MQTT, written down from its documentation and its schemas.

They cover device discovery and the platforms that are used here: what is required, what is known, and what fits.
"""

from __future__ import annotations

import re
from typing import Any

PLATFORMS: dict[str, tuple[set[str], set[str]]] = {
    "sensor": (
        {"state_topic"},
        {"device_class", "state_class", "unit_of_measurement", "value_template", "suggested_display_precision"},
    ),
    "binary_sensor": ({"state_topic"}, {"device_class", "value_template", "payload_on", "payload_off"}),
    "event": ({"state_topic", "event_types"}, {"device_class", "value_template"}),
    "button": ({"command_topic"}, {"device_class", "payload_press", "command_template", "retain"}),
    "number": (
        {"command_topic"},
        {
            *("state_topic", "value_template", "command_template", "min", "max", "step", "mode", "optimistic"),
            *("device_class", "unit_of_measurement", "retain"),
        },
    ),
}
"""Required and further fields of each platform."""

COMMON = {
    *("platform", "unique_id", "name", "availability", "availability_mode", "entity_category", "enabled_by_default"),
    *("icon", "qos", "encoding"),
}
DEVICE_CLASSES: dict[str, set[str | None]] = {
    "sensor": {"battery", None},
    "binary_sensor": {"connectivity", None},
    "event": {"button", "doorbell", "motion", None},
    "button": {"identify", "restart", "update", None},
    "number": {None},
}
UNITS = {"battery": "%"}
_TOPIC = re.compile(r"[^+#\x00-\x1f\x7f]{1,65535}")


def check_topic(topic: str, board: str) -> None:
    """Assert that Home Assistant looks for devices there, and takes this one for what it is."""
    assert re.fullmatch(r"homeassistant/device/([a-zA-Z0-9_-]+/)?[a-zA-Z0-9_-]+/config", topic), topic
    assert board in topic


def check_document(document: dict[str, Any]) -> None:
    """Assert that Home Assistant takes a document."""
    assert set(document) <= {"device", "origin", "components", "availability", "availability_mode", "qos", "encoding"}
    assert document["qos"] in {0, 1, 2}
    assert document["origin"]["name"]
    device = document["device"]
    assert device["identifiers"]
    assert all(isinstance(each, str) and each for each in device["identifiers"])
    assert set(device) <= {"identifiers", "name", "manufacturer", "model", "sw_version", "serial_number", "hw_version"}
    _check_availability(document)
    assert document["components"]
    ids = [component["unique_id"] for component in document["components"].values() if len(component) > 1]
    assert len(ids) == len(set(ids))
    for component in document["components"].values():
        if set(component) != {"platform"}:  # which removes it
            _check_component(component)


def _check_availability(part: dict[str, Any]) -> None:
    assert part.get("availability_mode", "latest") in {"all", "any", "latest"}
    for each in part.get("availability", []):
        assert set(each) <= {"topic", "payload_available", "payload_not_available", "value_template"}
        assert _TOPIC.fullmatch(each["topic"])


def _check_component(component: dict[str, Any]) -> None:
    required, known = PLATFORMS[component["platform"]]
    assert set(component) >= {"platform", "unique_id", *required}
    assert set(component) <= COMMON | required | known
    for name, value in component.items():
        if name.endswith("_topic"):
            assert _TOPIC.fullmatch(value), value
    _check_availability(component)
    device_class = component.get("device_class")
    assert device_class in DEVICE_CLASSES[component["platform"]]
    assert device_class not in UNITS or component["unit_of_measurement"] == UNITS[device_class]
    assert component.get("entity_category") in {None, "diagnostic"}
    assert component.get("enabled_by_default") in {None, False, True}
    assert isinstance(component.get("name"), str)
    assert component["name"]
    assert component.get("state_class") in {None, "measurement", "total", "total_increasing"}
    if component["platform"] == "event":
        assert component["event_types"]
        assert all(isinstance(each, str) for each in component["event_types"])
    if component["platform"] == "number":
        assert component["min"] < component["max"]
        assert component["step"] >= 0.001
        assert component["mode"] in {"auto", "box", "slider"}
