"""The server: who may talk to it, what it does with those who may not, and a drive through it, with
nothing lost."""

import asyncio
import functools
import json
import signal
import socket
import subprocess
import sys
from contextlib import asynccontextmanager

import pytest
from refusals import refusal
from road_scenes import assert_ended

websockets = pytest.importorskip("websockets")
from unpaced import UnpacedWindow  # noqa: E402
from websockets.asyncio.client import connect  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402

from sumo_eval.cosim import simulate  # noqa: E402
from sumo_eval.extras.wheel.hands import RELEASED, Given, Hands  # noqa: E402
from sumo_eval.extras.wheel.messages import MOST_A_SECOND  # noqa: E402
from sumo_eval.extras.wheel.page import drive_view, page  # noqa: E402
from sumo_eval.extras.wheel.quality import Quality, QualitySettings  # noqa: E402
from sumo_eval.extras.wheel.tape import LeftTheWheelError, again, digest, read_tape, with_quit  # noqa: E402
from sumo_eval.extras.wheel.trip import concrete_of, one_drive, settings_at  # noqa: E402
from sumo_eval.extras.wheel.window import FLOODED, TAKEN, UNKNOWN, WRONG, Window  # noqa: E402
from sumo_eval.scenario import catalogue  # noqa: E402

LOGICAL = catalogue.load("front_vehicle_cut_out")
CONCRETE = concrete_of(LOGICAL, {"ego_speed": 20.0, "obstacle_speed": 5.0, "gap": 40.0})
SETTINGS = settings_at(20)
WRONG_INPUT = "A message must be one of the page's; `input.0`: Input should be a valid integer."


def run(test):
    """A test that awaits, as one that pytest knows."""
    return functools.wraps(test)(lambda *given, **named: asyncio.run(test(*given, **named)))


async def asked(window, text):
    reader, writer = await asyncio.open_connection("127.0.0.1", window.port)
    writer.write(text.replace("\n", "\r\n").encode() + b"\r\n\r\n")
    answer = (await asyncio.wait_for(reader.read(400_000), 5.0)).decode()
    writer.close()
    return answer


def opened(window, **more):
    origin = f"http://127.0.0.1:{window.port}"
    return connect(
        f"ws://127.0.0.1:{window.port}/wheel", **{"origin": origin, "proxy": None, **more}
    )


async def known(window):
    peer = await opened(window)
    await peer.send(json.dumps({"token": window.token}))
    return peer


async def closing(peer, *texts, **more):
    """With what code the server shuts somebody out who says this."""
    try:
        for text in texts:
            await peer.send(text, **more)
        while True:
            await asyncio.wait_for(peer.recv(), 10.0)
    except ConnectionClosed:
        return int(peer.close_code)


@run
async def test_only_its_own_page_at_its_own_address_may_talk():
    async with Window(page("Drive")) as window:
        good = f"GET / HTTP/1.1\nHost: 127.0.0.1:{window.port}"
        answer = await asked(window, good)
        assert answer.startswith("HTTP/1.1 200")
        assert "frame-ancestors 'none'" in answer
        assert "no-store" in answer
        assert "{nonce}" not in answer
        assert window.token not in answer
        for host in ("evil.example", "127.0.0.1", f"evil.example:{window.port}", ""):
            assert "HTTP/1.1 421" in await asked(window, f"GET / HTTP/1.1\nHost: {host}")
        assert "HTTP/1.1 421" in await asked(window, f"{good}\nHost: 127.0.0.1:{window.port}")
        own = f"127.0.0.1:{window.port}"
        near = [f"http://127.0.0.1:{window.port + 1}", f"https://{own}", "http://127.0.0.1",
            f"http://{own}/",
                f"http://localhost:{window.port}", f"http://[::1]:{window.port}"]  # fmt: skip
        for origin in ("http://evil.example", "null", None, *near):
            with pytest.raises(InvalidStatus, match="403"):
                await opened(window, origin=origin)
        assert window._listening.getsockname()[0] == "127.0.0.1"


