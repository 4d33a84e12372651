"""The address of a broker, and what a program shows there.

Module: servolink.cli.fleet.broker_options.
"""

from __future__ import annotations

import sys
from pathlib import Path

import keyring
import pytest
from keyring.errors import KeyringError

from servolink.errors import InvalidAddress, OpenError, ServolinkError, TransportUnavailable
from servolink.fleet.access import PASSWORD_VARIABLE, BrokerAccess, BrokerAddress, parse_broker

SESAME = "sesame"


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("mqtt://localhost", BrokerAddress("localhost", 1883, is_encrypted=False)),
        (" mqtt://localhost\n", BrokerAddress("localhost", 1883, is_encrypted=False)),
        ("mqtts://broker.school:9000/", BrokerAddress("broker.school", 9000, is_encrypted=True)),
        ("mqtts://rex%40home@[fe80::1]", BrokerAddress("fe80::1", 8883, is_encrypted=True, user="rex@home")),
    ],
)
def test_an_address_is_read(url: str, address: BrokerAddress) -> None:
    assert parse_broker(url) == address


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("localhost", "is not the address of an MQTT broker"),
        ("http://localhost", "is not the address of an MQTT broker"),
        ("mqtt://", "names no host"),
        ("mqtt://a:x", "cannot be read"),
        ("mqtt://a:0", "a port outside 1"),
        ("mqtt://a:70000", "cannot be read"),
        ("mqtt://a/topic", "something behind the host"),
        ("mqtt://a b", "spaces or control characters"),
        ("mqtt://a\nb", "spaces or control characters"),
        ("mqtt://rex:secret@a", "a password in an address can be read by every user"),
    ],
)
def test_other_addresses_are_refused(url: str, why: str) -> None:
    with pytest.raises(InvalidAddress, match=why) as error:
        parse_broker(url)
    assert "secret" not in str(error.value)


def test_an_address_is_shown_without_its_user() -> None:
    assert str(parse_broker("mqtts://rex@[fe80::1]")) == "mqtts://[fe80::1]:8883"


def test_a_password_comes_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("sesame\r\nmore", encoding="utf-8")
    (tmp_path / "secret").chmod(0o600)
    access = BrokerAccess.of("mqtt://rex@localhost", password_file=tmp_path / "secret")
    assert (access.user, access.password) == ("rex", "sesame")
    assert "sesame" not in repr(access)


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620])
def test_a_file_that_others_can_read_gives_no_password(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "secret"
    file.write_text(SESAME, encoding="utf-8")
    file.chmod(mode)
    with pytest.raises(ServolinkError, match="a password that other users can read: run `chmod 600"):
        BrokerAccess.of("mqtt://rex@localhost", password_file=file)


def test_a_password_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PASSWORD_VARIABLE, SESAME)
    assert BrokerAccess.of("mqtt://localhost", user="rex").password == SESAME
    with pytest.raises(OpenError, match="belongs to a user: name one"):
        BrokerAccess.of("mqtt://localhost")


def test_a_password_comes_from_the_keyring(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = {("mqtt://localhost:1883", "rex"): SESAME}
    monkeypatch.setattr(keyring, "get_password", lambda service, user: kept.get((service, user)))
    assert BrokerAccess.of("mqtt://rex@localhost").password == SESAME
    assert BrokerAccess.of("mqtt://fido@localhost").password is None
    assert BrokerAccess.of("mqtt://localhost").password is None


def test_a_keyring_that_fails_is_an_error_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(service: str, user: str) -> None:
        raise KeyringError("locked")

    monkeypatch.setattr(keyring, "get_password", fail)
    with pytest.raises(TransportUnavailable, match="cannot be read: locked; give the password with --password-file"):
        BrokerAccess.of("mqtt://rex@localhost")


def test_no_keyring_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "keyring", None)
    assert BrokerAccess.of("mqtt://rex@localhost").password is None


def test_files_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    missing, wrong = tmp_path / "missing", tmp_path / "wrong.pem"
    wrong.write_text("nothing", encoding="utf-8")
    with pytest.raises(ServolinkError, match=r"missing cannot be used as a password: No such file"):
        BrokerAccess.of("mqtt://rex@localhost", password_file=missing)
    with pytest.raises(ServolinkError, match=r"wrong.pem cannot be used as certificates"):
        BrokerAccess.of("mqtts://localhost", ca=wrong)
    with pytest.raises(ServolinkError, match=r"wrong.pem and its key cannot be used"):
        BrokerAccess.of("mqtts://localhost", certificate=wrong)


def test_certificates_are_for_encrypted_addresses(tmp_path: Path) -> None:
    with pytest.raises(InvalidAddress, match="is not encrypted"):
        BrokerAccess.of("mqtt://localhost", ca=tmp_path)
    with pytest.raises(InvalidAddress, match="give both"):
        BrokerAccess.of("mqtts://localhost", key=tmp_path)
    assert BrokerAccess.of("mqtts://localhost").tls is not None


def test_the_identifier_of_a_connection_stays_and_is_known_with_its_password_only() -> None:
    address = parse_broker("mqtt://localhost")
    found = [
        BrokerAccess(address, "rex", password).identifier("servolink/rex") for password in ("a", "a", "b", "x" * 99)
    ]
    assert found[0] == found[1]
    assert len(set(found)) == 3
    assert all(one.startswith("servolink/rex/") for one in found)
    assert BrokerAccess(address).identifier("servolink/rex") == "servolink/rex"
