"""The server that the browser talks to: on loopback only, one page, one WebSocket, one person.

`command` opens it; `trip` and `study` show views in it and let the person drive.

The server gives the browser one page, and no file of the disk. A peer must be this page (exact
`Host` and `Origin`), and must know the token. The token is in the fragment of the address, which no
browser sends to a server, so that no log has it. The size of a message and the rate of messages are
bounded (`messages`). A window that is closed or hidden puts the drive on hold, as `seat` does where
the machine slept or the window is silent. A window that returns with the token continues the drive.
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
from typing import Any

from sumo_eval.cosim.simulation import simulate
from sumo_eval.errors import InputError, needs_extra, said
from sumo_eval.extras.wheel.messages import LARGEST, MOST_A_SECOND, MessageError, read
from sumo_eval.extras.wheel.seat import Desk, Seat
from sumo_eval.extras.wheel.tape import OWN_WISH, Player, Writer, with_quit
from sumo_eval.report.page import Json
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

try:
    from websockets.asyncio.server import Server, ServerConnection, serve
    from websockets.datastructures import Headers
    from websockets.exceptions import ConnectionClosed
    from websockets.http11 import Request, Response
except ImportError:
    raise needs_extra("Driving in the browser", "drive") from None

LOOPBACK = "127.0.0.1"
# s in which a peer must send its request, and then its token in as many: browsers also open
# connections that they never use
SILENT = 2.0
COUNTDOWN = 3.0  # s
# Codes that close a window: a wrong message, an unknown token, another window, too many messages.
# `templates/drive.js` knows them, the keys of all messages, and the words of the views.
WRONG, UNKNOWN = 4400, 4401
TAKEN, FLOODED = 4409, 4429
BROKEN = {
    1002: "is not a message of a WebSocket",
    1007: "is not text",
    1009: f"is larger than {LARGEST} bytes",
}
"""Code with which the library websockets closes a window by itself -> what the message is."""
MOST_ANSWERS = 8  # that wait; the page sends one answer for a view
# messages with figures (`Telling`) in one drive; the page sends one a second
MOST_TELLINGS = 10_000
LAST_FIGURES = 1.0  # s for which the end of a drive waits for the page's last figures


class Window:
    """One person's browser.

    page: HTML of the page, with `{nonce}` where the nonce of its content security policy belongs.
    port: of the server; 0: any free one.
    countdown: s from `ready` to the first step.
    """

    def __init__(self, page: str, *, port: int = 0, countdown: float = COUNTDOWN) -> None:
        self._page, self._countdown = page, countdown
        self.token = secrets.token_urlsafe(24)
        try:
            self._listening = socket.create_server((LOOPBACK, port))  # port 0: any free one
        except OSError as error:
            raise InputError(f"Port {port} of {LOOPBACK} cannot be used: {said(error)}.") from error
        self.port: int = self._listening.getsockname()[1]
        names = LOOPBACK, "localhost"
        # browsers leave out port 80, the default of HTTP, in `Host` and `Origin`
        self._hosts = names if self.port == 80 else tuple(f"{it}:{self.port}" for it in names)
        self._server: Server | None = None
        self._peer: ServerConnection | None = None
        self._view: Json | None = None  # the last one that was shown
        self._answers: asyncio.Queue[Json] = asyncio.Queue(MOST_ANSWERS)
        self._desk = Desk()  # of the latest drive
        self._latest: list[Any] | None = None  # state of the drive under way
        # messages by key that were not sent yet; a newer state replaces an older one
        self._outbox: Json = {}
        self._outbox_filled = asyncio.Event()
        self._tellings: list[Json] = []
        self._finished = asyncio.Event()  # set once the page has sent the last one
        self.faults: list[str] = []  # what was wrong with messages that our page cannot have sent

    @property
    def address(self) -> str:
        """Address for the browser."""
        return f"http://{LOOPBACK}:{self.port}/#{self.token}"

    async def __aenter__(self) -> Window:
        self._server = await serve(
            self._talk, sock=self._listening, process_request=self._respond,
            max_size=LARGEST, max_queue=64, compression=None, ping_interval=5.0, ping_timeout=15.0,
            open_timeout=SILENT, close_timeout=2.0, server_header=None
        )  # fmt: skip
        return self

    def stop(self) -> None:
        """End the drive that is under way, if there is one; its tape is closed as usual."""
        self._desk.end("The program was stopped.")

    async def __aexit__(self, *_: object) -> None:
        self.stop()
        assert self._server is not None
        self._server.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), 5.0)

    # -- requests over HTTP ------------------------------------------------------------------------

    def _respond(self, peer: ServerConnection, request: Request) -> Response | None:
        """The page or a refusal; None lets a peer open the WebSocket."""
        host = request.headers.get_all("Host")
        # there must be exactly one such header, with one of the server's own addresses
        if host not in [[own] for own in self._hosts]:
            return _response(
                HTTPStatus.MISDIRECTED_REQUEST, "This server answers to its own address only.\n"
            )
        if request.method != "GET":
            return _response(HTTPStatus.METHOD_NOT_ALLOWED, "This server answers GET only.\n")
        if request.path == "/wheel":
            if request.headers.get_all("Origin") == [f"http://{host[0]}"]:
                return None
            return _response(HTTPStatus.FORBIDDEN, "This server talks to its own page only.\n")
        if request.path != "/":
            return _response(HTTPStatus.NOT_FOUND, "There is one page here, /.\n")
        nonce = secrets.token_urlsafe(16)
        sockets = " ".join(f"ws://{own}" for own in self._hosts)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
            f"img-src data:; connect-src {sockets}; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        return _response(HTTPStatus.OK, self._page.replace("{nonce}", nonce), "html", policy)

    # -- messages over the WebSocket ---------------------------------------------------------------

    async def _talk(self, peer: ServerConnection) -> None:
        """Handle all messages of a peer, until it closes."""
        try:
            if not await self._admits(peer):
                return
            if self._peer is not None:
                await peer.close(TAKEN, "Another window drives. Close it first.")
                return
            self._peer = peer
            sending = asyncio.create_task(self._send_outbox(peer))
            try:
                await self._send_view()
                await self._listen(peer)
            finally:
                self._peer = None
                sending.cancel()
                self._desk.hold("closed")
        except ConnectionClosed as closed:
            if closed.sent is not None and closed.sent.code in BROKEN:
                self._fault(f"A message of the window {BROKEN[closed.sent.code]}.")

    async def _admits(self, peer: ServerConnection) -> bool:
        """Whether a peer sends the token; any other peer is closed, and no drive ends by it."""
        try:
            message = read(await asyncio.wait_for(peer.recv(), SILENT))
        # ConnectionClosed: the peer left, or the library closed it for a code in `BROKEN`
        except (TimeoutError, MessageError, ConnectionClosed):
            await peer.close(WRONG, "The first message must be the token.")
            return False
        if not hmac.compare_digest(
            message.get("token", "").encode(errors="replace"), self.token.encode()
        ):
            await peer.close(UNKNOWN, "Unknown token: open the address that the terminal shows.")
            return False
        return True

    async def _listen(self, peer: ServerConnection) -> None:
        """Take messages until the peer closes, or is closed for a wrong one or too many."""
        # Messages that may come now: each takes one, each second gives MOST_A_SECOND, which is also
        # the most.
        allowance = float(MOST_A_SECOND)
        before = clock.monotonic()
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
        """End the drive: a peer with the token sent what our page cannot have sent."""
        self.faults.append(sentence)
        self._desk.end(sentence)

    def _take(self, message: Json) -> None:
        """Act on a message. Between drives only answers have an effect: a new drive begins with a
        new desk and no tellings.
        """
        ((kind, value),) = message.items()  # a message has exactly one key
        desk = self._desk
        match kind:
            case "answers":
                if self._answers.full():
                    raise MessageError(f"More than {MOST_ANSWERS} answers came without a question.")
                self._answers.put_nowait(value)
            case "telling":
                if len(self._tellings) >= MOST_TELLINGS:
                    raise MessageError(
                        f"A window may send its figures at most {MOST_TELLINGS} times in a drive."
                    )
                self._tellings.append(value)
            case "finished":
                self._finished.set()
            case "pause":
                desk.hold(value)
            case "quit":
                desk.end(OWN_WISH)
            case "input":
                desk.newest = value
            case "ready":
                desk.due = clock.perf_counter() + self._countdown
                desk.on_hold = ""

    def _post(self, key: str, value: Any) -> None:
        """Put a message of the drive into the outbox."""
        if key == "state":
            self._latest = value
        self._outbox[key] = value
        self._outbox_filled.set()

    async def _send_outbox(self, peer: ServerConnection) -> None:
        """Send what is in the outbox whenever it is filled."""
        with suppress(ConnectionClosed):
            while True:
                await self._outbox_filled.wait()
                self._outbox_filled.clear()
                outbox = self._outbox
                self._outbox = {}
                for key, value in outbox.items():
                    await peer.send(json.dumps({key: value}, separators=(",", ":")))

    async def _send_view(self) -> None:
        """Send the latest view, and of a drive the latest state."""
        if self._peer is not None and self._view is not None:
            with suppress(ConnectionClosed):
                await self._peer.send(json.dumps(self._view, allow_nan=False))
                if self._latest is not None:
                    await self._peer.send(json.dumps({"state": self._latest}))

    # -- what the server asks of the person --------------------------------------------------------

    async def show(self, view: Json) -> None:
        """Show a view: {"show": kind, ...}; a window that returns sees it again."""
        self._view = view
        await self._send_view()

    async def ask(self, view: Json) -> Json:
        """Show a view and wait for its answers."""
        while not self._answers.empty():
            self._answers.get_nowait()  # discard answers to an earlier view
        await self.show(view)
        return await self._answers.get()

    async def drive(
        self,
        concrete: ConcreteScenario,
        settings: SimulationSettings,
        writer: Writer,
        view: Json,
    ) -> tuple[Recording, list[Json]]:
        """Let the person drive: the recording, and the figures that the page sent (`Telling`)."""
        await self.show({"show": "wait"})
        # load, and where needed compile, all that a drive uses: its first step must not be late
        warm_up = Player([(0.0, 1e-6)] * 2)  # two steps: acceleration, and steering that is not 0
        await asyncio.to_thread(simulate, concrete, warm_up, settings)
        self._desk = Desk()
        self._tellings = []
        self._outbox = {}
        await self.show({**view, "show": "drive", "countdown": self._countdown})
        loop = asyncio.get_running_loop()

        def post(key: str, value: Any) -> None:
            loop.call_soon_threadsafe(self._post, key, value)

        seat = Seat(self._desk, settings.vehicle, settings.step, writer, post)
        drive = asyncio.create_task(asyncio.to_thread(simulate, concrete, seat, settings))
        try:
            # a drive that the seat ended has the end reason `quit`
            recording = with_quit(await asyncio.shield(drive), seat.left)
        # Ctrl-C cancels this task, but not the thread that drives; it must end before this task
        except asyncio.CancelledError:
            self.stop()
            await drive
            raise
        finally:
            self._latest = None
        await self._finish()
        return recording, self._tellings

    async def _finish(self) -> None:
        """Let the page end its drive, so that it sends the figures since its last telling."""
        self._finished.clear()
        if self._peer is not None:
            with suppress(ConnectionClosed, TimeoutError):
                await self._peer.send('{"finished": true}')
                await asyncio.wait_for(self._finished.wait(), LAST_FIGURES)


def _response(status: HTTPStatus, text: str, kind: str = "plain", policy: str = "") -> Response:
    """An answer to a request over HTTP.

    kind: subtype of `text/`.
    policy: of content security; empty: nothing may be loaded.
    """
    content = text.encode()
    headers = Headers({
        "Content-Type": f"text/{kind}; charset=utf-8", "Content-Length": str(len(content)),
        "Connection": "close", "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer", "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Content-Security-Policy": policy or "default-src 'none'; frame-ancestors 'none'"
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, content)
