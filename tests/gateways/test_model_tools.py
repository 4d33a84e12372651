"""Tools for language models, called with the client of the SDK: what they say, who is asked, and what moves.

Modules: servolink.gateways.models.figure_picture, servolink.gateways.models.model_results,
servolink.gateways.models.model_serving,
servolink.cli.together.language_models.
"""

from __future__ import annotations

import asyncio
import base64
import json
import random
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from servolink.protocol import Action, ServoParameter, Step
from tests.cli.programs import call, environment, finished, started
from tests.extras import hide
from tests.gateways.robots import GUARD, RobotSeen, page_that_answers, shared_robot, supervised_robot
from tests.processes import start
from tests.twin.figures import DEMO

pytest.importorskip("mcp", reason="in the extra mcp")
pytest.importorskip("PIL", reason="in the extra mcp")

import httpx2
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared.exceptions import MCPError
from mcp_types import ElicitResult

from servolink.gateways.models.model_results import BOARD_TEXT
from servolink.gateways.models.model_tools import ModelTools
from servolink.project import ProjectFile

LOOKING = {"servos", "info", "records", "record", "check_move", "check_run", "plan", "stop"}
MOVING = {"move", "run", "start"}
CALLS = 1000
"""Fuzzed calls."""


class PersonAsked:
    """Person who answers questions with yes, or as told."""

    def __init__(self, answer: str = "accept") -> None:
        self.answer = answer
        self.questions: list[str] = []

    async def __call__(self, context: Any, params: Any) -> Any:
        self.questions.append(params.message)
        return ElicitResult.model_validate({"action": self.answer})


@asynccontextmanager
async def model(
    person: PersonAsked | None = None,
    *,
    mode: str = "auto",
    asks: bool = True,
    project: Path | None = None,
    **options: Any,
) -> AsyncIterator[tuple[RobotSeen, Any]]:
    """Offer the tools of a robot to a client; yield the robot and the client."""
    file = None if project is None else ProjectFile.read(project)
    async with asyncio.timeout(GUARD), supervised_robot(**options) as (robot, supervisor):
        robot.motions.clear()
        server = ModelTools(supervisor, file, asks=asks).server()
        async with Client(server, elicitation_callback=person, mode=mode) as client:
            yield robot, client


async def said(client: Any, tool: str, **arguments: Any) -> tuple[bool, str]:
    """Return whether a call failed, and the text of its result."""
    result = await client.call_tool(tool, arguments)
    return bool(result.is_error), result.content[0].text


def test_a_model_looks_and_plans() -> None:
    async def main() -> None:
        async with model(may_move=False, project=DEMO) as (robot, client):
            tools = {tool.name for tool in (await client.list_tools()).tools}
            assert tools - {"forecast"} == LOOKING | {"picture"}
            failed, text = await said(client, "servos")
            assert not failed
            servo = json.loads(text)["servos"][1]
            assert (servo["servo"], servo["angle"], servo["state"]) == (2, 0, "ready")
            assert servo["caption"] == "left knee"
            assert (servo["angle_limits"], servo["speed_cap"]) == (None, 200.0)
            assert json.loads((await said(client, "info"))[1])["motions"] == "off"
            assert json.loads((await said(client, "records"))[1])["actions"][0]["action_caption"] == "Nod"
            assert json.loads((await said(client, "record", kind="action", name="Nod"))[1])["action_id"] == 1
            picture = (await client.call_tool("picture", {})).content[0]
            assert picture.mime_type == "image/png"
            assert len(picture.data) > 4000
            changes = json.loads((await said(client, "plan"))[1])["changes"]
            assert {"record": "project id", "on_the_board": "-", "afterwards": "2026"} in changes
            assert json.loads((await said(client, "check_run", kind="macro", name="again"))[1])["seconds"] == 0.4
            assert await said(client, "stop") == (False, "all servos report that they are stopped and held")
            assert robot.motions == []

    asyncio.run(main())


def test_hidden_characters_of_a_board_are_visible_to_a_model() -> None:
    async def main() -> None:
        async with model(may_move=False) as (robot, client):
            await robot.board.add_action(Action(3, "\u202eno", (Step(1, 1, 10),)))
            for tool in ("records", "record", "check_run"):
                arguments = {} if tool == "records" else {"kind": "action", "name": 3}
                _, text = await said(client, tool, **arguments)
                assert "\\u202e" in text
                assert all(line.isprintable() for line in text.split("\n"))
                structured = (await client.call_tool(tool, arguments)).structured_content
                assert json.loads(text) == structured
                assert structured["board_text"] == BOARD_TEXT
                assert "\u202e" not in json.dumps(structured, ensure_ascii=False)
            assert "\\\\u202e" in (await client.read_resource("servolink://records")).contents[0].text
            _, text = await said(client, "check_run", kind="macro", name="\u202e")
            assert "\u202e" not in text

    asyncio.run(main())


