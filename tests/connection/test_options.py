"""Options of a connection, in addresses."""

from __future__ import annotations

from typing import Any

import pytest

from servolink.connection.options import ConnectionOptions, options_in
from servolink.errors import InvalidAddress


@pytest.mark.parametrize(
    ("query", "options"),
    [
        ("", {}),
        ("?servos=2&seed=1", {}),
        ("?byte_order=big", {"byte_order": "big"}),
        ("?transmission_mode=1&servos=2", {"transmission_mode": 1}),
        ("?transmission_mode=keep", {"transmission_mode": "keep"}),
        (
            "?caption_encoding=gbk&transmission_mode=auto&patience=0.5&depth=64",
            {"caption_encoding": "gbk", "transmission_mode": "auto", "patience": 0.5, "depth": 64},
        ),
    ],
)
@pytest.mark.parametrize("place", ["virtual://", "/dev/ttyACM0", "serial:///dev/ttyACM0", "other-package://x:1/y"])
def test_an_address_gives_the_options_that_are_in_it(place: str, query: str, options: dict[str, Any]) -> None:
    assert options_in(place + query) == options
    ConnectionOptions(**options)


@pytest.mark.parametrize(
    ("query", "text"),
    [
        ("byte_order=middle", "option byte_order must be one of little, big, not 'middle'"),
        ("caption_encoding=klingon", "option caption_encoding: caption encoding 'klingon' cannot be used; choose one"),
        ("transmission_mode=0", "option transmission_mode must be one of auto, keep, 1, not '0'"),
        ("patience=0", "option patience must be a number from 0.001 to 3600, not '0'"),
        ("patience=soon", "option patience must be a number from 0.001 to 3600, not 'soon'"),
        ("depth=65", "option depth must be an integer from 1 to 64, not '65'"),
        ("depth=1.5", "option depth must be an integer from 1 to 64, not '1.5'"),
        ("depth=2&depth=2", "option depth is given twice; keep one value"),
    ],
)
def test_a_wrong_option_is_refused_with_what_is_allowed(query: str, text: str) -> None:
    with pytest.raises(InvalidAddress) as caught:
        options_in(f"tcp://host:1?{query}")
    assert str(caught.value) == f"tcp://host:1?{query}: {text}" or str(caught.value).startswith(
        f"tcp://host:1?{query}: {text} such as "
    )
