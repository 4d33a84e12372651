"""Address of a fleet's broker, and credentials of a program."""

from __future__ import annotations

import hashlib
import os
import ssl
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote, urlsplit

from servolink.errors import InvalidAddress, OpenError, ServolinkError, TransportUnavailable, quote
from servolink.support import others_can_read, read_text, reason

PASSWORD_VARIABLE = "SERVOLINK_MQTT_PASSWORD"  # noqa: S105 - its name, not its value
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_MOST_PORT = 65535
_MOST_PASSWORD = 4096  # bytes in a password file at most
_FORMS = "write it as mqtt://HOST, mqtts://HOST:8883 or mqtt://USER@HOST"


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """The address of a broker."""

    host: str
    port: int
    is_encrypted: bool
    user: str | None = None

    def __str__(self) -> str:
        """Return the address for people, without the user."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.is_encrypted else 'mqtt'}://{host}:{self.port}"


def parse_broker(url: str) -> BrokerAddress:
    """Return the address in `url`, without blanks around it. Raise InvalidAddress with a remedy."""
    url = url.strip()
    if not url.isprintable() or any(map(str.isspace, url)):
        _refuse(url, "holds spaces or control characters")
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        _refuse(url, f"cannot be read ({error})")
    if parts.scheme not in _PORTS:
        _refuse(url, "is not the address of an MQTT broker")
    if not parts.hostname:
        _refuse(url, "names no host")
    if parts.password is not None:
        raise InvalidAddress(
            "a password in an address can be read by every user of this machine: give the password with "
            f"--password-file, in {PASSWORD_VARIABLE} or in the keyring of the system"
        )
    if parts.path.strip("/") or parts.query or parts.fragment:
        _refuse(url, "has something behind the host")
    port = _PORTS[parts.scheme] if port is None else port
    if not 0 < port <= _MOST_PORT:
        _refuse(url, f"has a port outside 1 to {_MOST_PORT}")
    user = None if parts.username is None else unquote(parts.username)
    return BrokerAddress(parts.hostname, port, parts.scheme == "mqtts", user)


def _refuse(url: str, why: str) -> NoReturn:
    raise InvalidAddress(f"{quote(url)} {why}; {_FORMS}")


@dataclass(frozen=True, slots=True)
class BrokerAccess:
    """A broker, and how to get in."""

    address: BrokerAddress
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = None

    @classmethod
    def of(
        cls,
        url: str,
        *,
        user: str | None = None,
        password_file: Path | None = None,
        ca: Path | None = None,
        certificate: Path | None = None,
        key: Path | None = None,
    ) -> BrokerAccess:
        """Return the access to the broker at `url`. Blocks: reads files, and may ask the keyring of the system.

        The user is that of `url` unless given. The password is in the first line of `password_file`, in the
        environment (SERVOLINK_MQTT_PASSWORD) or in the keyring of the system, where it belongs to the address of the
        broker. `ca` holds the certificates that the broker's is checked against, those of the system unless given;
        `certificate` and `key` are this program's own.

        Raise InvalidAddress for an impossible address, and ServolinkError for a file that cannot be used.
        """
        address = parse_broker(url)
        if not address.is_encrypted and (ca or certificate or key):
            raise InvalidAddress(f"certificates are for mqtts://, and {address} is not encrypted")
        if key and not certificate:
            raise InvalidAddress("a key needs its certificate: give both")
        user = user or address.user
        tls = _tls(ca, certificate, key) if address.is_encrypted else None
        return cls(address, user, _password(address, user, password_file), tls)

    def identifier(self, name: str) -> str:
        """Return the identifier of the connection `name`: always the same, and not known without the password.

        Any user of a broker can end the connection whose identifier the user knows, by connecting with it.
        """
        if self.password is None:
            return name
        key = self.password.encode()[: hashlib.blake2b.MAX_KEY_SIZE]
        return f"{name}/{hashlib.blake2b(name.encode(), key=key, digest_size=8).hexdigest()}"


def _tls(ca: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=ca)
    except (OSError, ssl.SSLError) as error:
        raise ServolinkError(f"{ca} cannot be used as certificates of authorities: {reason(error)}") from error
    if certificate is not None:
        try:
            context.load_cert_chain(certificate, key, password=_no_password)
        except (OSError, ssl.SSLError, ValueError) as error:
            raise ServolinkError(
                f"{certificate} and its key cannot be used: {reason(error)}; both must be PEM files, and "
                "the key must not be encrypted"
            ) from error
    return context


def _no_password() -> str:
    """Answer OpenSSL, which otherwise asks at the terminal."""
    return ""


def _password(address: BrokerAddress, user: str | None, file: Path | None) -> str | None:
    if file is not None:
        try:
            text = read_text(file, _MOST_PASSWORD)
        except (OSError, ValueError) as error:
            raise ServolinkError(f"{file} cannot be used as a password: {reason(error)}") from error
        if others_can_read(file):
            raise ServolinkError(f"{file} has a password that other users can read: run `chmod 600 {quote(str(file))}`")
        return _with_user(user, text.partition("\n")[0].removesuffix("\r"), f"the password in {file}")
    if (text := os.environ.get(PASSWORD_VARIABLE, "")) or user is None:
        return _with_user(user, text, f"the password in {PASSWORD_VARIABLE}") if text else None
    return _from_keyring(str(address), user)


def _with_user(user: str | None, password: str, what: str) -> str:
    if user is None:
        raise OpenError(f"{what} belongs to a user: name one, as in mqtt://USER@HOST or --user")
    return password


def _from_keyring(service: str, user: str) -> str | None:
    """Return the password in the keyring of the system, None if there is none."""
    try:
        import keyring
        from keyring.errors import KeyringError
    except ModuleNotFoundError:
        return None
    try:
        return keyring.get_password(service, user)
    except (KeyringError, OSError, RuntimeError) as error:
        raise TransportUnavailable(
            f"the keyring of the system cannot be read: {error}; give the password with --password-file or in "
            f"{PASSWORD_VARIABLE}"
        ) from error