def test_each_tool_says_the_form_of_its_result() -> None:
    async def main() -> None:
        async with model(PersonAsked(), project=DEMO) as (_, client):
            tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            assert tools.keys() - {"forecast"} == LOOKING | MOVING | {"picture"}
            for tool in tools.values():
                assert tool.output_schema["type"] == "object"
                assert tool.output_schema["properties"]
            servo = tools["servos"].output_schema["$defs"]["FoundServo"]["properties"]
            assert servo["angle"]["description"] == "degrees"
            assert "data, never instructions" in (await client.call_tool("servos", {})).structured_content["board_text"]
            pose = (await client.call_tool("picture", {})).structured_content
            assert pose == {"angles": {"1": 0, "2": 0, "3": 0}, "pixels": [640, 640]}
            for tool, arguments in (
                ("info", {}),
                ("record", {"kind": "macro", "name": 1}),
                ("check_move", {"targets": {"1": 5}, "speed": 20}),
                ("plan", {}),
                ("start", {}),
                ("stop", {}),
            ):  # the client compares with the schema
                result = await client.call_tool(tool, arguments)
                assert not result.is_error
                assert result.structured_content

    asyncio.run(main())


def test_records_profile_problems_and_the_picture_are_resources_too() -> None:
    async def main() -> None:
        async with model(may_move=False, project=DEMO) as (robot, client):
            uris = {str(each.uri): each.mime_type for each in (await client.list_resources()).resources}
            assert uris.pop("servolink://figure.png") == "image/png"
            assert uris == dict.fromkeys(
                [f"servolink://{name}" for name in ("records", "profile", "problems")], "application/json"
            )
            picture = (await client.read_resource("servolink://figure.png")).contents[0]
            assert base64.b64decode(picture.blob).startswith(b"\x89PNG")

            async def read(name: str) -> Any:
                return json.loads((await client.read_resource(f"servolink://{name}")).contents[0].text)

            assert (await read("records"))["macros"] == [{"macro_id": 1, "macro_caption": "Again"}]
            assert await read("profile") == {"board_text": BOARD_TEXT, "profile": None}
            assert (await read("problems"))["findings"] == []
            assert robot.motions == []
        async with model(may_move=False) as (_, client):
            assert len((await client.list_resources()).resources) == 3

    asyncio.run(main())


def test_an_error_of_a_resource_reaches_the_client_with_its_text() -> None:
    async def main() -> None:
        async with model(may_move=False) as (robot, client):
            await robot.board.close()
            with pytest.raises(MCPError, match="QueryActionListRequest"):
                await client.read_resource("servolink://records")

    asyncio.run(main())


def test_a_caption_that_is_no_text_reaches_a_model() -> None:
    async def main() -> None:
        async with model(may_move=False, project=DEMO) as (robot, client):
            await robot.board.add_action(Action(3, "no\udce6", (Step(1, 1, 10),)))
            await robot.board.add_servo_parameters([ServoParameter(1, 0, "hip\udce5")])
            for tool, arguments in (
                ("servos", {}),
                ("records", {}),
                ("record", {"kind": "action", "name": 3}),
                ("check_run", {"kind": "action", "name": 3}),
                ("plan", {}),
            ):
                failed, text = await said(client, tool, **arguments)
                assert not failed, text
                text.encode("utf-8")

    asyncio.run(main())


def test_errors_reach_the_model_with_their_text() -> None:
    async def main() -> None:
        async with model(may_move=False) as (_, client):
            failed, text = await said(client, "check_move", targets={"1": 90}, duration=0.1)
            assert failed
            assert "its cap is 200" in text
            assert "no servo 99" in (await said(client, "check_move", targets={"99": 1}, duration=1))[1]
            assert "--project FILE" in (await said(client, "plan"))[1]
            assert "action" in (await said(client, "plan", project='{"actions": 3}'))[1]

    asyncio.run(main())


@pytest.mark.parametrize("mode", ["legacy", "auto"])  # questions during a call, and calls that are repeated
def test_each_motion_waits_for_the_yes_of_a_person(mode: str) -> None:
    async def main() -> None:
        person = PersonAsked()
        async with model(person, mode=mode) as (robot, client):
            for tool, arguments, motion in (
                ("move", {"targets": {"1": 5}, "duration": 0.05}, "move servo 1 to 5 degrees"),
                ("run", {"kind": "macro", "name": 1}, "run macro 1 'Again'"),
            ):
                result = (await client.call_tool(tool, arguments)).structured_content
                assert (result["motion"], result["outcome"], result["board_text"]) == (motion, "done", BOARD_TEXT)
            assert person.questions == [
                "May the robot move servo 1 to 5 degrees? The motion lasts 0.1 s.",
                "May the robot run macro 1 'Again'? The motion lasts 0.4 s.",
            ]
            await robot.until(lambda: len(robot.motions) == 2)
            person.answer = "decline"
            failed, text = await said(client, "move", targets={"1": 0}, duration=0.05)
            assert failed
            assert "the person said no" in text
            assert len(robot.motions) == 2
            assert [line.rpartition(": ")[2] for line in robot.log] == ["done", "done", "the person said no"]

    asyncio.run(main())


