"""The page in a browser: a driver at its gamepad is the same driver at the harness's own door, to
the bit."""

import asyncio
import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from tables import values_of

pytest.importorskip("websockets")
from browser import Page, needs_chromium
from test_window import LOGICAL, SETTINGS
from unpaced import UnpacedWindow

from sumo_eval.cosim import simulate
from sumo_eval.extras.wheel.hands import Given, Hands
from sumo_eval.extras.wheel.page import drive_view, page, replay, sheet
from sumo_eval.extras.wheel.quality import Quality, QualitySettings
from sumo_eval.extras.wheel.tape import digest, read_tape
from sumo_eval.extras.wheel.trip import concrete_of, one_drive
from sumo_eval.extras.wheel.window import Window

FAR = concrete_of(LOGICAL, {"ego_speed": 20.0, "obstacle_speed": 15.0, "gap": 120.0})
SHORT = replace(FAR, time_limit=3.0)
PAD = """
    const axes = [0, 0], buttons = Array.from({ length: 8 }, () => ({ value: 0 }));
    Navigator.prototype.getGamepads = () => {
      if (sumoDrive.state) {
        const [, , , [, y, heading, speed]] = sumoDrive.state;
        axes[0] = -(0.1 * (3.5 - y) - 0.15 * speed * heading);
        buttons[7].value = speed < 21 ? 0.5 : 0;
      }
      return [{ id: "pad", connected: true, axes, buttons }];
    };
    const choice = document.querySelector(".veil select");
    choice.value = "pad";
    choice.dispatchEvent(new Event("change"));
"""
"""A gamepad that nobody holds, before the browser's own."""


class AtTheDoor:
    """Who holds that gamepad, as an ADS."""

    def __init__(self):
        self._hands = Hands(SETTINGS.vehicle, SETTINGS.step)

    def act(self, seen):
        me = seen.ego
        value = -(0.1 * (3.5 - me.y) - 0.15 * me.speed * me.heading)
        alive = (
            0.0
            if abs(value) < 0.06
            else (1.0 if value > 0.0 else -1.0) * (abs(value) - 0.06) / (1 - 0.06)
        )
        given = Given("stick", 0, min(max(-alive, -1.0), 1.0), 0.5 if me.speed < 21 else 0.0, 0.0)
        return self._hands.command(given, me.speed)


def driven(path, at_the_browser, window_of=Window, size=(500, 400)):
    """What comes of a drive while a browser shows it.

    at_the_browser: what is done there.
    """
    window = []
    ready = threading.Event()

    async def body():
        async with window_of(page("Drive"), countdown=0.0) as made:
            window.append(made)
            ready.set()
            recording, _ = await one_drive(
                made, SHORT, SETTINGS, path, drive_view(SHORT, SETTINGS, "Drive", ("Go.",))
            )
            seen = replay(
                SHORT, "you", {"ego": recording.ego, **recording.actors}, recording.collision
            )
            await asyncio.wait_for(
                made.ask(sheet("Over", replay=seen, buttons=[["end", "That is all"]])), 120.0
            )
            return recording

    with ThreadPoolExecutor(1) as pool:
        drive = pool.submit(asyncio.run, body())
        assert ready.wait(30.0)
        with Page(path.parent / "profile", *size) as browser:
            try:
                browser.open(
                    window[0].address, "typeof sumoDrive !== 'undefined' && sumoDrive.state"
                )
                at_the_browser(browser)
                browser.wait(
                    "document.querySelector('.replay-reading')?.textContent.includes('m/s')"
                )
                assert browser.problems == []
                browser.run("document.querySelector('.sheet button.main').click()")
                return drive.result(60.0)
            finally:
                window[0].stop()


@needs_chromium
def test_a_driver_at_the_pages_gamepad_is_that_driver_at_the_door_to_the_bit(tmp_path):
    """Each step waits for an answer to its own state, so there is no input tick between the two at
    all."""

    def pad(browser):
        assert browser.run("location.hash") == ""  # the token is in no history
        # TTC of bodies 26 m apart at 5 m/s
        browser.run(
            "window.first = sumoDrive.state.splice(3, 2, [100, 0, 0, 20], [[1, 130.5, 0, 0, 15]])"
        )
        browser.wait("document.querySelector('.hud .TTC b').textContent === '5.2 s'")
        browser.run("sumoDrive.state.splice(3, 2, ...window.first)")
        browser.run(f"(() => {{ {PAD} }})()")
        browser.run("document.querySelector('.veil button.main').click()")
        browser.wait("document.documentElement.dataset.shown === 'sheet'")

    path = tmp_path / "drive.jsonl"
    found, door = driven(path, pad, UnpacedWindow), simulate(SHORT, AtTheDoor(), SETTINGS)
    assert found.end_reason == door.end_reason == "time_limit"
    assert found.ego.y[-1] > 1.0
    assert digest(found) == digest(door)
    tape = read_tape(path)
    assert {row[3] for row in tape.rows} == {"stick"}
    assert tape.end["time"]["frames"] > 0  # also of a drive of less than 1 s


