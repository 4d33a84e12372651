"""What the declaration of a method says: what it touches, and from where it may be called.

Module: servolink.control.rights.
"""

from __future__ import annotations

import pytest

from servolink.control.error_codes import Code, RpcError
from servolink.control.peer import Methods
from servolink.control.rights import Origin, Role, Scope, Touches


def test_a_method_that_does_not_say_what_it_touches_is_not_declared() -> None:
    with pytest.raises(TypeError, match="touches"):
        Methods[None]().add("dance", Role.MOVE)  # type: ignore[call-arg]


def test_a_method_comes_from_afar_only_if_it_says_so() -> None:
    with pytest.raises(RpcError, match="there is no method 'dance' from afar") as refused:
        Scope(Touches.NOTHING).check("dance", Origin.AFAR)
    assert refused.value.code is Code.METHOD_NOT_FOUND
    Scope(Touches.MOTION, from_afar=True).check("dance", Origin.AFAR)


@pytest.mark.parametrize("touches", [Touches.SESSION, Touches.HOST, Touches.HOST | Touches.MOTION])
def test_what_belongs_to_a_connection_or_to_this_computer_cannot_come_from_afar(touches: Touches) -> None:
    with pytest.raises(ValueError, match=f"touches {Scope(touches).words} cannot come from afar"):
        Scope(touches, from_afar=True)


@pytest.mark.parametrize("touches", [Touches.HOST, Touches.HOST | Touches.BOARD, Scope.unknown().touches])
def test_a_link_touches_nothing_of_this_computer(touches: Touches) -> None:
    with pytest.raises(RpcError, match="opened through a link") as refused:
        Scope(touches).check("keep", Origin.LINK)
    assert refused.value.code is Code.FORBIDDEN
    Scope(touches).check("keep", Origin.HERE)
    Scope(Touches.MOTION | Touches.BOARD | Touches.SESSION).check("keep", Origin.LINK)


def test_what_a_method_touches_is_told_in_words() -> None:
    assert Scope(Touches.NOTHING).words == "nothing"
    assert Scope(Touches.MOTION | Touches.BOARD).words == "motion, board"
