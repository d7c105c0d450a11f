"""The server that the browser talks to: on loopback only, one page, one WebSocket, one person.

The browser receives nothing from disk. A peer needs the token, which travels in the fragment of the
address and so stands in no log, and a page of this very server (exact `Host` and `Origin`). Every
message is bounded (`messages`), and so is their rate. A window that is closed, hidden or asleep
holds the drive; one that returns with the token continues where the drive stood.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
import time as clock
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

import numpy as np

from sumo_eval.errors import InputError, needs_extra, said
from sumo_eval.extras.wheel.messages import LARGEST, MOST_A_SECOND, MessageError, read
from sumo_eval.extras.wheel.seat import Desk, drive_person, warm_up
from sumo_eval.extras.wheel.tape import OWN_WISH, Writer
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

LOOPBACK = "127.0.0.1"
# s within which a peer must state its wish (browsers also connect ahead), and send its token
SILENT = 2.0
COUNTDOWN = 3.0  # s
# codes that close a window
WRONG, UNKNOWN = 4400, 4401
TAKEN, FLOODED = 4409, 4429
BROKEN = {
    1002: "is not a message of a WebSocket",
    1007: "is not text",
    1009: f"is larger than {LARGEST} bytes",
}
"""Why websockets itself shuts a window: its code, and the message that came."""
MOST_ANSWERS = 8  # that wait; the page gives one to a view
MOST_TELLINGS = 10_000  # of one drive; the page sends one a second


class Window:
    """One person's browser.

    page: its HTML, with `{nonce}` where that of the policy belongs.
    countdown: s from `ready` to the first step.
    paced: False lets each step wait for an answer to its state.
    """

    def __init__(
        self, page: str, *, port: int = 0, countdown: float = COUNTDOWN, paced: bool = True
    ) -> None:
        self._page, self._countdown, self._paced = page, countdown, paced
        self.token = secrets.token_urlsafe(24)
        self._listening = _listen(port)
        self.port: int = self._listening.getsockname()[1]
        self._hosts = f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"
        self._server: Server | None = None
        self._peer: ServerConnection | None = None
        self._view: dict[str, Any] | None = None
        self._answers: asyncio.Queue[dict[str, Any]] = asyncio.Queue(MOST_ANSWERS)
        self._desk: Desk | None = None
        self._latest: list[Any] | None = None  # state of the drive
        # messages by key that were not sent yet; a newer state replaces one that came too late
        self._box: dict[str, Any] = {}
        self._posted = asyncio.Event()
        self._telling: list[dict[str, Any]] = []
        self.faults: list[str] = []  # messages that our page does not send, as sentences

    @property
    def address(self) -> str:
        """Address for the browser."""
        return f"http://{LOOPBACK}:{self.port}/#{self.token}"

    async def __aenter__(self) -> Window:
        try:
            from websockets.asyncio.server import serve
        except ImportError:
            self._listening.close()
            raise needs_extra("Driving in the browser", "drive") from None
        self._server = await serve(
            self._talk, sock=self._listening, process_request=self._answer,
            max_size=LARGEST, max_queue=64, compression=None, ping_interval=5.0, ping_timeout=15.0,
            open_timeout=SILENT, close_timeout=2.0, server_header=None,
        )  # fmt: skip
        return self

    def stop(self) -> None:
        """End the drive that is under way, if there is one: its tape is closed like that of any
        other.
        """
        self._leave("The program was stopped.")

    async def __aexit__(self, *_: object) -> None:
        self.stop()
        assert self._server is not None
        self._server.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), 5.0)

    # -- requests over HTTP ------------------------------------------------------------------------

    def _answer(self, peer: ServerConnection, request: Request) -> Response | None:
        """None: the WebSocket."""
        host = request.headers.get_all("Host")
        if host not in [[own] for own in self._hosts]:
            return _response(
                HTTPStatus.MISDIRECTED_REQUEST, "This server answers to its own address only.\n"
            )
        # earlier versions of websockets refuse other methods themselves
        if getattr(request, "method", "GET") != "GET":
            return _response(HTTPStatus.METHOD_NOT_ALLOWED, "This server answers GET only.\n")
        if request.path == "/wheel":
            if request.headers.get_all("Origin") == [f"http://{host[0]}"]:
                return None
            return _response(HTTPStatus.FORBIDDEN, "This server talks to its own page only.\n")
        if request.path != "/":
            return _response(HTTPStatus.NOT_FOUND, "There is one page here, /.\n")
        nonce = secrets.token_urlsafe(16)
        sockets = " ".join(f"ws://{host}" for host in self._hosts)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
            f"img-src data:; connect-src {sockets}; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        return _response(HTTPStatus.OK, self._page.replace("{nonce}", nonce), "html", policy)

    # -- messages over the WebSocket ---------------------------------------------------------------

    async def _talk(self, peer: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            if not await self._known(peer):
                return
            if self._peer is not None:
                await peer.close(TAKEN, "Another window drives. Close it first.")
                return
            self._peer = peer
            post = asyncio.create_task(self._post(peer))
            try:
                await self._reload()
                await self._listen(peer)
            finally:
                self._peer = None
                post.cancel()
                self._hold("closed")
        except ConnectionClosed as closed:
            if closed.sent is not None and closed.sent.code in BROKEN:
                self._fault(f"A message of the window {BROKEN[closed.sent.code]}.")

    async def _known(self, peer: ServerConnection) -> bool:
        """Whether a window shows the token; others are closed."""
        try:
            message = read(await asyncio.wait_for(peer.recv(), SILENT))
        except (TimeoutError, MessageError):
            await peer.close(WRONG, "The first message must be the token.")
            return False
        token = message.get("token", "").encode(errors="replace")
        if not hmac.compare_digest(token, self.token.encode()):
            await peer.close(UNKNOWN, "Unknown token: open the address that the terminal shows.")
            return False
        return True

    async def _listen(self, peer: ServerConnection) -> None:
        allowance, before = float(MOST_A_SECOND), clock.monotonic()
        async for text in peer:
            now = clock.monotonic()
            allowance = min(allowance + (now - before) * MOST_A_SECOND, MOST_A_SECOND) - 1.0
            before = now
            try:
                if allowance < 0.0:
                    raise MessageError(
                        f"More than {MOST_A_SECOND} messages a second came from the window."
                    )
                self._take(read(text))
            except MessageError as error:
                self._fault(str(error))
                # a close frame has room for 123 bytes
                reason = str(error).encode()[:120].decode(errors="ignore")
                await peer.close(FLOODED if allowance < 0.0 else WRONG, reason)
                return

    def _fault(self, sentence: str) -> None:
        """The message is from a foreign page: it ends the drive."""
        self.faults.append(sentence)
        self._leave(sentence)

    def _leave(self, why: str) -> None:
        if self._desk is not None:
            self._desk.leave(why)

    def _hold(self, why: str) -> None:
        if self._desk is not None:
            self._desk.hold(why)
            self._desk.held = self._desk.holds

    def _take(self, message: dict[str, Any]) -> None:
        ((kind, value),) = message.items()
        desk = self._desk
        if kind == "answers":
            if self._answers.full():
                raise MessageError(f"More than {MOST_ANSWERS} answers came without a question.")
            self._answers.put_nowait(value)
        elif kind == "telling":
            if len(self._telling) >= MOST_TELLINGS:
                raise MessageError(
                    f"A window may send its figures at most {MOST_TELLINGS} times in a drive."
                )
            self._telling.append(value)
        elif kind == "pause":
            self._hold(value)
        elif kind == "quit":
            self._leave(OWN_WISH)
        elif desk is not None and kind == "input":
            desk.newest = value
        elif desk is not None and kind == "ready":
            desk.due = clock.perf_counter() + self._countdown
            desk.holds = ""

    async def _post(self, peer: ServerConnection) -> None:
        """Send the newest messages whenever there are any."""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await self._posted.wait()
                self._posted.clear()
                box, self._box = self._box, {}
                for key in sorted(box, reverse=True):  # a state, then why the seat holds the drive
                    await peer.send(json.dumps({key: box[key]}, separators=(",", ":")))

    async def _reload(self) -> None:
        """Show again what the browser had last."""
        from websockets.exceptions import ConnectionClosed

        if self._peer is not None and self._view is not None:
            with suppress(ConnectionClosed):
                await self._peer.send(json.dumps(self._view, allow_nan=False))
                if self._desk is not None and self._latest is not None:
                    await self._peer.send(json.dumps({"state": self._latest}))

    # -- requests of the server's own work ---------------------------------------------------------

    async def show(self, view: dict[str, Any]) -> None:
        """Show a view: {"show": kind, ...}; a window that returns sees it again."""
        self._view = view
        await self._reload()

    async def ask(self, view: dict[str, Any]) -> dict[str, Any]:
        """Show a view and wait for its answers."""
        while not self._answers.empty():
            self._answers.get_nowait()  # of an earlier view
        await self.show(view)
        return await self._answers.get()

    async def drive(
        self,
        concrete: ConcreteScenario,
        settings: SimulationSettings,
        writer: Writer,
        view: dict[str, Any],
    ) -> tuple[Recording, dict[str, Any]]:
        """Let the person drive; the recording, and the drive's figures in time (`timing`)."""
        await self.show({"show": "wait"})
        await asyncio.to_thread(warm_up, concrete, settings)
        loop = asyncio.get_running_loop()
        desk = self._desk = Desk()
        self._telling, self._latest, self._box = [], None, {}

        def post(key: str, value: Any) -> None:
            self._box[key] = value
            loop.call_soon_threadsafe(self._posted.set)

        def publish(state: list[Any]) -> None:
            self._latest = state
            post("state", state)

        await self.show({**view, "show": "drive", "countdown": self._countdown})
        drive = asyncio.ensure_future(
            asyncio.to_thread(
                drive_person, concrete, settings, desk, writer, publish,
                partial(post, "held"), paced=self._paced,
            )
        )  # fmt: skip
        try:
            recording, seat = await asyncio.shield(drive)
        # by Ctrl-C: the loop runs in a thread of its own, and ends first
        except asyncio.CancelledError:
            self.stop()
            await drive
            raise
        finally:
            self._desk = None
        return recording, timing(seat.late, seat.behind, self._telling) | {"left": seat.left}