def chosen(browser, kind):
    """Drive with this from now on."""
    browser.run(f"""(() => {{ const choice = document.querySelector('.veil select');
        choice.value = {kind!r}; choice.dispatchEvent(new Event('change')); }})()""")


def device(browser, axes):
    """A steering wheel with two pedals that rest at 1."""
    browser.run(
        f"window.device = {{ id: 'wheel', connected: true, axes: {axes}, buttons: [{{ value: 0 }}] }}"
    )


@needs_chromium
def test_mouse_keys_and_a_wheel_reach_the_tape_and_a_hidden_window_holds_the_drive(tmp_path):
    """In real time: the mouse, 8 px to the left of the middle, of 200, its left button pressed;
    held by the
    page's button; left is pressed on the keyboard and let go; the window loses the focus, nothing
    moves; then it goes on with a steering wheel, calibrated: at 2 % of its way to the left, of 450
    degrees, it is turned by 0.157 rad."""

    def keys(browser):
        browser.run("Navigator.prototype.getGamepads = () => [window.device]")
        chosen(browser, "wheel")
        assert browser.run("document.querySelector('.veil button.main').disabled")
        browser.run("document.querySelector('.veil button.calibrate').click()")
        # rest, left, right, throttle, brake
        for axes in ([0, 1, 1], [-1, 1, 1], [1, 1, 1], [0, -1, 1], [0, 1, -1]):
            device(browser, axes)
            browser.run("document.querySelector('.veil button.main').click()")
        browser.wait("document.querySelector('.veil h2').textContent === 'Drive'")
        assert not browser.run("document.querySelector('.veil button.main').disabled")
        chosen(browser, "mouse")
        browser.run("document.querySelector('.veil button.main').click()")
        browser.wait("sumoDrive.state[1] > 0.1")
        half = browser.run("document.querySelector('.place').clientWidth / 2")
        for kind in ("mouseMoved", "mousePressed"):
            browser.call(
                "Input.dispatchMouseEvent",
                type=kind,
                x=half - 8.0,
                y=300,
                button="left",
                buttons=1,
                clickCount=1,
            )
        time.sleep(0.2)
        browser.run("document.querySelector('.tools button').click()")
        chosen(browser, "keys")
        # a slow machine drives further with the mouse: some steps without a key come first
        held = browser.run("sumoDrive.state[1]")
        browser.run("document.querySelector('.veil button.main').click()")
        browser.wait(f"sumoDrive.state[1] > {held} + 0.11")
        # of both keys for left one is released at once, the other one beside Ctrl (2)
        for kind, code, modifiers, wait in values_of("""
            "keyDown", "ArrowLeft", 0, 0.0
            "keyDown", "KeyA", 0, 0.0
            "keyUp", "KeyA", 0, 0.25
            "keyUp", "ArrowLeft", 2, 0.25
            """):  # fmt: skip
            browser.call("Input.dispatchKeyEvent", type=kind, code=code, modifiers=modifiers)
            time.sleep(wait)
        browser.run("window.dispatchEvent(new Event('blur'))")
        browser.wait("!document.querySelector('.veil').hidden")
        time.sleep(0.2)
        before = browser.run("sumoDrive.state[0]")
        time.sleep(0.3)
        assert browser.run("sumoDrive.state[0]") == before
        assert len(browser.picture()) > 5_000
        device(browser, [-0.02, 1, 1])
        chosen(browser, "wheel")
        browser.run("document.querySelector('.veil button.main').click()")
        browser.wait("document.documentElement.dataset.shown === 'sheet'")

    path = tmp_path / "drive.jsonl"
    assert driven(path, keys).end_reason == "time_limit"
    tape = read_tape(path)
    pressed = [row[4] for row in tape.rows if row[3] == "keys"]
    changes = [key for key, before in zip(pressed, [None, *pressed], strict=False) if key != before]
    assert changes == [0, 1, 0]
    assert pressed.count(1) > 2
    assert max(row[1] for row in tape.rows if row[3] == "keys") > 0.05
    wheel = [row for row in tape.rows if row[3] == "wheel"]
    assert wheel[-1][5] == pytest.approx(math.radians(0.02 * 450.0))
    assert wheel[-1][1] == wheel[-1][5]
    assert wheel[-1][6:8] == (0, 0)
    assert [it["why"] for it in tape.notes if it["note"] == "pause"] == ["key", "hidden"]
    mouse = [row for row in tape.rows if row[3] == "stick"]
    assert mouse[-1][5] == pytest.approx(8.0 / (0.8 * 250.0))
    assert mouse[-1][6:8] == (1, 0)
    assert len(tape.rows) == 60
    assert tape.end["time"]["frames"] > 0


