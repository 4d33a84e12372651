"""Blocks: programs put together on the screen Blocks of the studio.

Project files keep the blocks beside the actions, macros and tables made of them; no blocks are ever sent to a board.
Numbers can be beyond the ranges of a board: the studio then says which block the board cannot run, and why.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from servolink.errors import EncodeError, quote

MOST_BLOCKS = 1000
MOST_LEVELS = 40
"""Maximum depth of blocks inside blocks; a board plays fewer."""

BlockId: TypeAlias = Annotated[str, Meta(min_length=1, max_length=64, pattern="^[ -~]+$")]
Name: TypeAlias = Annotated[str, Meta(max_length=64)]
Number: TypeAlias = Annotated[int, Meta(ge=-(2**53), le=2**53)]
Target: TypeAlias = Annotated[str, Meta(pattern=r"^((action|macro) -?\d{1,10}|block [ -~]{1,64})?$", max_length=80)]
Place: TypeAlias = Annotated[float, Meta(ge=-1_000_000, le=1_000_000)]
Version: TypeAlias = Annotated[Literal[1], Meta(description="version of the format")]


class _Block(Struct, frozen=True, forbid_unknown_fields=True, tag_field="type"):
    """Base class of all blocks, with the id."""

    id: BlockId


class ServoBlock(_Block, frozen=True, tag="servo"):
    """Target of a single servo in a pose."""

    servo_id: Number
    degree: Number


class PoseBlock(_Block, frozen=True, tag="pose"):
    """Pose: becomes an action, and runs the action."""

    caption: Name
    interval_ms: Annotated[Number, Meta(description="time to reach the pose, ms")]
    blocks: tuple[ServoBlock, ...] = ()


class RunActionBlock(_Block, frozen=True, tag="run_action"):
    """Command to run a stored action, or the action of a pose block."""

    target: Target
    ratio_percent: Number = 100


class RunMacroBlock(_Block, frozen=True, tag="run_macro"):
    """Command to run a stored macro, or the macro of a macro block."""

    target: Target
    ratio_percent: Number = 100


class WaitBlock(_Block, frozen=True, tag="wait"):
    """Pause between two commands of a macro."""

    delay_ms: Annotated[Number, Meta(description="how long to wait, ms")]


class RepeatBlock(_Block, frozen=True, tag="repeat"):
    """Repetition of the commands inside the block."""

    loop: Annotated[Number, Meta(description="number of repetitions")]
    blocks: tuple[CommandBlock, ...] = ()


class ForeverBlock(_Block, frozen=True, tag="forever"):
    """Endless repetition, impossible for a board."""

    blocks: tuple[CommandBlock, ...] = ()


class IfBlock(_Block, frozen=True, tag="if"):
    """Condition on the angle of a servo, impossible for a board."""

    servo_id: Number
    degree: Number
    blocks: tuple[CommandBlock, ...] = ()


class MacroBlock(_Block, frozen=True, tag="macro"):
    """Macro with a name and the commands inside."""

    caption: Name
    blocks: tuple[CommandBlock, ...] = ()


class ButtonBlock(_Block, frozen=True, tag="button"):
    """Commands to run when a button is pressed, pressed long, or released."""

    button_id: Number
    event: Literal["press", "long_press", "up"]
    blocks: tuple[CommandBlock, ...] = ()


CommandBlock: TypeAlias = PoseBlock | RunActionBlock | RunMacroBlock | WaitBlock | RepeatBlock | ForeverBlock | IfBlock
AnyBlock: TypeAlias = CommandBlock | ServoBlock | MacroBlock | ButtonBlock


class Stack(Struct, frozen=True, forbid_unknown_fields=True):
    """Connected blocks with their position on the screen."""

    x: Place
    y: Place
    blocks: tuple[AnyBlock, ...]


class Made(Struct, frozen=True, forbid_unknown_fields=True):
    """Record made of blocks, replaced when the blocks have changed."""

    kind: Annotated[Literal["actions", "macros", "buttons"], Meta(description="buttons: the macro of a button block")]
    id: Annotated[Number, Meta(description="id of the action or macro")]
    caption: Name


class Blocks(Struct, frozen=True, forbid_unknown_fields=True):
    """Programs made of blocks, and the records made of them so far."""

    version: Version = msgspec.field(name="blocks")
    stacks: Annotated[tuple[Stack, ...], Meta(max_length=MOST_BLOCKS)] = ()
    made: Annotated[tuple[Made, ...], Meta(max_length=4 * MOST_BLOCKS)] = ()

    def checked(self) -> Blocks:
        """Return these blocks. Raise EncodeError for too many, too deep or duplicate ones, and impossible stacks."""
        ids: set[str] = set()
        waiting: list[tuple[str, int, AnyBlock]] = []
        for at, stack in enumerate(self.stacks):
            if not stack.blocks:
                raise EncodeError("has no blocks", f"stacks[{at}].blocks")
            places = [(f"stacks[{at}].blocks[{number}]", 1, block) for number, block in enumerate(stack.blocks)]
            for path, _, block in places[1:]:
                if _family(block) != _family(stack.blocks[0]) or isinstance(block, MacroBlock | ButtonBlock):
                    raise EncodeError(f"cannot follow the block {quote(stack.blocks[0].id)}", path)
            waiting += places
        while waiting:
            path, level, block = waiting.pop()
            if block.id in ids:
                raise EncodeError(f"{quote(block.id)} is also the id of another block", f"{path}.id")
            if level > MOST_LEVELS:
                raise EncodeError(f"is more than {MOST_LEVELS} blocks deep", path)
            ids.add(block.id)
            inner: tuple[AnyBlock, ...] = getattr(block, "blocks", ())
            waiting += [(f"{path}.blocks[{number}]", level + 1, one) for number, one in enumerate(inner)]
            if len(ids) + len(waiting) > MOST_BLOCKS:
                raise EncodeError(f"has more than {MOST_BLOCKS} blocks", "stacks")
        return self

    def to_json(self) -> dict[str, Any]:
        """Return the object for these blocks, ready for `json.dumps`."""
        form: dict[str, Any] = msgspec.to_builtins(self)
        return form


def _family(block: AnyBlock) -> type[Struct]:
    """Return the same type for all blocks of a family: only members of a family can be connected in a row."""
    return type(block) if isinstance(block, ServoBlock | MacroBlock | ButtonBlock) else _Block
