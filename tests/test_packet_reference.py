"""The page that lists every packet and field."""

from __future__ import annotations

import pytest

from docs.packet_reference import packet_reference
from servolink.protocol import PACKETS, Packet
from tests.tables import over

PAGE = packet_reference()


def entry(declared: type[Packet]) -> str:
    return PAGE.partition(f"### {declared.packet_id} {declared.__name__}\n")[2].partition("\n### ")[0]


@over("declared", PACKETS.values())
def test_every_packet_has_an_entry_with_its_section_and_fields(declared: type[Packet]) -> None:
    quote = entry(declared)
    assert f"Document {declared.section} ·" in quote
    assert all(f"| `{name}` |" in quote for name in declared.__struct_fields__)


@pytest.mark.parametrize(
    ("packet_id", "text"),
    [
        (10010, "host to board · content 1 byte · response: 10011 `TransmissionModeSettingResponse`."),
        (10031, "board to host · content 4 or 8 bytes · response to 10030 `QueryMemorySizeRequest`."),
        (10041, "| `permil` | i16 | 0 to 32767 | remaining charge, per mille |"),
        (10050, "content up to 65,535 bytes · no response."),
        (20011, "content 1 + n * 1 bytes, n up to 255 · response to 20010"),
        (20011, "| `servo_id_list` | u8 count, then each |  |  |\n| `servo_id_list[]` | u8 | 0 to 255 |  |"),
        (30060, "response: 30061 `QueryMacroResponse` · changes nothing."),
        (40021, "| `buttons[].button_id` | u32 | 0 to 4294967295 |  |\n| `buttons[].button_caption` | caption |  |  |"),
        (40081, "content 5 bytes · sent without a request."),
    ],
)
def test_an_entry_says_what_the_declaration_says(packet_id: int, text: str) -> None:
    assert text in entry(PACKETS[packet_id])


def test_chapters_come_in_the_documents_order() -> None:
    headings = [line for line in PAGE.splitlines() if line.startswith("## ")]
    assert headings == [
        "## 3.1 Settings",
        "## 3.2 Servos",
        "## 3.3 Stored records",
        "## 3.4 Remote control",
    ]
    ids = [int(line.split()[1]) for line in PAGE.splitlines() if line.startswith("### ")]
    assert ids == sorted(PACKETS)
