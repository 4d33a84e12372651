"""Permission to open a device, and udev rules with the permission."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from servolink.doctor.finding import Finding
from servolink.doctor.system import ListedUsbDevice, Node, SystemFacts, device_nodes, named_usb_device, usb_device
from servolink.errors import OpenError, escape

RULES = "/etc/udev/rules.d/70-servolink.rules"
INSTALL = f"""servolink doctor --print-udev | sudo tee {RULES}
sudo udevadm control --reload && sudo udevadm trigger
unplug the board and plug it in again"""
ADAPTERS = {
    (0x0403, 0x6001): "FTDI",
    (0x0403, 0x6010): "FTDI",
    (0x0403, 0x6011): "FTDI",
    (0x0403, 0x6014): "FTDI",
    (0x0403, 0x6015): "FTDI",
    (0x067B, 0x2303): "PL2303",
    (0x10C4, 0xEA60): "CP210x",
    (0x10C4, 0xEA70): "CP210x",
    (0x1A86, 0x5523): "CH341",
    (0x1A86, 0x55D4): "CH9102",
    (0x1A86, 0x7523): "CH340",
}
"""USB ids of adapter chips, built into all kinds of devices."""
SERIAL_GROUPS = ("dialout", "uucp")
"""Groups that own serial ports, depending on the distribution."""

_FOLDERS = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")
_TOO_LATE = "73-seat-late.rules"  # the system's own file for the tag `uaccess`
_PLAIN = re.compile(r"[A-Za-z0-9._:-]{1,126}", re.ASCII)  # no character has a meaning in a rule
_GROUP_READS_AND_WRITES = 0o060
_HEAD = f"""\
# {RULES}: permission to use the servo board.
# To install it:
#   servolink doctor --print-udev | sudo tee {RULES}
#   sudo udevadm control --reload && sudo udevadm trigger
# then unplug the board and plug it in again.
#
# `uaccess` permits users at this computer; the group permits users over the network, and services.
# ModemManager must ignore the board: otherwise every plugging in makes ModemManager write to the board.
"""


def rules_for(facts: SystemFacts, urls: Iterable[str]) -> str:
    """Return the text of the rules file for the boards at `urls`. Raise OpenError if none of them is on USB."""
    devices = [device for url in urls if (device := usb_device(facts, url) or named_usb_device(url)) is not None]
    if not devices:
        raise OpenError(
            "no board was found on USB to write rules for; plug the board in, or name one: "
            "servolink doctor --print-udev usb://VID:PID"
        )
    return rules(facts, devices)


def rules(facts: SystemFacts, devices: Iterable[ListedUsbDevice]) -> str:
    """Return the text of the rules file for `devices`."""
    group = next((name for name in SERIAL_GROUPS if facts.members(name) is not None), "")
    access = 'TAG+="uaccess"' + (f', MODE="0660", GROUP="{group}"' if group else "")
    parts = {_rules_for(device, access) for device in devices}
    return "\n".join([_HEAD, *sorted(parts)])


def is_installed(facts: SystemFacts) -> bool:
    """Return whether the rules are installed."""
    return bool(facts.text(RULES))


def check_rule_order(facts: SystemFacts, device: ListedUsbDevice | None) -> Iterator[Finding]:
    """Find rules for `device` with a tag, read too late for the tag."""
    if device is None:
        return
    for folder in _FOLDERS[:2]:
        for name in facts.names(folder):
            text = facts.text(f"{folder}/{name}")
            if name > _TOO_LATE and "uaccess" in text and f'"{device.vendor_id:04x}"' in text.lower():
                path = escape(f"{folder}/{name}")
                yield Finding(
                    "udev",
                    f"{path} tags this board with uaccess",
                    f"the tag has no effect: the system acts on the tag in {_TOO_LATE}, read earlier",
                    f"sudo mv {path} {RULES}\nsudo udevadm control --reload && sudo udevadm trigger",
                )


def rule_named(facts: SystemFacts, word: str) -> str:
    """Return the path of the first rules file with `word` in the name; empty without any."""
    paths = (f"{folder}/{name}" for folder in _FOLDERS for name in facts.names(folder) if word in name)
    return next((path for path in paths if facts.link(path) != "/dev/null"), "")


def _rules_for(device: ListedUsbDevice, access: str) -> str:
    """Return the rules for a device, without any text of the device that could change the meaning."""
    chip = ADAPTERS.get((device.vendor_id, device.product_id))
    number = device.serial_number if _PLAIN.fullmatch(device.serial_number) else ""
    ids = f'ATTRS{{idVendor}}=="{device.vendor_id:04x}", ATTRS{{idProduct}}=="{device.product_id:04x}"'
    name = re.sub(r"[^A-Za-z0-9 ._()/-]", "?", device.product) or "a board"
    lines = [f"# {name} ({device.vendor_id:04x}:{device.product_id:04x})"]
    mark = ""
    if chip and number:
        ids += f', ATTRS{{serial}}=="{number}"'
        lines.append(f"# Many devices contain {chip} adapters: the rules are for serial number {number}.")
    elif chip:
        lines.append(f"# Many devices contain {chip} adapters, and the device has no serial number.")
        lines.append("# Remove the # from the lines below to permit all of them.")
        mark = "#"
    lines.append(f'{mark}SUBSYSTEM=="tty", {ids}, {access}, ENV{{ID_MM_DEVICE_IGNORE}}="1"')
    lines.append(f'{mark}SUBSYSTEM=="hidraw", {ids}, {access}')
    own = ids.replace("ATTRS{", "ATTR{")
    lines.append(
        f'{mark}SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", {own}, {access}, ENV{{ID_MM_DEVICE_IGNORE}}="1"'
    )
    if chip == "FTDI":
        lines.append("# Responses after 1 ms instead of 16.")
        lines.append(
            f'{mark}ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", {ids}, ATTR{{latency_timer}}="1"'
        )
    return "\n".join(lines) + "\n"


def check_permissions(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find device files of `url` not open to the present user."""
    refused = False
    for path in device_nodes(facts, url):
        node = facts.node(path)
        if node is not None and not node.is_accessible:
            refused = True
            yield _refused(facts, url, path, node)
    if refused:
        yield from check_rule_order(facts, usb_device(facts, url))


