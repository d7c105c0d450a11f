"""Settings files (evaluation, suite, gate, campaign, study, features, scenario) to frozen settings;
evaluations and features also back to TOML.

Every wrong value is named, with its path and the nearest known key. What is wrong with several
values together is named next, one mistake at a time.

Users: `cli/`, `cosim/`, `evaluation.py`, `nightly/`, `record/`, `report/`, `scenario/`, `scoring/`,
`extras/`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from sumo_eval.errors import InputError, check_known, did_you_mean, doubled, said
from sumo_eval.input_file import read_input_text
from sumo_eval.settings import Checked, EvaluationSettings, ScenarioSettings
from sumo_eval.settings.checked import Mistake, read_table
from sumo_eval.settings.toml_file import line_of, read_toml, toml_from
from sumo_eval.text import clean, shown

PAPER_EVALUATION = Path(__file__).with_name("paper_evaluation.toml")

SUITES = Path(__file__).with_name("suites")
"""Frozen lists of scenarios, with the settings of `_FIXED`, a file each."""
_SUITE = "suite:"  # begins `use` of a [[scenario]] that stands for a suite
_FIXED = ("seed", "drivers", "simulation", "method")
"""Settings of an evaluation that a suite fixes together with the scenarios."""

Settings = TypeVar("Settings", bound=Checked)


def read_evaluation(path: Path, *, own_ads: bool = True) -> EvaluationSettings:
    """The settings in an evaluation file; of an OpenSCENARIO file, the paper's evaluation with this
    scenario.

    Raises InputError naming the mistakes in it.

    own_ads: whether the file must have `[[ads]]`; False where the caller names ADSs instead.
    """
    if path.suffix == ".xosc":
        return replace(
            read_evaluation(PAPER_EVALUATION),
            name=path.stem,
            # its folder is the source folder of the run (`record/facts.py`)
            scenario=(ScenarioSettings(path.name),),
        )
    content = read_toml(path, "evaluation file")
    if "parameter" in content:
        raise InputError(
            f'{path} is a scenario file: name it in an evaluation, `use = "{path.name}"` in '
            "[[scenario]]."
        )
    return settings_from(content, path, own_ads=own_ads)


def with_suites(content: Mapping[str, Any], where: object) -> Mapping[str, Any]:
    """An evaluation with the scenarios of a frozen suite instead of `use = "suite:NAME"`.

    A suite must be the only scenario of the evaluation, and brings the settings of `_FIXED`, so
    that scores of different evaluations of it can be compared.

    Raises InputError for an unknown suite, for one that is not alone, and for a setting that would
    change it.
    """
    entries = content.get("scenario")
    if not isinstance(entries, list | tuple):  # a mistake that `validated` reports
        return content
    uses = [str(entry.get("use", "")) for entry in entries if isinstance(entry, Mapping)]
    names = [use.removeprefix(_SUITE) for use in uses if use.startswith(_SUITE)]
    if not names:
        return content
    check_known("suite", sorted(path.stem for path in SUITES.glob("*.toml")), names[0])
    if len(entries) > 1 or len(entries[0]) > 1:
        raise InputError(
            f"The suite `{names[0]}` in {where} stands alone: one [[scenario]] with nothing but "
            "`use`."
        )
    suite = read_toml(SUITES / f"{names[0]}.toml", "suite")
    changed = [name for name in _FIXED if name in content and content[name] != suite.get(name)]
    if changed:
        raise InputError(
            f"`{changed[0]}` in {where} is fixed by the suite `{names[0]}`; leave it out."
        )
    return {**content, **suite}


def suite_of(settings: EvaluationSettings) -> str:
    """The suite whose scenarios and fixed settings an evaluation has; "" if there is none."""
    for path in sorted(SUITES.glob("*.toml")):
        content = {"name": settings.name, "scenario": [{"use": f"{_SUITE}{path.stem}"}]}
        suite = settings_from(content, path.stem, own_ads=False)
        if all(getattr(settings, part) == getattr(suite, part) for part in ("scenario", *_FIXED)):
            return path.stem
    return ""


def read_checked(path: Path, kind: type[Settings], what: str) -> Settings:
    """The settings in a file of a kind other than an evaluation.

    kind: class of the settings.
    what: names the file in errors, e.g. `gate file`.
    """
    return validated(read_toml(path, what), kind, path)


def settings_from(
    content: Mapping[str, Any], where: str | Path, *, own_ads: bool = True
) -> EvaluationSettings:
    """Settings of an evaluation from a plain mapping.

    where: as in `validated`.
    own_ads: as in `read_evaluation`.
    """
    settings = validated(with_suites(content, where), EvaluationSettings, where)
    check_evaluation(settings, where, own_ads=own_ads)
    return settings


def validated(content: Mapping[str, Any], kind: type[Settings], where: str | Path) -> Settings:
    """Settings of a kind.

    where: names the content in errors; a path gives them its lines, too.

    Raises InputError that names every mistake, a line each.
    """
    try:  # as JSON has it: dates and paths become texts, and tuples lists
        text = json.dumps(content, default=_json_form, ensure_ascii=False)
        plain = json.loads(text.encode())  # fails for half of a surrogate pair
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(
            f"Keys and values in {where} must be texts, numbers, lists and tables: {said(error)}."
        ) from None
    mistakes: list[Mistake] = []
    settings: Settings = read_table(plain, kind, (), mistakes)
    if not mistakes:
        return settings
    text = read_input_text(where, "file") if isinstance(where, Path) else ""
    sentences = []
    for mistake in mistakes:
        line = line_of(text, mistake.place)
        sentences.append(mistake.sentence(f"in {where}{f' (line {line})' if line else ''}"))
    raise InputError("\n".join(sentences))


def _json_form(value: Any) -> Any:
    """A value that JSON does not have: numbers and arrays of numpy as Python's, others as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def check_evaluation(settings: EvaluationSettings, where: object, *, own_ads: bool = True) -> None:
    """Refuse an evaluation without scenarios or ADSs, and names that are reserved or stand twice.

    where: names the evaluation in errors.
    own_ads: as in `read_evaluation`.
    """
    if not settings.scenario:
        raise InputError(f"{where} must have at least one [[scenario]].")
    if own_ads and not settings.ads:
        raise InputError(f"{where} must have at least one [[ads]], or be run with `--ads LOCATOR`.")
    for what, names in (
        ("`scenario.use`", [scenario.use for scenario in settings.scenario]),
        ("`ads.name`", [ads.name for ads in settings.ads]),
    ):
        if any(name.startswith("~") for name in names):
            raise InputError(
                f"{what} in {where} must not begin with `~`, which marks the ideal vehicle and "
                "the drivers."
            )
        if double := doubled(names):
            # ADSs that Python code gives are named by their class or function
            how = ' Name each in the evaluation, a dict: `"ads": [{"name": "a", "controller": A}]`.'
            raise InputError(
                f"{what} in {where} must differ from each other, got {double[0]!r} twice."
                f"{how if where == '`ads`' else ''}"
            )