class Port80(socket.socket):
    """A socket that calls its port 80, which only a privileged program can bind."""

    def getsockname(self):
        return "127.0.0.1", 80


@run
async def test_browsers_leave_out_port_80(monkeypatch):
    server = Port80()
    server.bind(("127.0.0.1", 0))
    _, port = socket.socket.getsockname(server)
    server.listen()
    monkeypatch.setattr(socket, "create_server", lambda address: server)
    async with Window(page("Drive"), port=80) as window:
        window.port = port
        assert "HTTP/1.1 200" in await asked(window, "GET / HTTP/1.1\nHost: localhost")
        address, origin = "ws://127.0.0.1:80/wheel", "http://127.0.0.1"
        peer = await connect(address, origin=origin, proxy=None, host="127.0.0.1", port=port)
        assert await closing(peer, '{"token": ""}') == UNKNOWN


@run
async def test_no_path_is_served_but_the_page(tmp_path, monkeypatch):
    """From within a study's folder: its own files, what a link in it leads to, what lies outside,
    by dots as they are, encoded once and twice, with backslashes, as an address of its own: each is
    404, and no byte of a file comes.
    """
    study = tmp_path / "study"
    study.mkdir()
    (tmp_path / "outside.txt").write_text("SECRET")
    (study / "journal.jsonl").write_text("SECRET")
    (study / "link.txt").symlink_to(tmp_path / "outside.txt")
    (study / "up").symlink_to(tmp_path)
    monkeypatch.chdir(study)
    paths = [
        "/journal.jsonl", "/link.txt", "/up/outside.txt", "/../outside.txt", "/..",
        "/%2e%2e/outside.txt", "/.%2e/",
        "/%2e%2e%2foutside.txt", "/%252e%252e%252foutside.txt", "/..%5coutside.txt",
        "/..\\outside.txt",
        f"/{tmp_path}/outside.txt", f"/{study}", "//etc/passwd", "/./", "//", "/index.html",
        "/favicon.ico", "/?a=b",
        "/wheel/..", "/wheel?a", "/wheel/", "/journal.jsonl%00", "/;/../outside.txt",
        "file:///etc/passwd",
    ]  # fmt: skip
    async with Window(page("Drive")) as window:
        own = f"http://127.0.0.1:{window.port}/outside.txt"
        for path in (*paths, own):
            answer = await asked(window, f"GET {path} HTTP/1.1\nHost: 127.0.0.1:{window.port}")
            assert answer.startswith("HTTP/1.1 404"), path
            assert "SECRET" not in answer
        for method in ("POST", "PUT", "DELETE", "HEAD", "OPTIONS", "TRACE"):
            answer = await asked(window, f"{method} / HTTP/1.1\nHost: 127.0.0.1:{window.port}")
            assert answer.startswith(("HTTP/1.1 405", "HTTP/1.1 400"))
            assert "SECRET" not in answer


@run
async def test_the_token_opens_and_nothing_else():
    async with Window(page("Drive")) as window:
        for text in ('{"token": "ä"}', json.dumps({"token": window.token[:-1]}), '{"ready": true}'):
            assert await closing(await opened(window), text) == UNKNOWN
        assert await closing(await opened(window), "no json") == WRONG
        assert await closing(await opened(window), "x" * 9000) == 1009
        assert await closing(await opened(window), b"binary") == WRONG
        first = await known(window)
        await window.show({"show": "sheet", "title": "here"})
        assert json.loads(await first.recv())["title"] == "here"
        assert await closing(await known(window)) == TAKEN
        await first.close()
        again_ = await known(window)  # whoever comes back sees what was to be seen
        assert json.loads(await again_.recv())["title"] == "here"


def answer_of(state):
    """A driver at the stick: keeps off the obstacle to the left, then straight; no function but + -
    * / in it."""
    _, time, _, (x, y, heading, speed, _, _), others = state
    near = any(0.0 < other[1] - x < 60.0 and other[0] == 2 for other in others)
    steer = 0.12 * ((3.5 if near or time > 3.0 else 0.0) - y) - 1.6 * heading
    return Given("stick", 0, min(max(steer, -1.0), 1.0), 0.2 if speed < 20.0 else 0.0, 0.0)


