"""Settings files (evaluation, suite, gate, campaign, study, features, scenario) to frozen settings;
an evaluation's also back to TOML.

Every mistake is named, with its path and the nearest known key.

Users: `cli/`, `cosim/`, `evaluation.py`, `nightly/`, `record/`, `report/`, `scenario/`, `scoring/`,
`extras/`.
"""

import functools
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import tomli_w
from pydantic import TypeAdapter, ValidationError

from sumo_eval.errors import InputError, check_known, did_you_mean, nearest
from sumo_eval.groups import grouped
from sumo_eval.input_file import read_input_text
from sumo_eval.settings import Checked, EvaluationSettings, ScenarioSettings
from sumo_eval.settings.toml_file import line_of, read_toml, toml_from
from sumo_eval.text import shown

PAPER_EVALUATION = Path(__file__).with_name("paper_evaluation.toml")

SUITES = Path(__file__).with_name("suites")
"""Frozen lists of scenarios, samples, drivers and seed, a file each."""
_SUITE = "suite:"  # begins `use` of a [[scenario]] that stands for a suite
_FIXED = ("seed", "drivers", "simulation", "method")
"""Settings of an evaluation that a suite fixes together with the scenarios."""

Settings = TypeVar("Settings", bound=Checked)


def read_evaluation(path: Path, *, own_ads: bool = True) -> EvaluationSettings:
    """The settings in an evaluation file; of an OpenSCENARIO file, the paper's evaluation with this
    scenario.

    Raises InputError naming every mistake in it.

    own_ads: whether the file must have `[[ads]]`; False where the caller names ADSs instead.
    """
    if path.suffix == ".xosc":
        return replace(
            read_evaluation(PAPER_EVALUATION),
            name=path.stem,
            scenario=(ScenarioSettings(path.name),),
        )
    return settings_from(read_toml(path, "evaluation file"), path, own_ads=own_ads)


def with_suites(content: Mapping[str, Any], where: object) -> Mapping[str, Any]:
    """An evaluation with the scenarios of a frozen suite instead of `use = "suite:NAME"`.

    A suite stands alone and brings its own seed and drivers, so that every score of it means the
    same.

    Raises InputError for a suite that does not exist, and for what would change one.
    """
    entries = content.get("scenario")
    if not isinstance(entries, list | tuple):  # a mistake that `validated` reports
        return content
    uses = [str(entry.get("use", "")) for entry in entries if isinstance(entry, Mapping)]
    names = [use.removeprefix(_SUITE) for use in uses if use.startswith(_SUITE)]
    if not names:
        return content
    check_known("suite", sorted(path.stem for path in SUITES.glob("*.toml")), names[0])
    if len(uses) > 1 or len(entries[0]) > 1:
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
    """The suite whose scenarios and fixed settings an evaluation has; "" if it has no suite's."""
    for path in sorted(SUITES.glob("*.toml")):
        content = {"name": settings.name, "scenario": [{"use": f"{_SUITE}{path.stem}"}]}
        suite = settings_from(content, path.stem, own_ads=False)
        if all(getattr(settings, part) == getattr(suite, part) for part in ("scenario", *_FIXED)):
            return path.stem
    return ""


def read_checked(path: Path, kind: type[Settings], what: str) -> Settings:
    """The settings in a file of another kind.

    what: names the kind in errors, e.g. `gate file`.
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
    """
    adapter: TypeAdapter[Settings] = _adapter(kind)
    try:
        return adapter.validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        raise InputError(mistakes(error, where, kind)) from None


_adapter: Any = functools.cache(TypeAdapter)  # one for all settings takes 0.1 s to make