def with_changes(settings: EvaluationSettings, changes: Sequence[str]) -> EvaluationSettings:
    """Settings with `key.path=value` changes applied, e.g. `method.score.a=60`."""
    if double := doubled(change.partition("=")[0].strip() for change in changes):
        raise InputError(f"--set must give a key one value, got `{clean(double[0])}` twice.")
    content = asdict(settings)
    for change in changes:
        path, equals, text = change.partition("=")
        if not equals:
            raise InputError(
                f"--set must have the form KEY=VALUE, e.g. method.score.a=60, got {change!r}."
            )
        try:
            (value,) = toml_from(f"value = {text}", f"`--set {shown(change)}`").values()
        # `--set report.reference=mine`: text needs no quotes; nor is it TOML of several keys
        except ValueError:
            value = text
        *tables, key = path.strip().split(".")
        _table_at(content, tables, path.strip())[key] = value
    return settings_from(content, "--set")


def _table_at(content: dict[str, Any], names: Sequence[str], path: str) -> dict[str, Any]:
    """The table of plain settings that names lead to, one in the other.

    path: of the key that is sought in it, for errors.
    """
    table: Any = content
    for index, name in enumerate(names):
        known = table if isinstance(table, dict) else {}
        if name not in known:
            raise InputError(
                f"Unknown setting `{'.'.join(names[: index + 1])}`.{did_you_mean(name, known)}"
            )
        if known[name] is None:  # a table that may be missing
            known[name] = {}
        table = known[name]
    if not isinstance(table, dict):
        raise InputError(f"Unknown setting `{path}`.")
    return table


def to_plain(settings: EvaluationSettings) -> dict[str, Any]:
    """Settings as nested dicts and lists, unset values left out."""
    return dict(_without_none(asdict(settings)))


def to_toml(settings: EvaluationSettings) -> str:
    """Settings as TOML text, every default written out."""
    return tomli_w.dumps(to_plain(settings))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