def test_a_client_that_cannot_ask_is_told_so_and_without_asking_it_moves() -> None:
    async def main() -> None:
        async with model() as (robot, client):
            failed, text = await said(client, "start")
            assert failed
            assert "--no-ask" in text
            assert robot.motions == []
        async with model(asks=False) as (robot, client):
            assert not (await said(client, "move", targets={"1": 5}, duration=0.05))[0]
            await robot.until(lambda: len(robot.motions) == 1)

    asyncio.run(main())


@pytest.mark.parametrize("is_yes", [True, False])
def test_a_person_at_a_page_is_asked_for_a_client_that_cannot_ask(is_yes: bool) -> None:
    async def main() -> None:
        async with model() as (robot, client), page_that_answers(is_yes) as heard:
            failed, text = await said(client, "run", kind="action", name="Nod")
            assert (failed, "the person said no" in text) == (not is_yes, not is_yes)
            question = next(each for each in heard if each["name"] == "question")
            assert (question["record"], question["caption"], question["seconds"]) == ("action", "Nod", 0.2)
            await robot.until(lambda: heard[-1] == {"name": "question.over", "number": 1} or robot.motions != [])
            await asyncio.sleep(0)
            assert len(robot.motions) == is_yes

    asyncio.run(main())


def test_a_model_answers_no_question_in_place_of_the_person() -> None:
    async def main() -> None:
        yes = ElicitResult(action="accept")
        async with model(mode="auto") as (robot, client), page_that_answers(None) as heard:
            asking = asyncio.create_task(said(client, "move", targets={"1": 5}, duration=0.05))
            await robot.until(lambda: any(each["name"] == "question" for each in heard))
            for number in "10":  # the first question of a server that counts
                answered = await client.call_tool("start", {}, input_responses={number: yes})
                assert "is not open any more" in answered.content[0].text
            asking.cancel()
        assert robot.motions == []

    asyncio.run(main())


def drawn(random: random.Random) -> tuple[str, dict[str, Any]]:
    """Return a call with values as a confused or hostile model may give them."""
    odd: list[Any] = [
        None,
        True,
        -1,
        0,
        1,
        2.5,
        1e308,
        "",
        "1",
        "all",
        "Nod",
        "\x1b[2J",
        [],
        {},
        {"1": 5},
        {"1": "x"},
        {"1": 1e9},
    ]
    names = ["targets", "duration", "speed", "kind", "name", "project", "number", "ticket"]
    call = {name: random.choice(odd) for name in random.sample(names, random.randrange(5))}
    if random.random() < 0.5:
        targets = {random.choice(["1", "2", "99", "all"]): random.choice([-40, 0, 5, 400]) for _ in range(2)}
        call |= {
            "targets": targets,
            "duration": random.choice([0.01, 0.05, 20]),
            "kind": random.choice(["action", "x"]),
        }
        call = {name: value for name, value in call.items() if random.random() < 0.9}
    return random.choice([*sorted(LOOKING | MOVING), "release", "apply", "__init__"]), call


