from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import InvalidAddress, TransportUnavailable, escape
from servolink.transports import create
from servolink.transports.address import Address


def _refusal(url: str) -> str:
    with pytest.raises(TransportUnavailable) as caught:
        Address.parse(url)
    return str(caught.value)


@pytest.mark.parametrize("path", ["/dev/ttyACM0", "COM3", "com12", "\\\\.\\COM10", "/dev/odd%name#1"])
def test_a_bare_device_path_is_serial_and_taken_literally(path: str) -> None:
    address = Address.parse(path)
    assert (address.scheme, address.host + address.path, address.url) == ("serial", path, path)


def test_a_bare_device_path_may_have_options() -> None:
    address = Address.parse("/dev/ttyACM0?baudrate=9600")
    assert (address.path, address.options) == ("/dev/ttyACM0", {"baudrate": "9600"})


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("serial:///dev/ttyACM0", ("serial", "", "", "/dev/ttyACM0")),
        ("SERIAL://COM3", ("serial", "COM3", "", "")),
        ("tcp://localhost:9000", ("tcp", "localhost", "9000", "")),
        ("tcp://[::1]:9000", ("tcp", "::1", "9000", "")),
        ("tcp://[fe80::1%25eth0]:9000", ("tcp", "fe80::1%eth0", "9000", "")),
        ("hid://0483:a2b1/SN%2F1", ("hid", "0483", "a2b1", "/SN/1")),
        ("virtual://", ("virtual", "", "", "")),
        ("serial:///dev/a%20b%ff", ("serial", "", "", "/dev/a b\udcff")),
    ],
)
def test_parts(url: str, parts: tuple[str, str, str, str]) -> None:
    address = Address.parse(url)
    assert (address.scheme, address.host, address.port, address.path) == parts


def test_options_are_read_by_kind() -> None:
    address = Address.parse("x://?whole=-5&part=1e-2&word=a%26b&on=1&off=0&pick=two&empty=")
    assert address.integer("whole", 0, -9, 9) == -5
    assert address.number("part", 0.0, 0.0, 1.0) == 0.01
    assert address.text("word", "") == "a&b"
    assert address.flag("on", default=False) is True
    assert address.flag("off", default=True) is False
    assert address.choice("pick", "one", ("one", "two")) == "two"
    assert address.text("empty", "something") == ""
    address.refuse_unknown()


def test_options_that_are_not_given_have_defaults() -> None:
    address = Address.parse("x://")
    assert address.integer("a", 3, 0, 1) == 3
    assert address.number("b", 0.5, 1.0, 2.0) == 0.5
    assert address.text("c", "text") == "text"
    assert address.flag("d", default=True) is True
    assert address.choice("e", "one", ("one",)) == "one"


@pytest.mark.parametrize("text", ["", "10", "-1", "1_0", "1.0", "\uff11", " 1", "9" * 5000, "nan"])
def test_an_integer_out_of_range_or_form_is_refused(text: str) -> None:
    address = Address.parse(f"x://?count={text}")
    with pytest.raises(TransportUnavailable, match=r"option count must be an integer from 0 to 9"):
        address.integer("count", 0, 0, 9)


@pytest.mark.parametrize("text", ["", "1.5", "-1", "nan", "inf", "1e999", "0x1", "1e", "."])
def test_a_number_out_of_range_or_form_is_refused(text: str) -> None:
    address = Address.parse(f"x://?drop={text}")
    with pytest.raises(TransportUnavailable, match=r"option drop must be a number from 0 to 1"):
        address.number("drop", 0.0, 0.0, 1.0)


def test_a_flag_is_0_or_1() -> None:
    with pytest.raises(TransportUnavailable, match="must be one of 0, 1"):
        Address.parse("x://?dtr=yes").flag("dtr", default=False)


def test_unknown_options_are_refused_with_the_known_ones() -> None:
    address = Address.parse("x://?baudrat=1")
    address.integer("baudrate", 115200, 1, 10**6)
    address.flag("dtr", default=False)
    with pytest.raises(TransportUnavailable, match="unknown option baudrat; x:// has: baudrate, dtr; every address"):
        address.refuse_unknown()


