"""Complete examination: boards found, obstacles to opening, and the quality of a board's responses."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from servolink.boards import BoardSettings, ProfileFile, boards, find_devices, resolve_board
from servolink.connection import Connection, HandshakeFailed, LineBytes, options_in
from servolink.doctor.all_responses import check_received, converse
from servolink.doctor.contact import ProbeResponse, reach, response_of
from servolink.doctor.environment import (
    LATENCY_TIMER,
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
from servolink.doctor.finding import Finding
from servolink.doctor.learn_line import SharedTransport
from servolink.doctor.learn_queries import FEW_REPEATED, name_of
from servolink.doctor.line_quality import SETTINGS, LineCounts, check_line, measure
from servolink.doctor.permissions import check_permissions
from servolink.doctor.system import SystemFacts, device_nodes
from servolink.errors import InvalidAddress, ProfileError, RequestTimeout, TransportError, escape, quote
from servolink.protocol import ByteOrder
from servolink.transports import Address, DeviceInfo, create

_OF_A_DEVICE: tuple[Callable[[SystemFacts, str], Iterator[Finding]], ...] = (
    check_address,
    check_permissions,
    check_holders,
    check_modem_manager,
    check_latency_timer,
)


_LATE = ("responses", "pause")  # what pauses inside frames explain
_IDLE = 1.0  # seconds without a request, after which a connection that ends was idle
_LEARNT = ("byte_order", "unsupported", "answers_twice", "late_copies", "ignore_extra")
"""Settings of a profile that an opening needs."""


@dataclass(slots=True)
class Report:
    """Result of an examination; `findings` are sorted in the order to deal with them."""

    candidates: list[DeviceInfo]
    """Devices found that may be boards."""
    urls: list[str] = field(default_factory=list)
    """Addresses examined, sorted as found."""
    response: ProbeResponse | None = None
    line: LineCounts | None = None
    unsupported: tuple[str, ...] = ()
    """Names of queries that the board does not answer, of those tried."""
    is_proved: bool = True
    """Whether openings prove that nothing is owed; otherwise each waits until the line is quiet for the patience."""
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_absent(self) -> bool:
        """Whether no board was found at all."""
        return not self.urls or any(finding.check == "absent" for finding in self.findings)


async def examine(
    facts: SystemFacts, board: str | None, byte_order: ByteOrder | None = None, patience: float | None = None
) -> Report:
    """Examine `board`, an address or a name, or all boards found; only a single board is opened and queried.

    `byte_order` is the byte order of the programs, and `patience` the seconds to wait for each response. The defaults
    are the values of the address, then the values of the board's profile. Raise InvalidAddress if `board` is neither a
    name nor a valid address on any system.
    """
    found = await asyncio.to_thread(find_devices)
    report = Report(found.devices)
    if board is not None:
        resolved = await resolve_board(board)
        name, report.urls = resolved.name, [resolved.url]
        _check_address(resolved.url)
    else:
        report.urls = [candidate.url for candidate in boards(report.candidates)]
        name = (await resolve_board(report.urls[0])).name if len(report.urls) == 1 else None
    report.findings += await asyncio.to_thread(checks_before_opening, facts, report.urls)
    report.findings += map(_hidden, found.failures)
    if len(report.urls) == 1:
        options = _learnt_options(report, name) | options_in(report.urls[0])
        if byte_order is not None:
            options["byte_order"] = byte_order
        await _query(facts, report, name, options, patience or options.get("patience"))
    elif report.urls:
        report.findings.append(_several(report.urls))
    else:
        report.findings.append(_nothing())
    return report


def _learnt_options(report: Report, name: str | None) -> dict[str, Any]:
    """Return what the profile of the board `name` says for an opening; a damaged profile is a finding."""
    try:
        profile = None if name is None else ProfileFile(name).load()
    except ProfileError as error:
        report.findings.append(
            Finding(
                "profile",
                str(error),
                "the profile of the board is damaged, and no program connects to the board before a correction",
                f"correct the file\nto forget the profile, with all limits: servolink board forget {name}",
            )
        )
        return {}
    learnt = {} if profile is None else {each: getattr(profile.settings, each) for each in _LEARNT}
    return {each: value for each, value in learnt.items() if value is not None}


def _check_address(url: str) -> None:
    options_in(url)
    try:
        create(url)
    except InvalidAddress:
        raise
    except TransportError:
        return  # a missing library, reported as a finding


def checks_before_opening(facts: SystemFacts, urls: list[str]) -> list[Finding]:
    """Return obstacles to and disturbances of the boards at `urls`, without opening any."""
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
    """Return whether `url` leads to a device with a missing device file."""
    if Address.parse(url).scheme not in {"serial", "hid", "usb"}:
        return False
    return not any(facts.node(path) for path in device_nodes(facts, url))


async def _query(
    facts: SystemFacts, report: Report, name: str | None, options: dict[str, Any], patience: float | None
) -> None:
    url = report.urls[0]
    expected: ByteOrder = options.get("byte_order", "little")
    ignore_extra = bool(options.get("ignore_extra"))
    unsupported = options.get("unsupported", ())
    opening: dict[str, Any] = {"patience": patience, "unsupported": unsupported, "ignore_extra": ignore_extra}
    try:
        transport, connection = await reach(url, expected, **opening)
    except HandshakeFailed as error:
        report.findings.append(_no_contact(url, error))
        return
    except TransportError as error:
        report.findings += _not_opened(facts, report, str(error))
        return
    try:
        report.response = await response_of(connection)
        report.unsupported = tuple(sorted(connection.unsupported))
        report.is_proved = connection.opener.is_proved
        report.findings += _differences(url, report.response, expected)
        known = {setting for setting in SETTINGS.values() if options.get(setting)}
        await _measure(facts, report, connection, patience, name, known)
        await connection.close()
        transport.settings = BoardSettings(ignore_extra=ignore_extra)
        await _converse(report, transport, connection)
    except (TransportError, RequestTimeout) as error:
        meaning, remedy = "the board answered before", "check cable, plugs and power"
        if transport.idle > _IDLE:
            meaning = "a serial server, bridge or adapter ends connections that are idle"
            remedy = "switch off its idle timeout, or have programs connect again: reconnect=True"
        if not (isinstance(error, RequestTimeout) and transport.record.pause):
            report.findings.append(Finding("connection", str(error), meaning, remedy))
    finally:
        await connection.close()
        await transport.free()
    if transport.record.pause:
        report.findings = [finding for finding in report.findings if finding.check not in _LATE]
        text = f"{escape(url)} makes pauses of up to {transport.record.pause:.1f} s inside a frame"
        report.findings.append(_paused(text))


async def _measure(
    facts: SystemFacts,
    report: Report,
    connection: Connection,
    patience: float | None,
    name: str | None,
    known: set[str],
) -> None:
    url = report.urls[0]
    report.line = line = await measure(connection, patience)
    for finding in check_line(line):
        if (setting := SETTINGS.get(finding.check)) is None:
            report.findings.append(finding)
        elif setting not in known:
            command = f"servolink board set {name} --{setting.replace('_', '-')} true\n" if name else ""
            in_address = f"in every program: {_with_option(url, setting, 'yes')}"
            report.findings.append(replace(finding, remedy=command + in_address))
    if not any(finding.check == LATENCY_TIMER for finding in report.findings):
        report.findings += check_round_trips(facts, url, line.round_trips)


async def _converse(report: Report, transport: SharedTransport, connection: Connection) -> None:
    """Look at all other responses, unless the line itself is the trouble."""
    line, order = report.line, connection.codec.byte_order
    if line is not None and not line.ended and not line.copies and line.repeated <= FEW_REPEATED:
        survey, findings = await converse(transport, connection.answered, order, line)
        known = {finding.check for finding in report.findings}
        report.findings += [finding for finding in findings if finding.check not in known]
        if survey is not None:
            silent = {name_of(query) for query in survey.silent}
            garbled = {name_of(query) for query in survey.garbled}
            report.unsupported = tuple(sorted(silent | (set(report.unsupported) - garbled)))
    report.findings += check_received(transport.record.beginning, order, report.findings)


def _not_opened(facts: SystemFacts, report: Report, problem: str) -> Iterator[Finding]:
    """Report a failed opening, unless another check has found the reason."""
    if any(finding.check in {"permissions", "in use", "hid package", "libusb"} for finding in report.findings):
        return
    url = report.urls[0]
    is_candidate = any(candidate.url.partition("?")[0] == url.partition("?")[0] for candidate in report.candidates)
    nodes = [path for path in device_nodes(facts, url) if facts.node(path)]
    yield Finding(
        "opening" if is_candidate or nodes else "absent",
        problem,
        "the board cannot be opened" if is_candidate or nodes else "no board can be reached at this address",
        f"do what the observation says\nto see the programs with the port open: sudo lsof {escape(nodes[0])}"
        if nodes
        else "do what the observation says\nto see the boards found: servolink list",
    )


def _no_contact(url: str, error: HandshakeFailed) -> Finding:
    """Return why the handshake failed in both byte orders, by what was received."""
    evidence, observation = error.evidence, str(error)
    tried = "queried in both byte orders and both transmission modes"
    try_all = "to query every device here: servolink list --probe"
    if evidence.several:
        return Finding(
            "several boards",
            observation,
            "a line is for one board: each request reaches all of them, and a motion turns all robots",
            "unplug all boards but one, or give each a line of its own\nno setting makes them usable together",
        )
    if evidence.longer:
        return Finding(
            "contents",
            observation,
            "the firmware has extended the protocol; what stands behind the known content can be ignored",
            f"in every program: {_with_option(url, 'ignore_extra', 'yes')}",
        )
    if (mark := evidence.mark) is not None and not evidence.answered:
        return Finding(mark.name, f"{escape(url)} {mark.text}; {tried}", mark.meaning, mark.remedy)
    if evidence.pause:
        return _paused(observation)
    if evidence.is_board:
        meaning = "it is a board, but too few of its responses arrive"
        remedy = "stop macros and motions of the board\nswitch it off and on, and try again\ncheck cable and power"
        if evidence.is_held:
            meaning = "an adapter, a bridge or the firmware holds each response back until more is sent"
            remedy = "set it to send at once what it receives"
        return Finding("responses" if evidence.is_held else "opening", observation, meaning, remedy)
    if evidence.echoes:
        return Finding("echo", observation, "the device returns what it receives", f"try another port\n{try_all}")
    if evidence.received:
        first = f"{evidence.received} bytes, first {LineBytes(evidence.data, evidence.byte_order).first()},"
        sent = f"text, {quote(evidence.text)}," if evidence.text else first
        return Finding(
            "no response",
            f"{escape(url)} sent {sent} but no response; {tried}",
            "the baud rate or the serial settings are wrong, the device is still starting, or it is of another kind",
            f'servolink doctor "{escape(_with_baudrate(url))}"\n{try_all}' if _has_baudrate(url) else try_all,
        )
    return Finding(
        "no response",
        f"{escape(url)} opens and is silent; {tried}",
        "the board is off, the cable has no data lines, the baud rate or the serial settings (8 data bits, no parity, "
        "no flow control) differ from those of the board, or the port belongs to another device",
        f"switch the board on and try another cable\n{try_all}",
    )


def _paused(observation: str) -> Finding:
    return Finding(
        "pauses",
        observation,
        "a bridge, adapter or the firmware sends frames in parts, with a pause between; each response takes as long",
        "set the bridge or adapter to send at once what it receives (no packing delay)",
    )


def _has_baudrate(url: str) -> bool:
    return Address.parse(url).scheme == "serial"


def _with_baudrate(url: str) -> str:
    return Address.parse(url).with_options({"baudrate": "9600"})


def _with_option(url: str, name: str, value: str) -> str:
    return escape(Address.parse(url).with_options({name: value}))


def _differences(url: str, response: ProbeResponse, byte_order: ByteOrder) -> Iterator[Finding]:
    if response.byte_order != byte_order:
        yield Finding(
            "byte order",
            f"the board uses {response.byte_order} byte order, and {byte_order} byte order is set",
            "neither side understands the numbers of the other, so requests have no response",
            f"servolink --byte-order {response.byte_order} --board {escape(url)} info\n"
            f"in every program: {_with_option(url, 'byte_order', response.byte_order)}",
        )
    if response.transmission_mode != 1:
        yield Finding(
            "transmission mode",
            "the board responded only after a switch to the new transmission mode",
            "servolink does not support the old mode; the new mode may end when the board is switched off",
            f"try your command again\nif the mode does not last: {_with_option(url, 'transmission_mode', '1')}",
        )


def _hidden(failure: TransportError) -> Finding:
    return Finding(
        "plug-in",
        str(failure),
        "servolink list and doctor miss all devices found by this plug-in only",
        "update the package, or remove it: pip uninstall PACKAGE",
    )


def _several(urls: list[str]) -> Finding:
    return Finding(
        "several",
        f"{len(urls)} boards are here: {', '.join(map(escape, urls))}",
        "none was queried, as only you know the right board",
        "\n".join(f"servolink doctor {escape(url)}" for url in urls),
    )


def _nothing() -> Finding:
    return Finding(
        "absent",
        "no serial port, HID or USB device here can be a board, and no virtual board is served",
        "the board is off or not plugged in, the cable has no data lines, or the board is on the network",
        "switch the board on and try another cable\nover the network: servolink doctor tcp://HOST:PORT\n"
        "without a board: servolink virtual",
    )
