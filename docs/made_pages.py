"""Pages of the reference that are made from declarations alone, and their JSON Schemas; a build writes them.

`python -m docs.made_pages` writes them for reading without a build. git keeps none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

from docs import control_interface, fleet_reference, json_output, packet_reference

MADE: dict[Path, Callable[[], str]] = {
    packet_reference.PAGE: packet_reference.packet_reference,
    control_interface.PAGE: control_interface.control_interface,
    control_interface.SCHEMA: control_interface.schema_text,
    fleet_reference.PAGE: fleet_reference.fleet_reference,
    fleet_reference.SCHEMA: fleet_reference.schema_text,
    json_output.PAGE: json_output.page,
    json_output.SCHEMA: json_output.schema_text,
}
"""What makes each file."""


@cache
def text_of(path: Path) -> str:
    """Return the text of a page of the documentation, whether it is written by hand or made."""
    return MADE[path]() if path in MADE else path.read_text(encoding="utf-8")


def write() -> None:
    """Write the files whose text has changed, as a build reads changed files only."""
    for path in MADE:
        if not path.exists() or path.read_text(encoding="utf-8") != text_of(path):
            path.write_text(text_of(path), encoding="utf-8")


if __name__ == "__main__":
    write()