def _refused(facts: SystemFacts, url: str, path: str, node: Node) -> Finding:
    observation = (
        f"{escape(path)} belongs to {node.owner}:{node.group} with mode {node.mode:04o}; "
        f"{facts.user or 'this user'} is in {', '.join(sorted(facts.groups)) or 'no group'}"
    )
    if node.mode & _GROUP_READS_AND_WRITES != _GROUP_READS_AND_WRITES or node.group in {"root", "0", "wheel"}:
        return _for_its_owner(facts, url, path, observation)
    if facts.user in (facts.members(node.group) or ()):
        return Finding(
            "permissions",
            observation,
            f"{facts.user} has been added to {node.group}, but the session began before the change",
            f"log out and in again, or for this terminal: newgrp {node.group}",
        )
    return Finding(
        "permissions",
        observation,
        f"only members of {node.group} may open the port",
        f"sudo usermod -aG {node.group} {facts.user or '$USER'}\nlog out and in again"
        + (f"\na service instead: SupplementaryGroups={node.group} in the unit" if _is_remote(facts) else ""),
    )


def _for_its_owner(facts: SystemFacts, url: str, path: str, observation: str) -> Finding:
    meaning = "only the owner may open the port"
    if usb_device(facts, url) is None:
        return Finding(
            "permissions", observation, meaning, f"run as the owner, or ask the owner: chmod g+rw {escape(path)}"
        )
    if not is_installed(facts):
        return Finding("permissions", observation, f"{meaning}, and no udev rule permits you to", INSTALL)
    if _is_remote(facts):
        meaning += "; the udev rule is for users at this computer, and the session comes over the network"
    else:
        meaning += "; the udev rule is there, but was installed after the board was plugged in, or names another board"
    return Finding("permissions", observation, meaning, INSTALL)


def _is_remote(facts: SystemFacts) -> bool:
    return "SSH_CONNECTION" in facts.environment or "XDG_SESSION_ID" not in facts.environment
