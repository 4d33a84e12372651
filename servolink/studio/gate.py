"""Gate: pages and browsers that may talk to the studio.

A browser sends requests for any site that it shows. What tells our page from others is the name under which it was
loaded (`Host`), the page that asks (`Origin`), and a secret that no other page can know (the token). All three are
needed: an attacker's name can resolve to this machine, another program here can serve pages too, and cookies are sent
to every port.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from typing import TypeAlias

from servolink.control import RoleName
from servolink.errors import quote

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_TOKEN_BYTES = 24
_TLS = "https://"
_DEFAULT_PORTS = (("http://", ":80"), (_TLS, ":443"))

Token: TypeAlias = str


def address_of(host: str, port: int) -> str:
    """Return the address of the page, as browsers write it, for a machine that reaches the studio as `host`."""
    address = host.rstrip("/") if host.startswith(_TLS) else f"http://{host}:{port}"
    for scheme, default in _DEFAULT_PORTS:
        if address.startswith(scheme):
            address = address.removesuffix(default)
    return address.lower()


class Gate:
    """Names under which the studio is reached, and tokens of the studio, with their roles."""

    def __init__(self, port: int, hosts: Iterable[str] = (), own: str = LOOPBACK[0]) -> None:
        """Admit pages loaded from this machine at `port`, or from one of `hosts`, such as `robot.local`.

        A host may be behind a proxy that encrypts, as in `https://robot.school.example`. This machine itself reaches
        the studio as `own`.
        """
        self.address = address_of(own, port)
        """Address of the page on this machine."""
        self._origins = {self.address, *(address_of(host, port) for host in (*LOOPBACK, *hosts))}
        self._hosts = {origin.partition("://")[2] for origin in self._origins}
        self._tokens: dict[Token, RoleName] = {}

    def is_ours(self, host: str | None) -> bool:
        """Return whether a request was sent to a name of the studio."""
        return host is not None and host.lower() in self._hosts

    def refusal(self, host: str) -> str:
        """Return the error for a page at another host: the names under which the studio is reached."""
        names = ", ".join(sorted(self._hosts))
        return f"the studio is reached as {names}, not as {quote(host)}; --allow-host adds a name\n"

    def is_our_page(self, origin: str | None) -> bool:
        """Return whether a request comes from a page of the studio. Programs other than browsers send no origin."""
        return origin is not None and origin.lower() in self._origins

    def new_token(self, role: RoleName) -> Token:
        """Return a new secret token for the role."""
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._tokens[token] = role
        return token

    def revoke(self, token: Token) -> None:
        """Close the studio for a token. No effect for an unknown token."""
        self._tokens.pop(token, None)

    def role_of(self, token: str) -> RoleName | None:
        """Return the role of a token, None for an unknown token.

        Takes as long whether or not it is known, or nearly so.
        """
        found: RoleName | None = None
        given = token.encode("utf-8", "surrogatepass")
        for known, role in self._tokens.items():
            if hmac.compare_digest(known.encode(), given):
                found = role
        return found
