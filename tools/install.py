"""Install into this Python's environment: by uv, several packages at once, from wherever pip would
take them.

    .venv/bin/python tools/install.py --editable '.[dev]'

uv comes from the index that pip is configured for. Where it cannot be had, or fails, pip does the
same alone.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys

PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
SHARED = ("index-url", "extra-index-url", "find-links", "constraint", "trusted-host", "no-index")
UV_NAMES = {"trusted-host": "allow-insecure-host"}


def configuration(listed: str) -> dict[str, str]:
    """Settings by name from what `pip config list` prints; of two places the one that pip itself
    obeys.
    """
    ranks = {"global": 0, "install": 1, ":env:": 2}
    found: dict[str, tuple[int, str]] = {}
    for line in listed.splitlines():
        place, _, setting = line.partition(".")
        name, equals, value = setting.partition("=")
        if equals and place in ranks and ranks[place] >= found.get(name, (0, ""))[0]:
            found[name] = ranks[place], str(ast.literal_eval(value))
    return {name: value for name, (_, value) in found.items()}


def uv_options(pip: dict[str, str]) -> list[str]:
    """Return pip's settings as options of uv; among several indexes the best version counts, as
    with pip.
    """
    options = ["--index-strategy", "unsafe-best-match"]
    for name in SHARED:
        uv_name = f"--{UV_NAMES.get(name, name)}"
        if name == "no-index":
            options += [uv_name] * (pip.get(name, "") in ("1", "true", "yes", "on"))
        else:
            options += [part for value in pip.get(name, "").split() for part in (uv_name, value)]
    return options


def main(arguments: list[str]) -> int:
    """Install and return the exit status."""
    if (
        subprocess.call(
            [*PIP, "install", "uv"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        == 0
    ):
        listed = subprocess.run(
            [*PIP, "config", "list"], capture_output=True, text=True, check=False
        ).stdout
        pip = configuration(listed)
        environment = dict(os.environ)
        if "cert" in pip:
            environment.setdefault("SSL_CERT_FILE", pip["cert"])
        uv = [
            sys.executable,
            "-m",
            "uv",
            "--quiet",
            "pip",
            "install",
            "--python",
            sys.executable,
            *uv_options(pip),
        ]
        if subprocess.call([*uv, *arguments], env=environment) == 0:
            return 0
        print("uv cannot install this; pip tries.", file=sys.stderr)
    return subprocess.call([*PIP, "install", "--no-compile", *arguments])


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
