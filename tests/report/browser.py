"""A headless Chromium driven over its debugging pipe: no driver package, no port, no network."""

import base64
import json
import os
import select
import shutil
import subprocess
import time

import pytest

CHROMIUM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-extensions",
    "--remote-debugging-pipe",
    "--enable-unsafe-swiftshader",
)  # fmt: skip


def node(program, given=None):
    """What a program for Node.js that may read `given` prints as JSON."""
    done = subprocess.run(
        [NODE, "-e", 'const given = JSON.parse(require("fs").readFileSync(0, "utf8"));' + program],
        input=json.dumps(given), capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def plain(trajectory):
    """What a page reads of a trajectory."""
    channels = {
        name: getattr(trajectory, name).tolist() for name in ("time", "x", "y", "heading", "speed")
    }
    return {**channels, "length": trajectory.length, "width": trajectory.width}


class Page:
    """One page.

    `problems`: console errors, exceptions and policy violations; `requests`: every address asked
    for.
    """

    def __init__(self, profile, width=1400, height=900, *flags):
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        own = [f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        command = [CHROMIUM, *FLAGS, *own, *flags, "about:blank"]
        # Chromium listens on descriptor 3 and answers on 4.
        wired = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        self._process = subprocess.Popen(
            ["bash", "-c", wired, "bash", *command],
            pass_fds=(to_browser, from_browser), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._buffer = b""
        self._number = 0
        self.problems = []
        self.requests = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        del self._session  # closing is said to the browser, not to the page
        os.write(self._write, json.dumps({"id": 0, "method": "Browser.close"}).encode() + b"\0")
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def call(self, method, **params):
        """One command of the debugging protocol, and its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if hasattr(self, "_session"):
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def run(self, script):
        """The value of a JavaScript expression; a promise is waited for."""
        answer = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(
                answer["exceptionDetails"]["exception"].get("description", "the script threw")
            )
        return answer["result"].get("value")

    def asked_for(self):
        """Addresses that it asked for, without what lies in the page itself."""
        return [one for one in self.requests if not one.startswith(("data:", "blob:"))]

    def picture(self):
        """What is to be seen, as a PNG file."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def open(self, address, ready):
        """Go to an address and wait until the expression `ready` is true."""
        self.requests.clear()
        self.call("Page.navigate", url=address)
        self.wait(ready)

    def wait(self, ready, seconds=60.0):
        """Wait until a JavaScript expression is true."""
        end = time.monotonic() + seconds
        while not self.run(f"document.documentElement !== null && Boolean({ready})"):
            if time.monotonic() > end:
                raise TimeoutError(f"{ready} never became true; problems: {self.problems}")
            time.sleep(0.05)

    def _receive(self):
        while b"\0" not in self._buffer:
            if not select.select([self._read], [], [], 60.0)[0]:
                raise TimeoutError("the browser does not answer")
            part = os.read(self._read, 1 << 16)
            if not part:
                raise RuntimeError("the browser is gone")
            self._buffer += part
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        self._note(message)
        return message

    def _note(self, message):
        method, params = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            if "GL Driver Message (OpenGL, Performance" in params["entry"]["text"]:
                return  # software drawing says that it is slow
            self.problems.append(params["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in (
            "error",
            "warning",
            "assert",
        ):
            self.problems.append(
                str([item.get("value", item.get("description")) for item in params["args"]])
            )
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
