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
    found = [
        one
        for of in (_comparable, _files, _severity_file, _reference_car)
        for one in _differing(of(base), of(new), "", decides=True)
    ]
    found += _versions(base, new)
    for of, prefix in ((_builds, "build of "), (_controllers, "controller of ")):
        found += _differing(of(base), of(new), prefix, decides=False)
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


def _comparable(evaluation: Evaluation) -> dict[str, str]:
    plain = {
        key: value for key, value in to_plain(evaluation.settings).items() if key not in HARMLESS
    }
    plain["scenario"] = {entry["use"]: entry for entry in plain["scenario"]}
    return dict(_flat(plain, ""))


def _flat(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}.{key}" if path else str(key))
    else:
        yield path, str(value)


def _controllers(evaluation: Evaluation) -> dict[str, str]:
    return {ads.name: ads.controller for ads in evaluation.settings.ads}


def _builds(evaluation: Evaluation) -> dict[str, str]:
    builds: dict[str, str] = evaluation.manifest.get("builds", {})
    return builds


def _files(evaluation: Evaluation) -> dict[str, str]:
    """Contents of the SUMO inputs, by name: a scenario that another version of the package writes
    otherwise shows.
    """
    hashes: Mapping[str, str] = evaluation.manifest.get("sha256", {})
    return {
        name: digest[:12]
        for name, digest in hashes.items()
        if name.startswith(("networks/", "routes/"))
    }


def _severity_file(evaluation: Evaluation) -> dict[str, str]:
    """Content of the file that holds a severity of one's own: an edited one measures otherwise
    under the same name.
    """
    digest = str(evaluation.manifest.get("severity", {}).get("sha256", ""))
    return {"file of the severity": digest[:12]} if digest else {}


def _reference_car(evaluation: Evaluation) -> dict[str, str]:
    """The reference car of T, which runs recorded earlier do not have: T and S+ with and without it
    are never mixed.
    """
    return (
        {"reference car of T": evaluation.scores[0].task_reference or "none"}
        if evaluation.scores
        else {}
    )


def _versions(base: Evaluation, new: Evaluation) -> Iterator[Difference]:
    """Another simulator decides; another version of anything else is worth knowing."""
    before, after = base.manifest.get("versions", {}), new.manifest.get("versions", {})
    for decides in (True, False):
        old, now = (
            {name: found for name, found in versions.items() if (name in SIMULATORS) is decides}
            for versions in (before, after)
        )
        yield from _differing(old, now, "version of ", decides=decides)


def _differing(
    base: Mapping[str, Any], new: Mapping[str, Any], prefix: str, *, decides: bool
) -> Iterator[Difference]:
    for key in (*base, *(key for key in new if key not in base)):
        before, after = str(base.get(key, ABSENT)), str(new.get(key, ABSENT))
        if before != after:
            yield Difference(f"{prefix}{key}", before, after, decides)
