"""Differences between two runs, apart from the behaviour of their ADSs.

Every difference is shown. One that could change a score by itself is an InputError unless the user
accepts it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.results import Evaluation
from sumo_eval.settings.config import to_plain

HARMLESS = ("name", "ads", "run", "report")
"""Settings that change no case of an ADS that both runs have: who drives, how work is spread, how
it is shown."""

ABSENT = "not set"
INPUTS = ("networks/", "routes/")
SIMULATORS = ("libsumo", "sumo", "eclipse-sumo")


@dataclass(frozen=True, slots=True)
class Difference:
    """Something that differs between two runs.

    decides: it could change a score, whatever the ADS did.
    """

    what: str
    base: str
    new: str
    decides: bool

    @property
    def words(self) -> str:
        """`method.score.a: 50 in the base, 60 in the new run`."""
        return f"{self.what}: {self.base} in the base, {self.new} in the new run"


def differences(base: Evaluation, new: Evaluation) -> tuple[Difference, ...]:
    """Everything that differs except the ADSs' behaviour; deciding differences first."""
    found = []
    for (decides, old), (_, now) in zip(_parts(base), _parts(new), strict=True):
        for key in old | now:
            before, after = old.get(key, ABSENT), now.get(key, ABSENT)
            if before != after:
                found.append(Difference(key, before, after, decides))
    return tuple(sorted(found, key=lambda item: not item.decides))


def refuse_unless_comparable(found: tuple[Difference, ...]) -> None:
    """Raise InputError when something decides, naming all of it."""
    deciding = [item.words for item in found if item.decides]
    if deciding:
        raise InputError(
            "The two runs cannot be compared case by case, because not only the ADS differs:\n  "
            + "\n  ".join(deciding)
            + "\nRun both with the same settings and versions, or accept this with "
            "--accept-differences."
        )


def _parts(evaluation: Evaluation) -> list[tuple[bool, dict[str, str]]]:
    """Parts in which two runs may differ, and whether each decides."""
    manifest, settings = evaluation.manifest, evaluation.settings
    plain = {key: value for key, value in to_plain(settings).items() if key not in HARMLESS}
    plain["scenario"] = {entry["use"]: entry for entry in plain["scenario"]}
    # a scenario that another version of the package writes otherwise shows in SUMO's inputs
    written = {
        name: sha256[:12]
        for name, sha256 in manifest.get("sha256", {}).items()
        if name.startswith(INPUTS)
    }
    # an edited severity of one's own measures otherwise under the same name
    severity = str(manifest.get("severity", {}).get("sha256", ""))
    # T and S+ with and without the reference car, which earlier runs lack, are never mixed
    cars = [score.task_reference or "none" for score in evaluation.scores[:1]]
    versions: dict[bool, dict[str, str]] = {True: {}, False: {}}
    for name, version in manifest.get("versions", {}).items():
        versions[name in SIMULATORS][f"version of {name}"] = str(version)
    builds: dict[str, str] = manifest.get("builds", {})
    return [
        (True, dict(_flat(plain, ""))),
        (True, written),
        (True, {"file of the severity": severity[:12]} if severity else {}),
        (True, {"reference car of T": cars[0]} if cars else {}),
        *versions.items(),
        (False, {f"build of {ads}": build for ads, build in builds.items()}),
        (False, {f"controller of {ads.name}": ads.controller for ads in settings.ads}),
    ]


def _flat(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}.{key}" if path else str(key))
    else:
        yield path, str(value)
