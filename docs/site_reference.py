"""Reference pages that the site makes from the code: scenarios, settings, commands, elements of
OpenSCENARIO.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, get_args, get_origin

ROOT = Path(__file__).resolve().parents[1]
FILES = ROOT / "sumo_eval" / "scenario" / "files"
FAMILIES = ROOT / "docs" / "scenarios"


def scenario_families() -> dict[str, str]:
    """Family page of each scenario, by the headings of docs/scenarios."""
    return {
        name: page.name
        for page in sorted(FAMILIES.glob("*.md"))
        for name in re.findall(r"^## (\w+)$", page.read_text(encoding="utf-8"), flags=re.M)
        if (FILES / f"{name}.toml").is_file()
    }


def scenario_index() -> str:
    """Table of all scenarios with their first sentence, family by family."""
    rows = ["", "| scenario | about |", "|---|---|"]
    for name, page in sorted(scenario_families().items(), key=lambda item: (item[1], item[0])):
        rows.append(f"| [{name}]({page}#{name}) | {_content(name)['about']} |")
    return "\n".join([*rows, ""])


def with_scenarios(text: str) -> str:
    """A family page with each scenario's facts under its heading."""
    return re.sub(
        r"^## (\w+)$",
        lambda found: (
            f"{found[0]}\n\n{scenario(found[1])}"
            if (FILES / f"{found[1]}.toml").is_file()
            else found[0]
        ),
        text,
        flags=re.M,
    )


def scenario(name: str) -> str:
    """Picture, parameters, conditions, options, samples, road and source of a scenario, from its
    file.
    """
    content = _content(name)
    about = content["about"]
    text = [about, "", f"![{about}](../pictures/moving/{name}.svg)", ""]
    text += ["| parameter | range | step | meaning |", "|---|---|---|---|"]
    text += [
        f"| `{one['name']}` | {_range(one)} | {_number(one.get('step', ''))} | "
        f"{_cell(one.get('about', ''))} |"
        for one in content["parameter"]
    ]
    text.append("")
    text += [f"- Condition: {_condition(one)}." for one in content.get("constraint", ())]
    for one in content.get("option", ()):
        default = f" (default {_number(one['default'])})" if "default" in one else ""
        text.append(f"- Option `{one['name']}`, {one.get('unit', '')}{default}: {one['about']}.")
    samples = content.get("sample", ())
    text += [
        f'- `method = "{one["name"]}"`: {one.get("about", "prescribed points")}.' for one in samples
    ]
    text += [f"- Road: {road(content)}", f"- Source: {content.get('source', 'none')}", ""]
    return "\n".join(text)


def _condition(constraint: dict[str, Any]) -> str:
    about = constraint.get("about", "")
    return about if about.startswith("one ") else f"`{constraint['require']}`"


def road(content: dict[str, Any]) -> str:
    """Road and end of a scenario in a sentence."""
    found = content["road"]
    words = [f"{found['lanes']} lanes of {_number(found.get('lane_width', 3.5))} m"]
    words += [_changing(lane, found["lanes"]) for lane in found.get("lane", ())]
    words += ["a curve of radius `radius`" for line in found.get("line", ()) if "radius" in line]
    crossings = found.get("crossing", ())
    words += [
        f"a road of {_number(one['width'])} m crosses at x = {_number(one['x'])} m"
        for one in crossings
    ]
    end = content.get("end", {})
    ends = f"The case ends at x = {_number(end.get('x', 600.0))} m"
    return (
        "; ".join(words)
        + f". {ends}"
        + (f", or after {_number(end['time'])} s." if "time" in end else ".")
    )


def _changing(lane: dict[str, Any], lanes: int) -> str:
    where = (
        "the right one"
        if lane["lane"] == 0
        else "the left one"
        if lane["lane"] == lanes - 1
        else "one"
    )
    said = []
    if "ramp_until" in lane:
        said.append(f"is an on-ramp until x = {_number(lane['ramp_until'])} m")
    if "begin" in lane:
        said.append(
            f"opens from {_number(lane['begin'] - lane['taper'])} to {_number(lane['begin'])} m"
        )
    if "ramp_from" in lane:
        said.append(f"is an exit ramp from {_number(lane['ramp_from'])} m on")
    if "end" in lane:
        said.append(
            f"narrows from {_number(lane['end'])} to {_number(lane['end'] + lane['taper'])} m"
        )
    return f"{where} {', '.join(said)}"


def _content(name: str) -> dict[str, Any]:
    return tomllib.loads((FILES / f"{name}.toml").read_text(encoding="utf-8"))


def _range(parameter: dict[str, Any]) -> str:
    """The values of a parameter: a list, or the ends of a range, and the unit."""
    if "values" in parameter:
        said = ", ".join(_number(value) for value in parameter["values"])
    else:
        said = f"{_number(parameter['low'])} to {_number(parameter['high'])}"
    return f"{said} {parameter.get('unit', '').removesuffix('1')}".rstrip()


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# --- settings -------------------------------------------------------------------------------------