def test_options_of_the_connection_are_not_for_the_transport() -> None:
    address = Address.parse("x://?byte_order=big&a=1&depth=4")
    assert (address.options, address.connection_options) == ({"a": "1"}, {"byte_order": "big", "depth": "4"})
    with pytest.raises(InvalidAddress, match=r"unknown option a; x:// has: none of its own; every address has: byte_o"):
        address.refuse_unknown()
    assert (address.integer("a", 0, 0, 9), address.integer("depth", 1, 1, 64)) == (1, 4)
    address.refuse_unknown()


def test_a_serial_device_is_the_same_whichever_of_its_names_is_written(tmp_path: Path) -> None:
    link = tmp_path / "usb-board"
    link.symlink_to("/dev/ttyACM0")
    for url in ("/dev/ttyACM0", "serial:///dev/ttyACM0?baudrate=9600", f"serial://{link}", str(link)):
        assert Address.parse(url).serial_device == "/dev/ttyACM0"
    assert [Address.parse(url).serial_device for url in ("com3", "serial://COM3", "\\\\.\\COM3")] == ["COM3"] * 3
    assert Address.parse("serial://board").serial_device == "board"
    assert Address.parse("tcp://ttyACM0:1").serial_device == ""


@pytest.mark.parametrize("port", ["", "0", "65536", "-1", "http", "9" * 10000])
def test_a_port_is_a_number_from_1_to_65535(port: str) -> None:
    with pytest.raises(TransportUnavailable, match="needs a port from 1 to 65535"):
        Address.parse(f"tcp://host:{port}").port_number()


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("", "'' is not an address; write it as serial:///dev/ttyACM0"),
        ("ttyACM0", "write it as serial:///dev/ttyACM0"),
        ("localhost:9000", "write tcp://localhost:9000"),
        ("[::1]:9000", "write tcp://[::1]:9000"),
        ("1x://a", "is not an address"),
        ("tcp://::1:9000", "in brackets"),
        ("tcp://[::1:9000", "in brackets"),
        ("tcp://a:1?x=%zz", "write a percent sign as %25"),
        ("tcp://a:1?x=%f", "'%f'"),
        ("tcp://a:1?x", "'x' must be written name=value"),
        ("tcp://a:1?=x", "must be written name=value"),
        ("tcp://a:1?x=1&x=1", "option x is given twice"),
        ("serial:///dev/%00", "holds a control character"),
        ("/dev/tty\x1b[2J", "/dev/tty\\x1b[2J: holds a control character"),
    ],
)
def test_what_is_no_address_is_refused_with_what_to_write(url: str, text: str) -> None:
    assert text in _refusal(url)


@pytest.mark.parametrize(
    ("url", "remedy"),
    [
        ("telnet://h:9000", "write rfc2217://host:port, or tcp://host:port"),
        ("mqtt://h", "`servolink fleet`"),
    ],
)
def test_an_address_of_another_program_is_refused_with_what_to_write(url: str, remedy: str) -> None:
    with pytest.raises(InvalidAddress, match=remedy):
        create(url)


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:7911", "/dev/ttyUSB0", "serial://COM3", "virtual://?servos=3"])
@pytest.mark.parametrize("pasted", ["{} ", " {}", "{}\n", "\t{}\r\n", "{}\u00a0"])
def test_blanks_around_an_address_are_no_part_of_it(url: str, pasted: str) -> None:
    assert Address.parse(pasted.format(url)).url == url
    assert create(pasted.format(url)).url == url
    assert Address.parse(pasted.format(url)).with_options({"depth": "2"}).count(" ") == 0


@pytest.mark.parametrize("url", ["x" * 10**6, "serial:///" + "/" * 10**6, "tcp://" + "a." * 10**6 + ":1"])
def test_a_huge_address_is_refused_and_not_repeated_whole(url: str) -> None:
    with pytest.raises(InvalidAddress, match="is longer than 65,536 characters") as refused:
        Address.parse(url)
    assert len(str(refused.value)) < 500


@given(st.one_of(st.text(), st.from_regex(r"(tcp|serial|virtual)://.{0,10}(:.{0,6})?(\?.{0,20})?")))
def test_any_text_is_an_address_or_one_readable_refusal(url: str) -> None:
    try:
        address = Address.parse(url)
        address.port_number()
        address.refuse_unknown()
    except TransportUnavailable as error:
        quote = str(error)
    else:
        quote = escape(address.url)
    assert quote == escape(quote)
