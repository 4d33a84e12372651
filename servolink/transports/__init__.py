"""Byte pipes: serial ports, HID, USB, TCP and memory, with faults and recordings around them; listeners."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names
from servolink.transports.address import Address
from servolink.transports.base import Receiver, Transport
from servolink.transports.device_info import DeviceInfo, PortIdentity, is_accessible
from servolink.transports.lifecycle import BaseTransport, WrappedTransport
from servolink.transports.line_faults import MAX_LATE, Faults, FaultyTransport, LineFaults
from servolink.transports.line_recording import RecordingTransport, ReplayTransport
from servolink.transports.listeners.accept import RareWarning, accepting, converse
from servolink.transports.listeners.accepted import AcceptedConnection
from servolink.transports.listeners.forwarding import Connect, forward, listen, serve_network, serve_terminal
from servolink.transports.listeners.pacing import Pace
from servolink.transports.listeners.pty import ServedTerminal
from servolink.transports.listeners.strangers import Stranger, Strangers
from servolink.transports.listeners.tcp import NetworkPlace
from servolink.transports.memory import MemoryTransport
from servolink.transports.page_ports import Frames, PagePorts
from servolink.transports.registry import PlugIn, create
from servolink.transports.serial_ports import PortTracker
from servolink.transports.serial_ports import candidates as serial_devices
from servolink.transports.stream import StreamTransport

if TYPE_CHECKING:
    from servolink.transports.hid import HidDevice as HidDevice
    from servolink.transports.hid_devices import load_hidapi as load_hidapi
    from servolink.transports.listeners.http_connections import HttpConnection as HttpConnection
    from servolink.transports.listeners.http_connections import HttpServing as HttpServing
    from servolink.transports.serial import SerialTransport as SerialTransport
else:
    __getattr__ = lazy_names(
        __name__,
        {
            "listeners.http_connections": ("HttpConnection", "HttpServing"),
            "hid": ("HidDevice",),
            "hid_devices": ("load_hidapi",),
            "serial": ("SerialTransport",),
        },
    )

__all__ = [
    # pipes
    "BaseTransport",
    "Frames",
    "MemoryTransport",
    "PagePorts",
    "PlugIn",
    "Receiver",
    "StreamTransport",
    "Transport",
    "WrappedTransport",
    "create",
    # addresses and devices
    "serial_devices",
    "Address",
    "DeviceInfo",
    "PortIdentity",
    "is_accessible",
    # faults and recordings of a line
    "Faults",
    "FaultyTransport",
    "LineFaults",
    "MAX_LATE",
    "RecordingTransport",
    "ReplayTransport",
    # listeners
    "AcceptedConnection",
    "Connect",
    "NetworkPlace",
    "Pace",
    "RareWarning",
    "ServedTerminal",
    "Stranger",
    "Strangers",
    "accepting",
    "converse",
    "forward",
    "listen",
    "serve_network",
    "serve_terminal",
    # with packages that may be missing: aiohttp, pyserial
    "HidDevice",
    "HttpConnection",
    "HttpServing",
    "SerialTransport",
    "load_hidapi",
    # drivers
    "PortTracker",
]
