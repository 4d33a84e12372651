"""The whole examination: what is here, what keeps it from being opened, whether it answers, and how well."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from servolink.connection.probe import Answer, ProbeResult, probe
from servolink.discovery.names import resolve_url
from servolink.discovery.search import boards, find_devices
from servolink.doctor import Finding
from servolink.doctor.environment import CHECK as LATENCY
from servolink.doctor.environment import (
    check_address,
    check_brltty,
    check_hid,
    check_holders,
    check_latency_timer,
    check_libusb,
    check_modem_manager,
    check_round_trips,
    check_surroundings,
)
from servolink.doctor.line_quality import Line, check_line, measure
from servolink.doctor.permissions import check_permissions
from servolink.doctor.system import SystemFacts, device_nodes
from servolink.errors import TransportError
from servolink.escaping import escape
from servolink.protocol.frame import ByteOrder
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo

_OF_A_DEVICE: tuple[Callable[[SystemFacts, str], Iterator[Finding]], ...] = (
    check_address,
    check_permissions,
    check_holders,
    check_modem_manager,
    check_latency_timer,
)


@dataclass(slots=True)
class Report:
    """What the doctor found out; `findings` are in the order in which they are best seen to."""

    candidates: list[DeviceInfo]
    """What is here and may be a board."""
    urls: list[str] = field(default_factory=list)
    """What was examined."""
    answer: Answer | None = None
    line: Line | None = None
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_absent(self) -> bool:
        """Whether there is no board to examine."""
        return not self.urls or any(finding.check == "absent" for finding in self.findings)


async def examine(facts: SystemFacts, board: str | None, byte_order: ByteOrder = "little") -> Report:
    """Examine `board`, an address or a name, or without one what is here; it is asked when it is the only one.

    TransportUnavailable if `board` is no address.
    """
    found = await asyncio.to_thread(find_devices)
    report = Report(found.devices)
    if board is not None:
        Address.parse(url := await resolve_url(board))
        report.urls = [url]
    else:
        report.urls = [candidate.url for candidate in boards(report.candidates)]
    report.findings += await asyncio.to_thread(_before_opening, facts, report.urls)
    report.findings += map(_hidden, found.failures)
    if len(report.urls) == 1:
        await _ask(facts, report, byte_order)
    elif report.urls:
        report.findings.append(_several(report.urls))
    else:
        report.findings.append(_nothing())
    return report


def _before_opening(facts: SystemFacts, urls: list[str]) -> list[Finding]:
    findings = [finding for url in urls for check in _OF_A_DEVICE for finding in check(facts, url)]
    schemes = {Address.parse(url).scheme for url in urls}
    if not urls or "serial" in schemes:
        findings += check_brltty(facts)
    if not urls or "hid" in schemes:
        findings += check_hid(facts)
    if not urls or "usb" in schemes:
        findings += check_libusb(facts)
    if not urls or any(_is_missing(facts, url) for url in urls):
        findings += check_surroundings(facts)
    return findings


def _is_missing(facts: SystemFacts, url: str) -> bool:
    """Tell whether `url` is that of a device whose file is not there."""
    if Address.parse(url).scheme not in {"serial", "hid", "usb"}:
        return False
    return not any(facts.node(path) for path in device_nodes(facts, url))


async def _ask(facts: SystemFacts, report: Report, byte_order: ByteOrder) -> None:
    url = report.urls[0]
    heard = await probe(url)
    report.answer = heard.answer
    if heard.problem:
        report.findings += _not_opened(facts, report, heard)
    elif heard.answer is None:
        report.findings.append(_silent(url, heard))
    else:
        report.findings += _differences(url, heard.answer, byte_order)
        await _measure(facts, report, heard.answer.byte_order)


async def _measure(facts: SystemFacts, report: Report, byte_order: ByteOrder) -> None:
    url = report.urls[0]
    try:
        report.line = line = await measure(url, byte_order)
    except TransportError as error:
        report.findings.append(
            Finding("opening", str(error), "it opened once and not again", "run servolink doctor again")
        )
        return
    report.findings += check_line(line)
    if not any(finding.check == LATENCY for finding in report.findings):
        report.findings += check_round_trips(facts, url, line.round_trips)


def _not_opened(facts: SystemFacts, report: Report, heard: ProbeResult) -> Iterator[Finding]:
    """Say why it cannot be opened, unless that has been found out by looking."""
    if any(finding.check in {"permissions", "in use", "hid package", "libusb"} for finding in report.findings):
        return
    url = report.urls[0]
    is_here = any(candidate.url.partition("?")[0] == url.partition("?")[0] for candidate in report.candidates)
    nodes = [path for path in device_nodes(facts, url) if facts.node(path)]
    yield Finding(
        "opening" if is_here or nodes else "absent",
        heard.problem,
        "the board cannot be opened" if is_here or nodes else "no board can be reached at this address",
        "what the line above says; who has it: sudo lsof " + escape(nodes[0])
        if nodes
        else "what the line above says; servolink list shows which boards are here",
    )


def _silent(url: str, heard: ProbeResult) -> Finding:
    asked = "it was asked in both byte orders and both transmission modes"
    if heard.received_bytes:
        unasked = f", {heard.unasked_bytes} of them unasked," if heard.unasked_bytes else ""
        return Finding(
            "no answer",
            f"{escape(url)} sent {heard.received_bytes} bytes{unasked} that make no answer; {asked}",
            "the baud rate is wrong, or this is another kind of device",
            f'servolink doctor "{escape(_with_baudrate(url))}"\nservolink list --probe asks everything that is here',
        )
    return Finding(
        "no answer",
        f"{escape(url)} opens and is silent; {asked}",
        "the board is off, the cable has no data lines, or this is another device's port",
        "switch the board on and try another cable\nservolink list --probe asks everything that is here",
    )


def _with_baudrate(url: str) -> str:
    return url.partition("?")[0] + ("?baudrate=9600" if Address.parse(url).scheme == "serial" else "")


def _differences(url: str, answer: Answer, byte_order: ByteOrder) -> Iterator[Finding]:
    if answer.byte_order != byte_order:
        yield Finding(
            "byte order",
            f"the board answers with the {answer.byte_order} end first, and is asked with the {byte_order} one first",
            "it takes each number for another one and does not answer",
            f"servolink --byte-order {answer.byte_order} --url {escape(url)} info\n"
            f'in Python: servolink.connect(..., byte_order="{answer.byte_order}")',
        )
    if answer.transmission_mode != 1:
        yield Finding(
            "transmission mode",
            "the board answered only after it was put into the new transmission mode",
            "it was in the old one, which servolink does not speak; it is in the new one now, maybe until switched off",
            "try again what did not work\nin Python, with an answer or without: await board.set_transmission_mode(1)",
        )


def _hidden(failure: TransportError) -> Finding:
    return Finding(
        "plug-in",
        str(failure),
        "the devices that only this plug-in finds are hidden from servolink list and from doctor",
        "update the package or remove it: pip uninstall PACKAGE",
    )


def _several(urls: list[str]) -> Finding:
    return Finding(
        "several",
        f"{len(urls)} boards are here: {', '.join(map(escape, urls))}",
        "none was asked, as only you know which is meant",
        "\n".join(f"servolink doctor {escape(url)}" for url in urls),
    )


def _nothing() -> Finding:
    return Finding(
        "absent",
        "no serial port, HID or USB device that can be a board is here, and no virtual one",
        "the board is off or not plugged in, its cable has no data lines, or it is reached over the network",
        "switch it on and try another cable\nfor one in the network: servolink doctor tcp://HOST:PORT\n"
        "without a board: servolink virtual",
    )
