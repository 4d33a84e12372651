"""The gate lets in pages of the studio, by name, origin and token, and nothing else."""

from __future__ import annotations

import itertools

import pytest

from servolink.studio.gate import Gate, address_of


def test_names_of_this_machine_are_known_with_the_port_only() -> None:
    gate = Gate(8200)
    assert gate.is_ours("127.0.0.1:8200")
    assert gate.is_ours("LOCALHOST:8200")
    for host in (None, "", "127.0.0.1", "localhost:8201", "evil.example:8200", "127.0.0.1:8200.evil.example"):
        assert not gate.is_ours(host)


def test_only_our_own_origins_are_ours() -> None:
    gate = Gate(8200)
    assert gate.is_our_page("http://localhost:8200")
    for origin in (None, "", "null", "http://localhost", "http://localhost:8201", "https://localhost:8200", "file://"):
        assert not gate.is_our_page(origin)


def test_an_allowed_host_may_stand_behind_a_proxy() -> None:
    for host, address in (
        ("robot.local", "http://robot.local:8200"),
        ("https://robot.local", "https://robot.local"),
        ("https://Robot.local:8443/", "https://robot.local:8443"),
    ):
        gate = Gate(8200, [host])
        for scheme, port in itertools.product(("http", "https"), ("", ":8200", ":8443")):
            other = f"{scheme}://robot.local{port}"
            assert gate.is_our_page(other) == (other == address)
            assert gate.is_ours(f"robot.local{port}") == address.endswith(f"robot.local{port}")
        assert not gate.is_ours("other.local:8200")


def test_browsers_leave_the_default_port_out() -> None:
    gate = Gate(80, ["robot.local", "https://robot.school.example:443"])
    assert gate.address == "http://127.0.0.1"
    assert address_of("https://Robot.school.example:443/", 80) == "https://robot.school.example"
    for name, scheme in (("localhost", "http"), ("robot.local", "http"), ("robot.school.example", "https")):
        assert gate.is_ours(name)
        assert gate.is_our_page(f"{scheme}://{name}")
    assert not gate.is_our_page("http://robot.school.example")
    assert address_of("https://robot.local:80", 443) == "https://robot.local:80"
    assert address_of("robot.local", 443) == "http://robot.local:443"


def test_a_token_opens_the_studio_for_its_role_until_it_is_revoked() -> None:
    gate = Gate(8200)
    drive, watch = gate.new_token("edit"), gate.new_token("watch")
    assert gate.role_of(drive) == "edit"
    assert gate.role_of(watch) == "watch"
    gate.revoke(watch)
    gate.revoke("unknown")
    assert gate.role_of(watch) is None
    assert gate.role_of(drive) == "edit"


@pytest.mark.parametrize("token", ["", "x", "\udcff", "é" * 100, " "])
def test_other_texts_open_nothing(token: str) -> None:
    gate = Gate(8200)
    known = gate.new_token("edit")
    assert gate.role_of(token) is None
    assert gate.role_of(known[:-1]) is None


def test_no_two_tokens_are_equal() -> None:
    gate = Gate(8200)
    assert len({gate.new_token("watch") for _ in range(100)}) == 100
