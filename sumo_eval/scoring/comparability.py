"""Differences between two runs, apart from the behaviour of their ADSs: settings, input files,
versions, builds.

A difference that decides could change a score by more than its last digits though no ADS changed.
It is an InputError unless the user accepts it. Others, such as another version of numpy, are only
shown.

Users: `scoring/comparison.py`, where `builds_besides` looks for the name `build of {ADS}`. Fixed:
names of differences, which pages and JUnit files show.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from sumo_eval.errors import InputError
from sumo_eval.results import Evaluation
from sumo_eval.settings.config import to_plain

HARMLESS = "name", "ads", "run", "report"
"""Tables of settings that change no outcome of an ADS that both runs have: the run's name, the list
of ADSs, how work is spread, how results are shown. Keys of `[run]` in `LIMITS` and `BATCHES` are
exceptions."""
LIMITS = "case_timeout", "step_timeout", "memory_limit"
"""Limits in `[run]`: an ADS that exceeds one gives up. They decide nothing for any other ADS."""
BATCHES = "cases_per_pack", "cases_per_child"
"""Sizes of batches in `[run]`: measured times of a case are its share of its batch."""

ABSENT = "not set"  # shown instead of a value that a run does not have
INPUTS = "networks/", "routes/"  # folders of a run with SUMO's files
SIMULATOR = "version of libsumo"  # the only version that decides
# begin names of differences between a scenario's files, and between Python files that make it
_FILE, _CODE = "file of scenario ", "code of scenario "


class Difference(NamedTuple):
    """A value that differs between two runs.

    what: name of the value.
    base, new: the value in each run.
    decides: whether it could change a score by more than the last digits, whatever the ADS did.
    """

    what: str
    base: str
    new: str
    decides: bool

    @property
    def words(self) -> str:
        """The difference in words: `method.score.a: 50 in the base, 60 in the new run`."""
        return f"{self.what}: {self.base} in the base, {self.new} in the new run"


def differences(base: Evaluation, new: Evaluation) -> tuple[Difference, ...]:
    """Differences of settings, input files, versions, builds and controllers. Those that decide
    come first.
    """
    items = []
    # both lists have the same parts in the same order
    base_parts, new_parts = _parts(base, other=new), _parts(new, other=base)
    for (decides, old), (_, now) in zip(base_parts, new_parts, strict=True):
        for key in old | now:
            before, after = old.get(key, ABSENT), now.get(key, ABSENT)
            # a scenario that ships has no hash, nor has any in runs of an earlier version
            unknown = key.startswith((_FILE, _CODE)) and ABSENT in (before, after)
            if before != after and not unknown:
                items.append(Difference(key, before, after, decides))
    return tuple(sorted(items, key=lambda item: not item.decides))


def refuse_unless_comparable(differing: tuple[Difference, ...]) -> None:
    """Raise InputError that lists all differences that decide, if there are any."""
    deciding = [item.words for item in differing if item.decides]
    if deciding:
        raise InputError(
            "The two runs cannot be compared case by case, because not only the ADS differs:\n  "
            + "\n  ".join(deciding)
            + "\nRun both with the same settings and versions, or accept this with "
            "--accept-differences."
        )


def _parts(evaluation: Evaluation, other: Evaluation) -> list[tuple[bool, dict[str, str]]]:
    """Parts in which two runs may differ: whether a difference decides, and name -> value.

    evaluation: the run whose values these are.
    other: run that it is compared with.
    """
    manifest, settings = evaluation.manifest, evaluation.settings
    plain = {key: value for key, value in to_plain(settings).items() if key not in HARMLESS}
    # a scenario that only one run has is listed by its name alone; `plain` holds plain tables
    common = {entry.use for entry in other.settings.scenario}
    plain["scenario"] = {
        entry["use"]: entry if entry["use"] in common else {"use": entry["use"]}
        for entry in plain["scenario"]
    }
    # SUMO's files: two versions of this package may write one scenario differently
    written = {
        name: sha256[:12]
        for name, sha256 in manifest.get("sha256", {}).items()
        if name.startswith(INPUTS)
    }
    # hashes of files that may have been edited: of a user's own severity, and of scenarios, which
    # the run keeps beside the exposure of each. A Python file does not decide: it may hold the ADS
    severity = str(manifest.get("severity", {}).get("sha256", ""))
    files, code = (
        {
            f"{beginning}{name}": exposure.get(key, "")[:12] or ABSENT
            for name, exposure in evaluation.exposures.items()
        }
        for beginning, key in ((_FILE, "file"), (_CODE, "code"))
    )
    # recordings and the like; a run of an earlier version of this package does not have the key
    inputs = manifest.get("files", {}) if "files" in other.manifest else {}
    # Runs of an earlier version have no reference car ("none"), so their T and S+ are not
    # comparable with later ones. All scores of a run have the same car: look at the first.
    car = next((score.task_reference or "none" for score in evaluation.scores), ABSENT)
    versions = {
        f"version of {name}": str(version) for name, version in manifest.get("versions", {}).items()
    }
    simulator = versions.pop(SIMULATOR, ABSENT)
    builds: dict[str, str] = manifest.get("builds", {})
    return [
        (True, dict(_flat(plain, ""))),
        (True, written),
        (True, files),
        (True, {f"content of {name}": sha256[:12] for name, sha256 in inputs.items()}),
        (True, {"file of the severity": severity[:12] or ABSENT}),
        (True, {"reference car of T": car}),
        (True, {SIMULATOR: simulator}),
        (False, versions),
        (False, code),
        (False, {f"run.{name}": str(getattr(settings.run, name)) for name in (*LIMITS, *BATCHES)}),
        (False, {f"build of {ads}": build for ads, build in builds.items()}),
        (False, {f"controller of {ads.name}": ads.controller for ads in settings.ads}),
    ]


def _flat(value: Any, path: str) -> Iterator[tuple[str, str]]:
    """Values of nested tables by their dotted names, `method.score.a`."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}.{key}" if path else str(key))
    else:
        yield path, str(value)
