"""Whether the device may be opened by this user, and who could change that."""

from __future__ import annotations

from collections.abc import Iterator

from servolink.doctor.facts import Node, SystemFacts
from servolink.doctor.finding import Finding
from servolink.doctor.nodes import device_nodes, usb_device
from servolink.doctor.udev import INSTALL, check_order, is_installed
from servolink.printable import printable

_GROUP_MAY = 0o060


def check_permissions(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find device files of `url` that this user may not use."""
    refused = False
    for path in device_nodes(facts, url):
        node = facts.node(path)
        if node is not None and not node.usable:
            refused = True
            yield _refused(facts, url, path, node)
    if refused:
        yield from check_order(facts, usb_device(facts, url))


def _refused(facts: SystemFacts, url: str, path: str, node: Node) -> Finding:
    seen = (
        f"{printable(path)} belongs to {node.owner}:{node.group} with mode {node.mode:04o}; "
        f"{facts.user or 'this user'} is in {', '.join(sorted(facts.groups)) or 'no group'}"
    )
    if node.mode & _GROUP_MAY != _GROUP_MAY or node.group in {"root", "0", "wheel"}:
        return _for_nobody(facts, url, path, seen)
    if facts.user in (facts.members(node.group) or ()):
        return Finding(
            "permissions",
            seen,
            f"{facts.user} has been added to {node.group}, but this session began before that",
            f"log out and in again, or for this terminal: newgrp {node.group}",
        )
    return Finding(
        "permissions",
        seen,
        f"only members of {node.group} may use it",
        f"sudo usermod -aG {node.group} {facts.user or '$USER'}\nlog out and in again"
        + (f"\na service instead: SupplementaryGroups={node.group} in its unit" if _is_remote(facts) else ""),
    )


def _for_nobody(facts: SystemFacts, url: str, path: str, seen: str) -> Finding:
    means = "nobody but its owner may use it"
    if usb_device(facts, url) is None:
        return Finding(
            "permissions", seen, means, f"run as its owner, or let him give it: chmod g+rw {printable(path)}"
        )
    if not is_installed(facts):
        return Finding("permissions", seen, f"{means}, and no udev rule gives it to you", INSTALL)
    if _is_remote(facts):
        means += "; the udev rule gives it to whoever sits at this machine, and this session comes over the network"
    else:
        means += "; the udev rule is there, but was not in force when the board was plugged in, or names another board"
    return Finding("permissions", seen, means, INSTALL)


def _is_remote(facts: SystemFacts) -> bool:
    return "SSH_CONNECTION" in facts.environment or "XDG_SESSION_ID" not in facts.environment