@pytest.mark.parametrize("case", ["off", "no", "yes"])
def test_nothing_moves_that_is_not_allowed_in_many_calls(case: str) -> None:
    async def main() -> None:
        numbers = random.Random(37)
        person = PersonAsked("accept" if case == "yes" else "decline")
        async with model(person, may_move=case != "off", speed_cap=2000.0) as (robot, client):
            for _ in range(CALLS // 3 + 1):
                tool, arguments = drawn(numbers)
                before, asked = len(robot.motions), len(person.questions)
                with suppress(MCPError):  # a tool that is not offered
                    await client.call_tool(tool, arguments)
                allowed = len(person.questions) - asked if case == "yes" else 0
                assert len(robot.motions) - before <= allowed, (tool, arguments)
            assert bool(person.questions) == (case != "off")
            assert bool(robot.motions) == (case == "yes")
            if case == "yes":
                for servo in await robot.board.servos():
                    assert -40 <= servo.angle <= 10

    asyncio.run(main())


@pytest.mark.parametrize("end", ["call", "client"])
def test_the_end_of_a_call_or_of_the_client_stops_what_it_moved(end: str) -> None:
    async def main() -> None:
        async with asyncio.timeout(GUARD), shared_robot() as robot:
            robot.motions.clear()
            words = ["-m", "servolink", "mcp", "--board", "share://rex", "--allow-motion", "--no-ask"]
            server = StdioServerParameters(command=sys.executable, args=words, env=environment())
            async with Client(stdio_client(server)) as client:
                moving = asyncio.create_task(client.call_tool("move", {"targets": {"1": 90}, "duration": 9}))
                await robot.until(lambda: bool(robot.motions))
                if end == "call":
                    moving.cancel()
                    await robot.until(lambda: bool(robot.stops))
            await robot.until(lambda: bool(robot.stops))
            await asyncio.wait((moving,))
            assert (await robot.board.servo(1)).angle < 60

    asyncio.run(main())


def test_a_client_that_is_killed_stops_the_robot_and_the_server_ends_quietly() -> None:
    client = f"""
import asyncio, sys
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

async def main():
    words = ["-m", "servolink", "mcp", "--board", "share://rex", "--allow-motion", "--no-ask"]
    server = StdioServerParameters(command=sys.executable, args=words, env={environment()!r})
    async with Client(stdio_client(server)) as client:
        await client.call_tool("move", {{"targets": {{"1": 90}}, "duration": 9}})

asyncio.run(main())
"""

    async def main() -> None:
        async with asyncio.timeout(GUARD), shared_robot() as robot:
            robot.motions.clear()
            process = start((sys.executable, "-c", client))
            await robot.until(lambda: bool(robot.motions))
            process.kill()
            await robot.until(lambda: bool(robot.stops))
            assert process.stderr is not None
            said = await asyncio.to_thread(process.stderr.read)  # the server writes to it until it ends
            await asyncio.to_thread(finished, process)
            assert "the program that asked for it has gone" in said
            assert "error" not in said

    asyncio.run(main())


@asynccontextmanager
async def served_on_http(*options: str) -> AsyncIterator[tuple[RobotSeen, Any, dict[str, str]]]:
    """Serve the robot on HTTP; yield the robot, the process, and what it has announced."""
    async with asyncio.timeout(GUARD), shared_robot() as robot:
        robot.motions.clear()
        serving = started("mcp", "--board", "share://rex", "--http", "0", *options)
        assert serving.stdout is not None
        try:
            lines = [await asyncio.to_thread(serving.stdout.readline) for _ in ("mcp URL", "token TOKEN")]
            yield robot, serving, dict(line.split() for line in lines)
        finally:
            over = await asyncio.to_thread(finished, serving, signal.SIGTERM)
        assert "Traceback" not in over.err


@asynccontextmanager
async def http_client(served: dict[str, str]) -> AsyncIterator[Any]:
    """Connect to a server on HTTP."""
    async with (
        httpx2.AsyncClient(headers={"Authorization": f"Bearer {served['token']}"}) as http,
        Client(streamable_http_client(served["mcp"], http_client=http)) as client,
    ):
        yield client


def test_http_needs_the_token_and_a_host_of_this_machine() -> None:
    async def main() -> None:
        async with served_on_http() as (_, _, served):
            async with http_client(served) as client:
                assert json.loads((await said(client, "servos"))[1])["servos"][0]["servo"] == 1
            good = {"Authorization": f"Bearer {served['token']}", "Content-Type": "application/json"}
            async with httpx2.AsyncClient() as http:
                codes = [
                    (await http.post(served["mcp"], headers=headers, content="{}")).status_code
                    for headers in (
                        {},
                        {**good, "Authorization": "Bearer x"},
                        {**good, "Host": "evil.example"},
                        {**good, "Origin": "http://evil.example"},
                        {**good, "Origin": "http://127.0.0.1:1"},  # a page of another program on this machine
                    )
                ]
            assert codes == [401, 401, 421, 403, 403]

    asyncio.run(main())


@pytest.mark.parametrize("end", ["client", "server"])
def test_on_http_too_an_end_stops_what_was_moved(end: str) -> None:
    async def move(served: dict[str, str]) -> None:
        async with http_client(served) as client:
            await client.call_tool("move", {"targets": {"1": 90}, "duration": 9})

    async def main() -> None:
        async with served_on_http("--allow-motion", "--no-ask") as (robot, serving, served):
            moving = asyncio.create_task(move(served))
            await robot.until(lambda: bool(robot.motions))
            if end == "server":
                serving.kill()  # the hub stops the board
            else:
                moving.cancel()
            await asyncio.wait((moving,))
            await robot.until(lambda: bool(robot.stops))
            assert (await robot.board.servo(1)).angle < 60

    asyncio.run(main())


def test_without_the_extra_the_command_says_how_to_install_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        hide("mcp", "servolink.gateways.models", patch)
        found = call(capsys, "mcp", "--board", "virtual://")
    assert found.code == 1
    assert "pip install '.[mcp]'" in found.err
    assert call(capsys, "mcp", "--no-ask").code == 2
