"""Take the first seconds of a public motorway recording out of the wheel that carries it, for
`humans import`.

    pip install --no-deps tasi==0.15.4
    python dlr_sample.py recordings 45
    sumo-eval humans import dlr_highway recordings --out people.csv.gz

The wheel `tasi` (DLR, on PyPI) holds the first five minutes of the DLR Highway Traffic dataset
v1.1.0. Nothing of its code is used, so its dependencies are not needed. Read the dataset's licence
before you use it for more than a look."""

from __future__ import annotations

import sys
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

ARCHIVE = "tasi/dataset/data/DLR-Highway-Traffic-dataset_v1-1-0.zip"
SECONDS_A_MINUTE = 60


def archive() -> Path | None:
    """Where the wheel's archive is, None without the wheel."""
    try:
        path = Path(str(distribution("tasi").locate_file(ARCHIVE)))
    except PackageNotFoundError:
        return None
    return path if path.is_file() else None


def write_sample(folder: Path, seconds: int) -> Path:
    """Write the first seconds of the recording into a folder, as a file in the dataset's own
    layout."""
    found = archive()
    if found is None:
        sys.exit("The wheel tasi must be installed: pip install --no-deps tasi==0.15.4")
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(found) as outer:
        name = next(name for name in outer.namelist() if "/trajectories_" in name)
        path = folder / Path(name).name
        with outer.open(name) as source, path.open("wb") as target:
            target.write(source.readline())
            first = None
            for line in source:  # in the order of time; 2024-10-07 06:00:00.004659+00:00,...
                minute, second = int(line[14:16]), float(line[17:23])
                now = SECONDS_A_MINUTE * minute + second
                first = now if first is None else first
                if now - first >= seconds:
                    break
                target.write(line)
    return path


if __name__ == "__main__":
    if len(sys.argv) != 3 or not sys.argv[2].isdecimal():
        sys.exit(
            "Name the folder to write to and how many seconds to take, at most 300: dlr_sample.py "
            "recordings 45"
        )
    sys.stdout.write(f"{write_sample(Path(sys.argv[1]), int(sys.argv[2]))}\n")
