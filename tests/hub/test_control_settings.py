"""Settings of the board through the control interface: facts, transmission mode, test data and raw angles.

Module: servolink.hub.methods.methods.
"""

from __future__ import annotations

import pytest

from servolink.virtual import BoardKind
from tests.hub.control_program import RpcFailed, shared


async def test_facts_are_read_from_the_board() -> None:
    async with shared() as here, here.program("tablet", "watch") as tablet:
        await here.hub.board.write_project_id(77)
        facts = await tablet.call("board.facts")
        assert (facts["servo_ids"], facts["project_id"], facts["is_unfinished"]) == ([1, 2, 3], 77, False)
        assert 0 < facts["memory_free"] <= facts["memory_total"]


async def test_facts_without_an_answer_are_null() -> None:
    kind = BoardKind(unsupported=("QueryProjectID", "QueryMemorySize"))
    async with shared(kind=kind) as here, here.program("tablet", "watch") as tablet:
        facts = await tablet.call("board.facts")
        assert (facts["project_id"], facts["memory_free"], facts["memory_total"]) == (None, None, None)
        assert facts["servo_ids"] == [1, 2, 3]


@pytest.mark.virtual_only("the firmware has no old transmission mode")
async def test_the_old_mode_stops_all_servos_first_and_needs_the_lease() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
        await tablet.call("move", targets={"1": 60}, duration=5)
        with pytest.raises(RpcFailed, match="nothing was moved") as failed:
            await studio.call("board.mode", mode=0)
        assert failed.value.kind == "MotionRefused"
        assert (await studio.call("board.mode", mode=1)) == {"mode": 1}
        await tablet.call("lease.give")
        await studio.call("board.mode", mode=0)
        assert not any(servo.is_start for servo in here.virtual.servos.values())


async def test_test_data_is_followed_by_a_query_that_is_answered() -> None:
    async with shared() as here, here.program("studio") as studio:
        sent = here.hub.board.stats.bytes_sent
        tested = await studio.call("line.test", size=500)
        assert 0 <= tested["seconds"] < 1
        assert (tested["repeats"], tested["noise"]) == (0, 0)
        assert here.hub.board.stats.bytes_sent >= sent + 500
        with pytest.raises(RpcFailed, match="4096"):
            await studio.call("line.test", size=5000)


async def test_raw_angles_are_read_while_degrees_stay_those_of_motions() -> None:
    async with shared() as here, here.program("studio") as studio:
        await studio.call("move", targets={"1": 60}, duration=0.1, wait=True)
        raw = (await studio.call("servos.list", unit="adc"))["servos"][0]
        assert raw["angle_unit"] == "adc"
        assert raw["angle"] > 180
        await studio.call("move", targets={"1": 30}, duration=0.1, wait=True)
        assert (await studio.call("servos.list"))["servos"][0]["angle"] == 30