def _response(status: HTTPStatus, text: str, kind: str = "plain", policy: str = "") -> Response:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    content = text.encode()
    headers = Headers()
    for name, value in {
        "Content-Type": f"text/{kind}; charset=utf-8", "Content-Length": str(len(content)),
        "Connection": "close", "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer", "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Content-Security-Policy": policy or "default-src 'none'; frame-ancestors 'none'",
    }.items():  # fmt: skip
        headers[name] = value
    return Response(status.value, status.phrase, headers, content)


def timing(late: list[float], behind: list[int], tellings: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a drive in time: lateness of steps (ms), input to picture (ms), frames, dropped
    ones, how often the page drew more cheaply by itself.
    """
    latency = [value for it in tellings for value in it["latency"]]
    late_ms = [round(1000.0 * value, 3) for value in late]
    last = tellings[-1] if tellings else None
    return {
        "steps": len(late),
        "late_p50_ms": _part(late_ms, 0.5), "late_p95_ms": _part(late_ms, 0.95),
        "late_max_ms": max(late_ms, default=None),
        "input_to_picture_p50_ms": _part(latency, 0.5),
        "input_to_picture_p95_ms": _part(latency, 0.95),
        "inputs_timed": len(latency),
        "frames": sum(it["frames"] for it in tellings),
        "dropped": sum(it["dropped"] for it in tellings),
        "stepped_down": last and sum(it["stepped"] for it in tellings),
        "behind_p95_steps": _part(behind, 0.95),
        "resolution": last and last["resolution"],
        "renderer": ", then ".join(dict.fromkeys(it["renderer"] for it in tellings)) or None,
    }  # fmt: skip


def _part(values: Sequence[float], share: float) -> float | None:
    return round(float(np.quantile(values, share)), 4) if values else None


def _listen(port: int) -> socket.socket:
    """A socket on loopback; port 0: any that is free."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
        listening.listen(16)
    except (OSError, OverflowError) as error:
        listening.close()
        raise InputError(f"Port {port} of {LOOPBACK} cannot be used: {said(error)}.") from error
    listening.setblocking(False)
    return listening
