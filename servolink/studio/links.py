"""Links for tablets and other machines, with QR codes for cameras: one link drives, one watches, until revoked."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

from servolink.studio.gate import Gate, Token, address_of

_MARGIN = 4
"""White modules around a code; cameras need the margin."""


class QrCode(Struct, frozen=True):
    """A code as a picture."""

    size: int
    """Width and height, with the margin, in modules."""
    path: str
    """Black modules of the code, as the `d` of a path in SVG."""


def qr_code(text: str) -> QrCode:
    """Return the QR code of `text`."""
    import segno  # a page without a server has no links, and no segno

    code = segno.make_qr(text, error="m")
    runs: list[str] = []
    for y, row in enumerate(code.matrix, _MARGIN):
        x = _MARGIN
        for is_black, modules in groupby(row):
            width = len(list(modules))
            if is_black:
                runs.append(f"M{x} {y}h{width}v1h-{width}z")
            x += width
    return QrCode(len(code.matrix) + 2 * _MARGIN, "".join(runs))


LinkRole: TypeAlias = Literal["edit", "watch"]
ROLES: tuple[LinkRole, ...] = ("edit", "watch")


class LinkAddress(Struct, frozen=True):
    """Link with role, host and QR code."""

    role: LinkRole
    host: str
    address: Annotated[str, Meta(description="with its secret")]
    qr: QrCode


class Links:
    """Links of a studio, by role."""

    def __init__(self, gate: Gate, port: int, hosts: tuple[str, ...]) -> None:
        """Make links for both roles, for each host name by which other machines reach the studio."""
        self._gate = gate
        self._port = port
        self._hosts = hosts
        self._tokens: dict[LinkRole, Token] = {role: gate.new_token(role) for role in ROLES} if hosts else {}

    def addresses(self) -> tuple[LinkAddress, ...]:
        """Return the valid links; none for a studio reached from this machine only."""
        return tuple(
            LinkAddress(role, host, address, qr_code(address))
            for host in self._hosts
            for role, token in sorted(self._tokens.items())
            for address in [f"{address_of(host, self._port)}/#token={token}"]
        )

    def is_one(self, token: Token) -> bool:
        """Return whether the token belongs to a link, so that the page was opened through a link."""
        return token in self._tokens.values()

    def revoke(self, role: LinkRole) -> Token | None:
        """Close the link of a role. Return the token, None for a link that was closed already."""
        token = self._tokens.pop(role, None)
        if token is not None:
            self._gate.revoke(token)
        return token

    def renew(self, role: LinkRole) -> None:
        """Make a link for the role, unless a link exists."""
        if self._hosts and role not in self._tokens:
            self._tokens[role] = self._gate.new_token(role)