def settings_reference() -> str:
    """Every setting of an evaluation file, table by table, with default, unit and equation."""
    from sumo_eval.settings import EvaluationSettings

    return "\n".join(_settings_of(EvaluationSettings, "##"))


def scenario_file_reference() -> str:
    """Every key of a scenario file, table by table, with default and unit."""
    from sumo_eval.scenario.file_tables import ScenarioFile

    return "\n".join(("", *_settings_of(ScenarioFile, "###")))


def _settings_of(root: Any, level: str) -> Iterator[str]:
    """Tables of a class of settings and of those in it, each class once."""
    from sumo_eval.settings import about

    left, seen = [(root, "")], {root}
    while left:
        owner, table = left.pop(0)
        yield from ("", f"{level} {table or 'The file itself'}", "", _paragraph(owner), "")
        yield from ("| key | default | unit | meaning |", "|---|---|---|---|")
        hints = _plain_hints(owner)
        for field in dataclasses.fields(owner):
            hint = hints[field.name]
            inner = _dataclass_in(hint)
            if inner is None:
                found = about(owner, field.name)
                choices = f": {_choices(hint)}" if _choices(hint) else ""
                equation = f" (Eq. {found.equation})" if found.equation else ""
                symbol = f" {found.symbol}" if found.symbol else ""
                words = _cell(found.text + choices + equation)
                yield f"| `{field.name}`{symbol} | {_default(field)} | {found.unit} | {words} |"
            elif inner not in seen:
                seen.add(inner)
                base = table.strip("[]")
                name = f"{base}.{field.name}" if base else field.name
                left.append((inner, f"[[{name}]]" if "tuple[" in str(hint) else f"[{name}]"))


def _plain_hints(owner: Any) -> dict[str, Any]:
    from typing import get_type_hints

    return get_type_hints(owner)


def _dataclass_in(hint: Any) -> Any:
    inner = (hint, *get_args(hint), *(more for one in get_args(hint) for more in get_args(one)))
    return next((one for one in inner if dataclasses.is_dataclass(one)), None)


def _choices(hint: Any) -> str:
    from typing import Literal

    for one in (hint, *get_args(hint)):
        if get_origin(one) is Literal:
            return ", ".join(f"`{value}`" for value in get_args(one))
    return ""


def _default(field: Any) -> str:
    if field.default is not dataclasses.MISSING:
        value = field.default
    elif field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    else:
        return "required"
    if value in (None, "", ()) or value == {}:
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{_number(value)}`"


def _paragraph(owner: Any) -> str:
    return " ".join((owner.__doc__ or "").split("\n\n")[0].split())


# --- commands -------------------------------------------------------------------------------------


def command_reference() -> str:
    """Every command with its arguments, options and exit statuses, as `--help` has them."""
    import click

    from sumo_eval.cli import TASKS, commands, main

    context = click.Context(main, info_name="sumo-eval")
    ours = {name for names in TASKS.values() for name in names}
    text = []
    for task, names in {**TASKS, "From other packages": tuple(set(commands()) - ours)}.items():
        known = [name for name in names if name in commands()]
        text += ["", f"## {task}"] if known else []
        for name in known:
            text += _command(main.get_command(context, name), f"sumo-eval {name}")
    return "\n".join(text)


def _command(command: Any, name: str) -> Iterator[str]:
    import click

    given = [one for one in command.params if one.param_type_name == "argument"]
    arguments = " ".join(one.make_metavar(click.Context(command)) for one in given)
    yield from ("", f"### {name}", "", f"`{name} {arguments}`".replace(" `", "`"), "")
    yield " ".join((command.help or "").replace("\b", "").split())
    options = [one for one in command.params if one.param_type_name == "option" and not one.hidden]
    if options:
        yield from ("", "| option | meaning |", "|---|---|")
        for one in options:
            spelled = ", ".join(f"`{word}`" for word in (*one.opts, *one.secondary_opts))
            default = (
                one.default
                if isinstance(one.default, int | float | str) and not one.is_flag
                else None
            )
            shown = (
                f" (default {default})"
                if default not in (None, "") and "default" not in (one.help or "")
                else ""
            )
            yield f"| {spelled} | {_cell(one.help or '')}{shown} |"
    if isinstance(command, click.Group):
        for inner in sorted(command.commands):
            yield from _command(command.commands[inner], f"{name} {inner}")


def openscenario_elements() -> str:
    """The elements of OpenSCENARIO and how each is treated."""
    from sumo_eval.extras.openscenario.conformity import table

    return table()


GENERATED: Final[dict[str, Callable[[], str]]] = {
    "scenarios/index.md": scenario_index,
    "reference/settings.md": settings_reference,
    "reference/scenario_file.md": scenario_file_reference,
    "reference/commands.md": command_reference,
    "reference/openscenario.md": openscenario_elements,
}
"""Text that the site adds at the end of a page, by page."""