@pytest.mark.campaign
@needs_chromium
def test_fingers_reach_the_tape_and_3_d_by_the_processor_gives_way_to_the_plain_drawing(tmp_path):
    """On a phone's screen: a finger pulled by half its way to the right steers by half; half up,
    the pedal is pressed by 0.5 / 0.85. The browser here has no graphics processor, so the road is
    drawn plainly, the page says so, and the tape too; who wishes for 3-D gets it. A graphics
    processor that is named so and is as slow comes to the same. Where the plain drawing is too slow
    as well, it gets few pixels, then is from above, and a camera that is chosen stays. Where that
    happens while somebody drives, the tape has it, and a study leaves the drive out.
    """

    def fingers(browser):
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=390,
            height=844,
            deviceScaleFactor=2,
            mobile=True,
        )
        browser.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        browser.call("Page.reload")
        browser.wait("typeof sumoDrive !== 'undefined' && sumoDrive.state")
        assert browser.run("document.querySelector('.veil select').value") == "touch"
        for wish, means in (("3-D", "software WebGL"), ("automatic", "plain drawing")):
            browser.run(f"""(() => {{ const it = document.querySelector('.veil .drawing');
                it.value = {wish!r}; it.dispatchEvent(new Event('change')); }})()""")
            assert browser.run("sumoDrive.means") == means
        assert "with its processor" in browser.run(
            "document.querySelector('.veil .because').textContent"
        )
        browser.run("""(() => { sumoScene.means = () => "graphics"; const it = document.querySelector('.veil .drawing');
            it.dispatchEvent(new Event('change')); })()""")
        assert browser.run("sumoDrive.means") == "WebGL"
        # it is slow all the same: fewer pixels first, then this
        browser.wait("sumoDrive.means === 'plain drawing'")
        assert "even with few pixels" in browser.run(
            "document.querySelector('.veil .because').textContent"
        )
        browser.run("window.soon = requestAnimationFrame; window.requestAnimationFrame = (then) =>"
                    " setTimeout(() => then(performance.now()), 40)")  # fmt: skip
        # pictures 40 ms apart: few pixels, then this
        browser.wait("sumoDrive.drawnAs === 'plain drawing from above'")
        assert "ms apart: the road is drawn from above" in browser.run("sumoDrive.plainly")
        camera = "document.querySelector('.tools select')"
        assert browser.run(f"{camera}.value") == "above"
        browser.run(f"{camera}.value = 'behind'; {camera}.dispatchEvent(new Event('change'))")
        assert browser.run("sumoDrive.drawnAs") == "plain drawing with few pixels"
        browser.wait("sumoDrive.plainly.includes('nothing cheaper to draw is left')")
        # a camera that was chosen stays
        assert browser.run("sumoDrive.drawnAs") == "plain drawing with few pixels"
        browser.run("""(() => { window.clock = 0; // by which pictures come 200 ms apart while somebody drives
            window.requestAnimationFrame = (then) =>
                setTimeout(() => then(window.clock += document.querySelector('.veil')?.hidden ? 200 : 16), 5);
            const it = document.querySelector('.veil .drawing');
            it.value = 'plain'; it.dispatchEvent(new Event('change')); })()""")
        browser.run("document.querySelector('.veil button.main').click()")
        browser.wait("sumoDrive.state[1] > 0.2")
        pedal = browser.run("(({ x, y, width, height }) => [x + width / 2, y + height / 2])"
                            "(document.querySelector('.pedal.throttle').getBoundingClientRect())")  # fmt: skip
        for kind, x in (("touchStart", 100), ("touchMove", 135)):
            points = [{"x": x, "y": 700, "id": 1}, {"x": pedal[0], "y": pedal[1], "id": 2}]
            browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        assert len(browser.picture()) > 5_000
        time.sleep(0.3)
        browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        browser.wait("document.documentElement.dataset.shown === 'sheet'")

    path = tmp_path / "drive.jsonl"
    driven(path, fingers, size=(500, 900))
    rows = read_tape(path).rows
    assert {row[3] for row in rows[10:]} == {"stick"}
    assert min(row[5] for row in rows) == -0.5
    assert max(row[6] for row in rows) == pytest.approx(0.5 / 0.85, abs=0.01)
    assert rows[-1][5:8] == (0, 0, 0)
    end = read_tape(path).end
    assert end["quality"]["drawn"].startswith("plain drawing, then plain drawing ")
    assert "drawn more cheaply in mid-drive" in str(
        Quality(**end["quality"]).against(QualitySettings(latency_ms=1e6))
    )