class AtTheDoor:
    """That driver as an ADS at the harness's own door."""

    def __init__(self):
        self._hands, self._tick = Hands(SETTINGS.vehicle, SETTINGS.step), 0

    def act(self, seen):
        me, others = seen.ego, sorted(seen.vehicles, key=lambda it: it.number)
        state = [
            self._tick, round(seen.time, 6), 0,
            [me.x, me.y, me.heading, me.speed, me.acceleration, 0.0],
            [[it.number, it.x, it.y, it.heading, it.speed, it.acceleration] for it in others],
        ]  # fmt: skip
        self._tick += 1
        return self._hands.command(answer_of(state), me.speed)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "drive.jsonl"


async def answer(peer, state):
    await peer.send(json.dumps({"input": [state[0] + 1, state[0], *answer_of(state)]}))


def begun(window, path):
    """A drive that waits for somebody at the window."""
    view = drive_view(CONCRETE, SETTINGS, "drive", ())
    return asyncio.create_task(one_drive(window, CONCRETE, SETTINGS, path, view, use=LOGICAL.name))


@asynccontextmanager
async def drive_in_window(path):
    """A window that keeps no clock, and a drive in it."""
    async with UnpacedWindow(page("Drive"), countdown=0.0) as window:
        yield window, begun(window, path)


@asynccontextmanager
async def driven_to(path, step):
    """That window, its drive, and the peer that has driven to a step."""
    async with drive_in_window(path) as (window, drive):
        peer = await known(window)
        assert await steps(peer, step, closes=False) == step
        yield window, drive, peer


async def steps(peer, stop_at=10**6, until=None, *, closes=True):
    """Drive until a step, or until the drive is over; then, if it `closes`, the window is shut.

    The last step seen.
    """
    seen = -1
    while until is None or not until.done():
        try:
            message = json.loads(await asyncio.wait_for(peer.recv(), 0.5))
        except TimeoutError:
            continue
        if message.get("show") == "drive":
            await peer.send('{"ready": true}')
        if "finished" in message:
            await peer.send('{"finished": true}')
        if "state" in message:
            seen = message["state"][0]
            if seen >= stop_at:
                break
            await answer(peer, message["state"])
            # on a fast machine it would send more than a window may
            await asyncio.sleep(1.0 / MOST_A_SECOND)
    if closes:
        await peer.close()
    return seen


def finish(path, stop_at=10**6):
    """Drive until the end, or quit at a step: the recording and its quality."""

    async def body():
        async with drive_in_window(path) as (window, drive):
            peer = await known(window)
            await steps(peer, stop_at, until=drive, closes=False)
            if not drive.done():
                await peer.send('{"quit": true}')
            return await asyncio.wait_for(drive, 60.0)

    return asyncio.run(body())


def test_a_drive_through_the_window_is_the_same_driver_at_the_door_to_the_bit(path):
    """Each step waits for the answer to its own state: no tick between them, and nothing differs.

    The tape driven again comes to the same bytes as well; with one command less it does not.
    """
    recording, quality = finish(path)
    door = simulate(CONCRETE, AtTheDoor(), SETTINGS)
    assert recording.end_reason == door.end_reason == "road_end"
    assert max(recording.ego.y) > 3.0
    assert digest(recording) == digest(door)
    assert again(path).same is True
    assert all(row[2] == step for step, row in enumerate(read_tape(path).rows))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:30], *lines[31:]]) + "\n")
    assert again(path).same is False
    assert quality.end == "road_end"
    assert quality.event == 0.0


def test_quitting_ends_the_drive(path):
    recording, _ = finish(path, 12)
    assert_ended(recording, "quit")
    assert len(read_tape(path).rows) == 12
    assert again(path).same is True
    assert read_tape(path).end["error"] == "quit"