def check_evaluation(settings: EvaluationSettings, where: object, *, own_ads: bool = True) -> None:
    """Refuse an evaluation without scenarios or ADSs, and names that could not be told apart.

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
        double = sorted(name for name, number in Counter(names).items() if number > 1)
        if double:
            raise InputError(
                f"{what} in {where} must differ from each other, got {double[0]!r} twice."
            )


def with_changes(settings: EvaluationSettings, changes: Sequence[str]) -> EvaluationSettings:
    """Settings with `key.path=value` changes applied, e.g. `method.score.a=60`."""
    content = to_plain(settings)
    for change in changes:
        path, equals, text = change.partition("=")
        if not equals:
            raise InputError(
                f"--set must have the form KEY=VALUE, e.g. method.score.a=60, got {change!r}."
            )
        try:
            value = toml_from(f"value = {text}", f"`--set {shown(change)}`")["value"]
        except InputError:  # `--set report.reference=mine`: text needs no quotes
            value = text
        *parents, last = path.strip().split(".")
        place: Any = content
        for index, name in enumerate(parents):
            table = place if isinstance(place, dict) else {}
            if name not in table:
                raise InputError(
                    f"Unknown setting `{'.'.join(parents[: index + 1])}`."
                    f"{did_you_mean(name, table)}"
                )
            place = table[name]
        if not isinstance(place, dict):
            raise InputError(f"Unknown setting `{path.strip()}`.")
        place[last] = value
    return settings_from(content, "--set")


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


def mistakes(error: ValidationError, where: str | Path, root: type) -> str:
    """All mistakes that pydantic found, one sentence a line.

    Of a value that may be of several kinds pydantic has a finding for each kind: they are one
    mistake. A finding inside a table or list replaces the finding on all of it.

    where: as in `validated`.
    root: settings class that was read.
    """
    text = read_input_text(where, "file") if isinstance(where, Path) else ""
    findings = grouped((_place(item), item) for item in error.errors())
    return "\n".join(
        _sentence(items, where, root, line_of(text, place))
        for place, items in findings.items()
        # unless another finding is inside this place
        if not any(other != place and other[: len(place)] == place for other in findings)
    )


_BRANCH = re.compile(r"(constrained-)?int|float|str|dict\[.*\]|literal\[.*|[A-Z].*Table", re.DOTALL)
"""Parts that pydantic adds to the place of a finding, to say which of several kinds it tried."""


def _place(item: Any) -> tuple[Any, ...]:
    """Keys and indices that lead to the value of a finding."""
    return tuple(part for part in item["loc"] if not _BRANCH.fullmatch(str(part)))


def _sentence(items: Sequence[Any], where: object, root: type, line: int | None) -> str:
    """Error message for pydantic's findings at one place."""
    item = items[0]
    location = _place(item)
    if line is not None:
        where = f"{where} (line {line})"
    path = "".join(
        f"[{part}]" if isinstance(part, int) else f".{part}" for part in location
    ).removeprefix(".")
    if item["type"] == "unexpected_keyword_argument":
        return (
            f"Unknown key `{path}` in "
            f"{where}.{did_you_mean(str(location[-1]), _keys_beside(location, root))}"
        )
    if item["type"] == "missing":
        return f"`{path}` in {where} is missing."
    if item["type"] == "string_too_short":
        return f"`{path}` in {where} must not be empty."
    if item["type"] == "value_error":
        place = f"`{path}` in " if path else ""
        return f"{place}{where}: {item['ctx']['error']}"
    # `path` without indices, as the heading of a table
    table, value = re.sub(r"\[\d+\]", "", path), item["input"]
    if item["type"] in {"tuple_type", "list_type"} and isinstance(value, dict):
        return (
            f"`{table}` in {where} must be a list of tables: write [[{table}]], with two "
            f"brackets, not [{table}]."
        )
    # an entry of a list of tables, `ads[0]`, has no brackets to be corrected
    if item["type"] == "dataclass_type" and isinstance(value, list) and not path.endswith("]"):
        return (
            f"`{table}` in {where} must be one table: write [{table}], with one bracket, not "
            f"[[{table}]]."
        )
    message = " or ".join(dict.fromkeys(map(_demand, items)))
    allowed = [
        name
        for finding in items
        if finding["type"] == "literal_error"
        for name in re.findall(r"'([^']*)'", finding["ctx"]["expected"])
    ]
    near = nearest(value, allowed) if isinstance(value, str) else None
    hint = "" if near is None else f" Did you mean `{near}`?"
    return f"`{path}` in {where} must be {message}, got {shown(value)}.{hint}"


def _demand(item: Any) -> str:
    """The demand on a value, from one of pydantic's findings, in the words of `Checked`."""
    if item["type"] in _DEMANDS:
        return _DEMANDS[item["type"]].format(**item.get("ctx", {}))
    return str(item["msg"]).removeprefix("Input should be ")


_DEMANDS = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "float_type": "a number",
    "dict_type": "a table",
    "list_type": "a list",
    "tuple_type": "a list",
    "dataclass_type": "a table",
    "string_type": "a text",
    "bool_type": "true or false",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
}
"""Pydantic's demands in the words of `Checked`; other demands keep pydantic's words."""


def _keys_beside(location: Sequence[Any], root: type) -> list[str]:
    """Keys of the table that the last part of a path is in."""
    owner: Any = root
    for part in location[:-1]:
        if isinstance(part, str) and owner is not None:
            owner = _settings_class_in(get_type_hints(owner).get(part))
    return [item.name for item in fields(owner)] if owner is not None else []


def _settings_class_in(annotation: Any) -> Any:
    """The settings class that an annotation holds, e.g. RunSettings or tuple[AdsSettings, ...];
    None without one.
    """
    if isinstance(annotation, type) and issubclass(annotation, Checked):
        return annotation
    return next(filter(None, map(_settings_class_in, get_args(annotation))), None)
