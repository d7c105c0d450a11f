"""The files that the examples of `--help` and of the docs name, each as small as its command takes
it."""

import functools
import re
import shutil
import tempfile
from pathlib import Path

import pandas as pd
from commands import typed
from learning.test_onnx import linear
from rates.planted import planted

from sumo_eval.drivers.recorded.importing import import_recordings
from sumo_eval.drivers.recorded.recordings import canonical, write_csv

EVALUATION = """
name = "examples"
seed = 1
[[scenario]]
use = "cut_in"
[scenario.sampling]
file = "cases.csv"
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "lane_changer"
controller = "lane_changer"
[drivers]
count = 4
[run]
engine = "serial"
[method.zones]
restarts = 0
refinements = 0
grid_points = 1000
"""
CASES = "ego_speed,cut_in_speed,gap,lateral_speed\n" + "".join(
    f"{20 + number % 9},{12 + number % 5},{30 + 7 * number},{0.8 + 0.1 * (number % 3):.1f}\n"
    for number in range(8)
)
"""So many points that `cut_in-0007-idm` is a case."""

SMALL = """
name = "small"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
[run]
engine = "serial"
"""

RATINGS = "rater,ads,scenario,score\na,idm,cut_in,6\na,lane_changer,cut_in,8\nb,idm,cut_in,5\nb,lane_changer,cut_in,9\n"
GATE = '[[limit]]\nquantity = "new_collisions"\nat_most = 0\n'

ADS = """
class MyAds:
    def act(self, seen):
        return -2.0 if seen.lead else 0.0


def acc(seen):
    return -2.0 if seen.lead else 0.0
"""


def write_people(folder, name="people.csv.gz"):
    """Write a table of people."""
    (folder / name).write_bytes(people())


@functools.cache
def people():
    """Return people.csv.gz: enough planted cut-ins to learn from; vehicle 17 drives from 60 s to 84
    s."""
    with tempfile.TemporaryDirectory() as place:
        source, table = Path(place) / "fcd.csv", Path(place) / "people.csv.gz"
        planted(source, 32, 28.0, 6)
        found = import_recordings("sumo_fcd", [source])
        found.table["vehicle"] = found.table["vehicle"].replace("ego1", "17")
        write_csv(canonical(found.table), table)
        return table.read_bytes()


def write_highd(folder):
    """Write two cars of a highD recording, 4 s at 25 Hz, one behind the other on the lower
    lanes."""
    folder.mkdir(parents=True)
    tracks = [
        {"frame": frame, "id": number, "x": place + 30.0 * frame / 25.0, "y": 21.0, "width": 4.5,
            "height": 1.8,
         "xVelocity": 30.0, "yVelocity": 0.0, "xAcceleration": 0.0, "yAcceleration": 0.0}
        for number, place in ((1, 0.0), (2, 60.0))
        for frame in range(1, 101)
    ]  # fmt: skip
    pd.DataFrame(tracks).to_csv(folder / "01_tracks.csv", index=False)
    pd.DataFrame({"id": [1, 2], "class": "Car", "drivingDirection": 2}).to_csv(
        folder / "01_tracksMeta.csv", index=False
    )
    (folder / "01_recordingMeta.csv").write_text(
        "frameRate,upperLaneMarkings,lowerLaneMarkings\n25,8.5;12.2;16.0,20.0;23.7;27.5\n"
    )


def made(line, folder):
    """Run the line that makes what another one reads."""
    done = typed(line, folder)
    assert done.returncode in (0, 3), done.said


def write_campaign(folder, name="learned/campaign.toml"):
    """Write what `learn` writes, with a campaign of few drives."""
    place = (folder / name).parent
    place.mkdir(exist_ok=True)
    for file, content in learned().items():
        (place / file).write_bytes(content)


@functools.cache
def learned():
    """Learn from the people and return the files of it by name; the campaign asks for 40 drives."""
    with tempfile.TemporaryDirectory() as place:
        write_people(Path(place))
        made("sumo-eval learn people.csv.gz --out learned", Path(place))
        files = {path.name: path.read_bytes() for path in (Path(place) / "learned").iterdir()}
    files["campaign.toml"] = re.sub(rb"(?m)^budget = .*$", b"budget = 40", files["campaign.toml"])
    return files


def write_parts(folder, *parts):
    """Drive the parts of an evaluation into a folder each."""
    (folder / "parts.toml").write_text(SMALL)
    for number, part in enumerate(parts, start=1):
        made(f"sumo-eval run parts.toml --out {part} --shard {number}/{len(parts)}", folder)


def write_scene_run(folder):
    """Drive a recorded scene into results/scene."""
    write_people(folder)
    made("sumo-eval humans scene people.csv.gz --ego 17 --react IDM --out driven.toml", folder)
    scene = SMALL.replace('"front_vehicle_low_speed"', '"driven.toml"').replace(
        "[scenario.sampling]\nlevels = 2\n", ""
    )
    (folder / "of_a_scene.toml").write_text(scene)
    made("sumo-eval run of_a_scene.toml --out results/scene", folder)


def write_nights(folder):
    """Begin a history, nights, with one night."""
    (folder / "one.toml").write_text(SMALL)
    made("sumo-eval run one.toml --out one", folder)
    made("sumo-eval trend nights --import one", folder)


def write_policy(name):
    """Return what writes a network of this name with its table."""

    def write(folder):
        path = linear(folder)
        for file in (path, path.with_suffix(".toml")):
            shutil.move(file, folder / f"{name}{file.suffix}")

    return write


NEEDS = {
    "data/highd": lambda folder: write_highd(folder / "data" / "highd"),
    "recordings": lambda folder: write_highd(folder / "recordings"),
    "people.csv.gz": write_people,
    "highd.csv.gz": lambda folder: write_people(folder, "highd.csv.gz"),
    "learned/campaign.toml": write_campaign,
    "campaign.toml": lambda folder: write_campaign(folder, "campaign.toml"),
    "part1": lambda folder: write_parts(folder, "part1", "part2"),
    "shards/*": lambda folder: write_parts(folder, "shards/1", "shards/2"),
    "results/scene": write_scene_run,
    "nights": write_nights,
    "onnx:policy.onnx": write_policy("policy"),
    "onnx:ppo.onnx": write_policy("ppo"),
}
"""A word of a command, and what makes the file or folder of that name."""


def write_needs(words, folder):
    """Make what a command reads; what it writes behind --out is its own."""
    read = words[: words.index("--out")] if "--out" in words else words
    for word in read:
        NEEDS.get(word, lambda _: None)(folder)