@run
async def test_last_figures_of_a_drive_are_on_its_tape(path):
    """The page sends them once the server says that the drive is finished."""
    figures = {"frames": 3, "dropped": 1, "stepped": 0, "latency": [20.0], "resolution": 1.0}
    async with driven_to(path, 5) as (_, drive, peer):
        await peer.send('{"quit": true}')
        while "finished" not in json.loads(await asyncio.wait_for(peer.recv(), 10.0)):
            pass
        await peer.send(json.dumps({"telling": {**figures, "renderer": "plain drawing"}}))
        await peer.send('{"finished": true}')
        await asyncio.wait_for(drive, 30.0)
    time = read_tape(path).end["time"]
    assert (time["frames"], time["dropped"], time["inputs_timed"]) == (3, 1, 1)


@run
async def test_a_window_that_was_closed_holds_the_drive_and_whoever_comes_back_goes_on(path):
    """Closed at step 20, opened again: that state is there, the drive goes on to its end, the tape
    has the pause."""
    async with drive_in_window(path) as (window, drive):
        assert await steps(await known(window), stop_at=20) == 20
        await asyncio.sleep(0.1)
        assert await steps(await known(window), until=drive) > 100
        recording, quality = await drive
        assert recording.end_reason == "road_end"
        assert quality.pauses == 1
    door = simulate(CONCRETE, AtTheDoor(), SETTINGS)
    assert read_tape(path).end["digest"] == digest(door)
    assert [it["why"] for it in read_tape(path).notes if it["note"] == "pause"] == ["closed"]


@run
async def test_a_pause_that_is_over_before_the_seat_looks_is_on_the_tape(path):
    """`pause` and `ready` in one breath, while the seat waits for the answer to step 20: one pause,
    by the key."""
    async with driven_to(path, 20) as (window, drive, peer):
        window._take({"pause": "key"})
        window._take({"ready": True})
        await answer(peer, window._latest)
        await steps(peer, until=drive, closes=False)
        assert (await drive)[1].pauses == 1
    assert [(it["step"], it["why"]) for it in read_tape(path).notes if it["note"] == "pause"] == [
        (20, "key")
    ]


class Gone:
    def act(self, seen):
        raise LeftTheWheelError("x")


def test_no_ads_can_end_its_case_by_quitting():
    found = simulate(CONCRETE, Gone(), SETTINGS)
    assert found.end_reason == "ads_error"
    assert with_quit(found, "quit").end_reason == "quit"


def test_a_tape_that_broke_off_can_be_driven_and_one_that_was_never_a_tape_cannot(path):
    finish(path, 8)
    path.write_text("\n".join(path.read_text().splitlines()[:6]) + "\n[0.1,0.0,5")
    found = again(path)
    assert found.same is None
    assert "(quit) broke off" in found.sentence

    for text in ("", "{}", '{"format":1}\n[1]\n', '{"format":1}\nnonsense\n{}\n', '{"format":1}\n'):
        path.write_text(text)
        with refusal(r"drive\.jsonl|tape"):
            again(path)


@run
async def test_who_sends_too_much_is_shut_out():
    async with Window(page("Drive")) as window:
        peer = await known(window)
        assert await closing(peer, *['{"ready": true}'] * 3000) == FLOODED
        assert "messages a second" in window.faults[0]


@pytest.mark.parametrize(
    "text, code, words",
    [
        ("x" * 9000, 1009, "A message of the window is larger than 8192 bytes."),
        (json.dumps({"ä" * 400: 1}, ensure_ascii=False), WRONG, "A message must be one of"),
        (
            f'{{"input": [0, 0, "stick", 0, 1{"0" * 4000}, 0, 0]}}',
            WRONG,
            "A message must be one of the page's; `input.4`: ",
        ),
        ('{"input": [NaN]}', WRONG, WRONG_INPUT),
        (b"\xff\x00", WRONG, "A message must be text."),
    ],
)
@run
async def test_whatever_is_wrong_with_a_message_the_drive_ends_with_a_sentence(
    path, text, code, words
):
    """Also what is wrong before it can be read; what was driven until then is there, and comes to
    the same bytes."""
    async with driven_to(path, 5) as (window, drive, peer):
        assert await closing(peer, text) == code
        recording, _ = await asyncio.wait_for(drive, 30.0)
        assert recording.end_reason == "quit"
        assert recording.error.startswith(words)  # which the page shows
        assert window.faults == [recording.error]
    assert read_tape(path).end["error"] == recording.error
    assert len(read_tape(path).rows) == 5
    assert again(path).same is True


