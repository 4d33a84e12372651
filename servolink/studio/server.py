"""Server of the studio: files of the page, and a WebSocket for each open page."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from ipaddress import ip_address
from pathlib import Path
from socket import socket
from typing import Any

from aiohttp import web

from servolink.errors import OpenError
from servolink.studio.docs_pages import docs_page, page_names
from servolink.studio.draft_methods import follow_drafts
from servolink.studio.drafts import file_name
from servolink.studio.gate import Gate
from servolink.studio.static_files import PageFile, page_files
from servolink.studio.studio_methods import Studio
from servolink.studio.web_socket import serve_web_socket
from servolink.support import computed, read_file, user_folder, write_atomically
from servolink.transports import HttpServing, NetworkPlace

HEADERS = {
    # Forbids other origins, inline code and frames.
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
        "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cache-Control": "no-cache",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of each response."""
_WRONG_HOST = 421
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@asynccontextmanager
async def serve_studio(
    studio: Studio, host: str, port: int, allowed_hosts: Iterable[str] = ()
) -> AsyncIterator[tuple[Gate, int]]:
    """Serve `studio` at `host` and `port`; yield the gate and the port in use.

    With port 0 it is the one that the last studio of this board had, or any free one. Pages reach it under the names of
    this machine and as `allowed_hosts`. Raise OpenError if the place cannot be had.
    """
    listening = await _listening(studio, host, port)
    used: int = listening[0].getsockname()[1]
    gate = Gate(used, allowed_hosts, _own_host([each.getsockname()[0] for each in listening]))
    runner = web.AppRunner(application(studio, gate), handle_signals=False, shutdown_timeout=1.0)
    try:
        await runner.setup()
        assert runner.server is not None  # noqa: S101 - narrows the type
        serving = HttpServing(runner.server, HEADERS)
        async with serving.accepting(listening), _beside(follow_drafts(studio)):
            try:
                yield gate, used
            finally:
                await runner.cleanup()
    finally:
        for each in listening:
            each.close()


@asynccontextmanager
async def _beside(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    task = asyncio.ensure_future(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait((task,))


async def _listening(studio: Studio, host: str, port: int) -> list[socket]:
    for last in last_ports(studio.hub) if port == 0 else []:
        with suppress(OpenError):
            return await NetworkPlace(host, last).listen()
    listening = await NetworkPlace(host, port).listen()
    if port == 0:
        keep_port(studio.hub, listening[0].getsockname()[1])
    return listening


def _own_host(places: Sequence[str]) -> str:
    """Return the host by which this machine reaches a server that listens at the addresses."""
    found = [ip_address(place) for place in places]
    for own in ("127.0.0.1", "::1"):
        loopback = ip_address(own)
        if any(each == loopback or (each.is_unspecified and each.version == loopback.version) for each in found):
            return f"[{own}]" if ":" in own else own
    return f"[{places[0]}]" if ":" in places[0] else places[0]


def application(studio: Studio, gate: Gate) -> web.Application:
    """Return the application with the page and the WebSocket."""
    app = web.Application(middlewares=[_checked(gate)])
    files = page_files()

    async def talk(request: web.Request) -> web.StreamResponse:
        if not gate.is_our_page(request.headers.get("Origin")):
            raise web.HTTPForbidden(text="this is not a page of the studio\n")
        return await serve_web_socket(studio, gate, request, HttpServing.connection_of(request).stranger)

    async def show(request: web.Request) -> web.StreamResponse:
        if (name := request.match_info["name"]) not in page_names():
            raise web.HTTPNotFound(text="servolink has no such page\n")
        page = await computed(docs_page)(name)
        return web.Response(body=page, headers={"Content-Type": "text/html; charset=utf-8"})

    app.router.add_get("/ws", talk)
    app.router.add_get("/docs/{name:.+}", show)
    for path, file in files.items():
        app.router.add_get(path, _sending(file))
    return app


def _sending(file: PageFile) -> _Handler:
    async def send(request: web.Request) -> web.StreamResponse:
        tag = f'"{file.tag}"'
        if request.headers.get("If-None-Match") == tag:
            return web.Response(status=304, headers={"ETag": tag})
        return web.Response(body=file.content, headers={"Content-Type": file.content_type, "ETag": tag})

    return send


def _checked(gate: Gate) -> Callable[..., Awaitable[web.StreamResponse]]:
    @web.middleware
    async def check(request: web.Request, handler: _Handler) -> web.StreamResponse:
        await HttpServing.connection_of(request).heard()
        if not gate.is_ours(request.headers.get("Host")):
            return web.Response(status=_WRONG_HOST, text=gate.refusal(request.host), headers=HEADERS)
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    return check


# --- the port, which stays the same: what a browser keeps for a page belongs to the address of the page --------------

_MOST_PORTS, _MOST_PORT_BYTES = 4, 32


def last_ports(board: str) -> list[int]:
    """Return the ports of earlier studios of a board, the latest first; empty for unknown ports.

    There are several if one studio was started beside another.
    """
    with suppress(OSError, ValueError):
        ports = [int(port) for port in read_file(_port_file(board), _MOST_PORT_BYTES).split()]
        if all(0 < port < 1 << 16 for port in ports):
            return ports
    return []


def keep_port(board: str, port: int) -> None:
    """Store the port for the next studio. No effect if writing fails."""
    with suppress(OSError):
        path = _port_file(board)
        ports = [port, *(one for one in last_ports(board) if one != port)][:_MOST_PORTS]
        write_atomically(path, f"{' '.join(map(str, ports))}\n".encode(), private=True)


def _port_file(board: str) -> Path:
    return user_folder("data") / "studio" / f"{file_name(board)}.port"
