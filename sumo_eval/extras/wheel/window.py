"""The server that the browser talks to: on loopback only, one page, one WebSocket, one person.

Nothing is read from disk for the browser. Who may talk: whoever has the token, which travels in the
fragment of the address and so stands in no log; from a page of this very server (exact `Host` and
`Origin`). Every message is bounded (`messages`), and so is their rate. A window that is closed,
hidden or asleep holds the drive; who comes back with the token goes on where the drive stood.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
import time as clock
from contextlib import suppress
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Final

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

LOOPBACK: Final = "127.0.0.1"
# s within which who connects must say what he wants (browsers also connect ahead), and his token
SILENT: Final = 2.0
COUNTDOWN: Final = 3.0  # s
# codes that close a window
WRONG, UNKNOWN = 4400, 4401
TAKEN, FLOODED = 4409, 4429
BROKEN: Final = {
    1002: "is no message of a WebSocket",
    1007: "is no text",
    1009: f"is larger than {LARGEST} bytes",
}
"""Why websockets itself shuts a window: its code, and what came."""
MOST_ANSWERS: Final = 8  # that wait; the page gives one to a view
MOST_TOLD: Final = 10_000  # of one drive; the page tells once a second


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
        self._server: Server | None = None
        self._peer: ServerConnection | None = None
        self._view: dict[str, Any] | None = None
        self._answers: asyncio.Queue[dict[str, Any]] = asyncio.Queue(MOST_ANSWERS)
        self._desk: Desk | None = None
        # the newest state; one that was not sent in time is of no use to anybody
        self._box: list[Any] | None = None
        self._latest: list[Any] | None = None
        # the seat holds the drive for this reason, which the page has not been told yet
        self._why = ""
        self._posted = asyncio.Event()
        self._telling: list[dict[str, Any]] = []
        self.faults: list[str] = []  # messages that no page of ours sends, as sentences

    @property
    def address(self) -> str:
        """Where the browser goes."""
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
        if self._desk is not None:
            self._desk.leaves = self._desk.leaves or "The program was stopped."

    async def __aexit__(self, *_: object) -> None:
        self.stop()
        assert self._server is not None
        self._server.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), 5.0)

    def _hosts(self) -> tuple[str, str]:
        return f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"

    # -- what is asked over HTTP -------------------------------------------------------------------

    def _answer(self, peer: ServerConnection, request: Request) -> Response | None:
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        def say(
            status: HTTPStatus, body: str, kind: str = "text/plain; charset=utf-8", policy: str = ""
        ) -> Response:
            content = body.encode()
            headers = Headers()
            for name, value in {
                "Content-Type": kind, "Content-Length": str(len(content)), "Connection": "close",
                "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer",
                "Cross-Origin-Opener-Policy": "same-origin",
                "Cross-Origin-Resource-Policy": "same-origin",
                "Content-Security-Policy": policy or "default-src 'none'; frame-ancestors 'none'",
            }.items():  # fmt: skip
                headers[name] = value
            return Response(status.value, status.phrase, headers, content)

        host = request.headers.get_all("Host")
        if host not in [[own] for own in self._hosts()]:
            return say(
                HTTPStatus.MISDIRECTED_REQUEST, "This server answers to its own address only.\n"
            )
        # earlier versions of websockets refuse the others themselves
        if getattr(request, "method", "GET") != "GET":
            return say(HTTPStatus.METHOD_NOT_ALLOWED, "This server is asked by GET.\n")
        if request.path == "/wheel":
            if request.headers.get_all("Origin") == [f"http://{host[0]}"]:
                return None  # the WebSocket
            return say(HTTPStatus.FORBIDDEN, "This server talks to its own page only.\n")
        if request.path != "/":
            return say(HTTPStatus.NOT_FOUND, "There is one page here, /.\n")
        nonce = secrets.token_urlsafe(16)
        sockets = " ".join(f"ws://{host}" for host in self._hosts())
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src "
            "data:; "
            f"connect-src {sockets}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return say(
            HTTPStatus.OK, self._page.replace("{nonce}", nonce), "text/html; charset=utf-8", policy
        )

    # -- what is said over the WebSocket -----------------------------------------------------------

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
                self._fault(f"What came from the window {BROKEN[closed.sent.code]}.")

    async def _known(self, peer: ServerConnection) -> bool:
        """Whether a window shows the token; who does not is shut out."""
        try:
            said_ = read(await asyncio.wait_for(peer.recv(), SILENT))
        except (TimeoutError, MessageError):
            await peer.close(WRONG, "The first message must be the token.")
            return False
        token = said_.get("token")
        if token is None or not hmac.compare_digest(
            token.encode(errors="replace"), self.token.encode()
        ):
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
        if self._desk is not None:
            self._desk.leaves = self._desk.leaves or sentence

    def _take(self, message: dict[str, Any]) -> None:
        desk = self._desk
        if "input" in message:
            if desk is not None:
                desk.newest = message["input"]
        elif "answers" in message:
            if self._answers.full():
                raise MessageError(
                    f"More than {MOST_ANSWERS} answers came that nobody had asked for."
                )
            self._answers.put_nowait(message["answers"])
        elif "telling" in message:
            if len(self._telling) >= MOST_TOLD:
                raise MessageError(
                    f"A window may tell of itself at most {MOST_TOLD} times in a drive."
                )
            self._telling.append(message["telling"])
        elif desk is not None:
            if "ready" in message:
                desk.due = clock.perf_counter() + self._countdown
                desk.holds = ""
            elif "pause" in message:
                self._hold(message["pause"])
            elif "quit" in message:
                desk.leaves = desk.leaves or OWN_WISH

    def _hold(self, why: str) -> None:
        desk = self._desk
        if desk is not None:
            desk.held = desk.holds = desk.holds or why
            # nobody's foot is on a pedal
            desk.newest = desk.newest._replace(given=type(desk.newest.given)())

    async def _post(self, peer: ServerConnection) -> None:
        """Send the newest state whenever there is one, and why the seat holds the drive where it
        does.
        """
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await self._posted.wait()
                self._posted.clear()
                (state, self._box), (why, self._why) = (self._box, None), (self._why, "")
                if state is not None:
                    await peer.send(json.dumps({"state": state}, separators=(",", ":")))
                if why:
                    await peer.send(json.dumps({"held": why}))

    async def _reload(self) -> None:
        """Show whatever was to be seen last."""
        from websockets.exceptions import ConnectionClosed

        if self._peer is not None and self._view is not None:
            with suppress(ConnectionClosed):
                await self._peer.send(json.dumps(self._view, allow_nan=False))
                if self._desk is not None and self._latest is not None:
                    await self._peer.send(json.dumps({"state": self._latest}))

    # -- what the server's own work asks of it -----------------------------------------------------

    async def show(self, view: dict[str, Any]) -> None:
        """Show a view: {"show": kind, ...}; a window that comes back sees it again."""
        self._view = view
        await self._reload()

    async def ask(self, view: dict[str, Any]) -> dict[str, Any]:
        """Show a view and wait for its answers."""
        while not self._answers.empty():
            self._answers.get_nowait()  # of a view that is no more
        await self.show(view)
        return await self._answers.get()

    async def drive(
        self,
        concrete: ConcreteScenario,
        settings: SimulationSettings,
        writer: Writer,
        view: dict[str, Any],
    ) -> tuple[Recording, dict[str, Any]]:
        """Let the person drive; the recording, and what was measured of the drive in time
        (`timing`).
        """
        await self.show({"show": "wait"})
        await asyncio.to_thread(warm_up, concrete, settings)
        loop = asyncio.get_running_loop()
        desk = self._desk = Desk()
        self._telling, self._latest, self._why = [], None, ""

        def publish(state: list[Any]) -> None:
            self._box = self._latest = state
            loop.call_soon_threadsafe(self._posted.set)

        def held(why: str) -> None:
            self._why = why
            loop.call_soon_threadsafe(self._posted.set)

        await self.show({**view, "show": "drive", "countdown": self._countdown})
        try:
            drive = asyncio.ensure_future(
                asyncio.to_thread(
                    drive_person, concrete, settings, desk, writer, publish, held, paced=self._paced
                )
            )
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


def timing(late: list[float], behind: list[int], told: list[dict[str, Any]]) -> dict[str, Any]:
    """What is known of a drive in time: lateness of steps (ms), input to picture (ms), frames,
    dropped ones, how often the page drew more cheaply by itself.
    """
    latency = [value for it in told for value in it["latency"]]
    frames, dropped = sum(it["frames"] for it in told), sum(it["dropped"] for it in told)
    return {
        "steps": len(late),
        "late_p50_ms": _ms(_part(late, 0.5)), "late_p95_ms": _ms(_part(late, 0.95)),
        "late_max_ms": _ms(max(late, default=None)),
        "input_to_picture_p50_ms": _part(latency, 0.5),
        "input_to_picture_p95_ms": _part(latency, 0.95),
        "inputs_timed": len(latency), "frames": frames, "dropped": dropped,
        "stepped_down": sum(it["stepped"] for it in told) if told else None,
        "behind_p95_steps": _part([*map(float, behind)], 0.95),
        "resolution": told[-1]["resolution"] if told else None,
        "renderer": ", then ".join(dict.fromkeys(it["renderer"] for it in told)) or None,
    }  # fmt: skip


def _part(values: list[float], share: float) -> float | None:
    return round(float(np.quantile(values, share)), 4) if values else None


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 3)


def _listen(port: int) -> socket.socket:
    """A socket on loopback; port 0: any that is free."""
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((LOOPBACK, port))
        made.listen(16)
    except (OSError, OverflowError) as error:
        made.close()
        raise InputError(f"Port {port} of {LOOPBACK} cannot be used: {said(error)}.") from error
    made.setblocking(False)
    return made