@run
async def test_a_second_browser_is_shut_out_and_the_first_one_drives_on(path):
    async with driven_to(path, 10) as (window, drive, peer):
        assert await closing(await known(window), '{"quit": true}') == TAKEN
        assert await closing(await opened(window), json.dumps({"token": "x"})) == UNKNOWN
        assert await closing(await opened(window), "x" * 9000) == 1009
        assert await closing(await opened(window), [b"\xff"], text=True) == 1007
        assert window.faults == []
        await peer.send(json.dumps({"input": [11, 10, *RELEASED]}))
        await steps(peer, until=drive)
        recording, quality = await drive
        assert recording.end_reason == "road_end"
        assert quality.pauses == 0
    assert again(path).same is True


@pytest.mark.campaign
def test_a_laptop_that_sleeps_and_a_page_that_freezes_hold_the_drive_and_lose_nothing(tmp_path):
    """The program stands still for 2.5 s in mid-drive, as while a laptop sleeps; then the window
    answers nothing for longer than 2 s; then it is gone without a word. Each holds the drive until
    somebody says that it goes on; the tape has all three and comes to the same bytes.
    """
    command = [sys.executable, "-m", "sumo_eval", "drive", LOGICAL.name, "--rate", "20",
        "--no-browser", "--port", "0",
               "--out", str(tmp_path)]  # fmt: skip
    for name in ("ego_speed", "obstacle_speed", "gap"):
        command += ["--set", f"{name}={CONCRETE.values[name]}"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address, token = server.stdout.readline().split(": ", 1)[1].strip().split("/#")

        async def window():
            peer = await connect(
                f"{address.replace('http', 'ws')}/wheel", origin=address, proxy=None
            )
            await peer.send(json.dumps({"token": token}))
            return peer

        async def until(peer, *wanted, answers=True, most=1000):
            """The first message of a wanted kind; states before it are answered, `most` of them."""
            number = 0
            while True:
                message = json.loads(await asyncio.wait_for(peer.recv(), 60.0))
                if set(message) & set(wanted) or number >= most:
                    return message
                if "state" in message and answers:
                    number += 1
                    await answer(peer, message["state"])

        async def body():
            peer = await window()
            while (await until(peer, "show"))["show"] != "drive":
                pass
            await peer.send('{"ready": true}')
            await until(peer, most=5)
            server.send_signal(signal.SIGSTOP)
            await asyncio.sleep(2.5)
            server.send_signal(signal.SIGCONT)
            assert (await until(peer, "held"))["held"] == "asleep"
            await peer.send('{"ready": true}')
            assert (await until(peer, "held", answers=False))["held"] == "silent"
            peer.transport.abort()
            await asyncio.sleep(0.2)
            peer = await window()
            await until(peer, "state", answers=False)
            await peer.send('{"quit": true}')
            while (await until(peer, "show"))["show"] != "sheet":
                pass
            await peer.send('{"answers": {"button": "end"}}')
            await until(peer, "show")
            await peer.close()

        asyncio.run(body())
        assert server.wait(30.0) == 0
    finally:
        server.kill()
        server.wait()
        server.stdout.close()
    (path,) = tmp_path.glob("*.jsonl")
    tape = read_tape(path)
    assert [it["why"] for it in tape.notes if it["note"] == "pause"] == ["asleep", "silent"]
    assert tape.end["quality"]["unanswered"] > 2.0
    assert "no answer of the window, s" in str(
        Quality(**tape.end["quality"]).against(QualitySettings())
    )
    assert len(tape.rows) > 40
    assert again(path).same is True
