"""What was learnt from recordings, as one page, as JSON, in sentences and as the beginning of a
campaign.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.rates.intervals import kolmogorov_by_chance
from sumo_eval.extras.rates.learned import Learnt, Lesson
from sumo_eval.extras.rates.page import (
    Chart,
    Fold,
    Piece,
    Table,
    Text,
    interval,
    table,
    write_parts,
)
from sumo_eval.extras.rates.scenes import SCENES
from sumo_eval.report.page import write_page
from sumo_eval.settings.random_streams import random_stream

PAGE, PLAIN, CAMPAIGN = "learned.html", "learned.json", "campaign.toml"
DRAWN: Final = 4096  # points of the model that its curves are drawn from
BINS: Final = 40


def write_lesson(lesson: Lesson, folder: Path) -> tuple[Path, ...]:
    """Write `learned.html`, `learned.json` and a `campaign.toml` over the learnt scenarios; return
    their paths.

    Where no scenario was learnt there is no campaign, and none of an earlier time stays.
    """
    learnt = any(one.logical is not None for one in lesson.learnt.values())
    write_page(
        folder / PLAIN, json.dumps(plain(lesson), indent=2, allow_nan=False) + "\n", "The lesson"
    )
    (folder / CAMPAIGN).unlink(missing_ok=True)
    if learnt:
        write_page(folder / CAMPAIGN, campaign_text(lesson), "The campaign")
    write_parts(
        folder / PAGE, kicker=f"Learnt from {lesson.source}", title="Scenarios learnt from "
                                                                    "recordings",
        sentences=[sentences(lesson)[0], f"Lanes are {lesson.found.lane_width:.2f} m "
                                         "apart."], parts=parts(lesson),
    )  # fmt: skip
    return (folder / PAGE, folder / PLAIN, *([folder / CAMPAIGN] if learnt else []))


def campaign_text(lesson: Lesson) -> str:
    """A campaign file over every learnt scenario, with a reference driver to begin with."""
    lines = [
        'name = "learned"',
        "seed = 1",
        "budget = 400      # drives of an ADS in a scenario, at most",
        "",
    ]
    for name, learnt in lesson.learnt.items():
        if learnt.logical is not None:
            lines += ["[[scenario]]", f'use = "{name}.toml"', ""]
    lines += ["[[ads]]", 'name = "idm"', 'controller = "idm"', ""]
    return "\n".join(lines)


def plain(lesson: Lesson) -> dict[str, Any]:
    """Everything that was learnt, in plain values."""
    found = lesson.found
    return {
        "source": lesson.source,
        "recordings": list(found.recordings),
        "vehicles": found.vehicles,
        "vehicle_km": found.kilometres,
        "vehicle_hours": found.hours,
        "speed_quantiles": dict(zip(("5 %", "50 %", "95 %"), found.speeds, strict=True)),
        "lane_width": found.lane_width,
        "notes": list(lesson.found.notes),
        "classes": {name: _plain_class(learnt) for name, learnt in lesson.learnt.items()},
    }


def _plain_class(learnt: Learnt) -> dict[str, Any]:
    met = learnt.encounters
    known: dict[str, Any] = {
        "class": met.name,
        "events": met.events,
        "per_vehicle_km": learnt.measured.rate[0],
        "per_vehicle_km_interval": list(learnt.measured.rate[1:]),
        "ghosts": met.ghosts,
        "without_parameters": dict(sorted(met.left_out.items())),
        "against_a_constraint": int((~learnt.measured.kept).sum()),
        "constants": dict(learnt.measured.constants),
        "left_out_of_the_distribution_evenly": learnt.thinned,
    }
    if learnt.logical is None or learnt.joint is None:
        return known | {"file": None, "events_needed": learnt.measured.needed}
    quantiles = np.quantile(np.array(learnt.joint.events), [0.0, 0.05, 0.5, 0.95, 1.0], axis=0)
    replay = np.quantile(learnt.replay, [0.5, 0.9], axis=0)
    best = learnt.models[0]
    return known | {
        "file": f"{met.name}.toml",
        "per_vehicle_km_interval_with_all_below": list(learnt.measured.rate_together),
        "fitted": len(learnt.replay),
        "model": best.model,
        "bandwidth": learnt.joint.factor,
        "parameters": {
            item.name: {
                "unit": item.unit,
                "low": item.low,
                "high": item.high,
                "recorded_quantiles": quantiles[:, j].tolist(),
                "lower_end_interval": list(learnt.measured.ends[item.name][0]),
                "upper_end_interval": list(learnt.measured.ends[item.name][1]),
                "kolmogorov_held_out": best.kolmogorov[item.name],
                "kolmogorov_by_chance": kolmogorov_by_chance(len(learnt.replay)),
            }
            for j, item in enumerate(learnt.logical.parameters)
        },
        "rank_correlations": [
            {"of": list(pair), "value": values[0], "interval": list(values[1:])}
            for pair, values in learnt.measured.correlations.items()
        ],
        "held_out_log_likelihood": {item.model: item.log_likelihood for item in learnt.models},
        "replay_error": {
            "along": {"median": replay[0, 0], "90 %": replay[1, 0]},
            "across": {"median": replay[0, 1], "90 %": replay[1, 1]},
            "together": {"median": replay[0, 2], "90 %": replay[1, 2]},
        },
    }


def sentences(lesson: Lesson) -> list[str]:
    """What was found, a line a class."""
    found = lesson.found
    said = [
        f"{len(found.recordings)} recordings, {found.vehicles} motor vehicles, "
        f"{found.kilometres:.1f} vehicle-km in "
        f"{found.hours:.2f} h; 5 to 95 % of speeds {interval(found.speeds[0], found.speeds[2])} "
        "m/s."
    ]
    for name, learnt in lesson.learnt.items():
        met = learnt.encounters
        rate, low, high = learnt.measured.rate
        line = f"{name}: {met.events} events, {rate:.3g} ({interval(low, high)}) per vehicle-km"
        if learnt.logical is None:
            said.append(
                f"{line}; {len(met.rows)} with all parameters, {learnt.measured.needed} are "
                "needed: no scenario file."
            )
            continue
        best = learnt.models[0]
        said.append(
            f"{line}; {len(learnt.replay)} fitted ({best.model}), held out "
            f"{best.log_likelihood:z.2f} nats an event, "
            f"Kolmogorov distance at most {max(best.kolmogorov.values()):.3f} (by chance "
            f"{kolmogorov_by_chance(len(learnt.replay)):.3f}), replay error "
            f"{float(np.median(learnt.replay[:, 2])):.2f} m (median)."
        )
    return said


SUMMARY: Final = (
    "class", "events", "per_vehicle_km", "per_vehicle_km_interval", "fitted", "model",
    "replay_error",
)  # fmt: skip
"""Entries of a class that stand on the page side by side with those of the other classes."""


def parts(lesson: Lesson) -> list[Piece]:
    """The page, piece by piece."""
    classes = plain(lesson)["classes"]
    out: list[Piece] = [
        *(Text(note, "note") for note in lesson.found.notes),
        table({name: known.get(name) for name in SUMMARY} for known in classes.values()),
        Text("By chance: what as many events exceed in one case of twenty though the distribution "
             "is their own. Below "
             "it, the events do not tell whether the distribution is another."),
        Text("Rates count every event that is no ghost of the tracker, with exact Poisson "
             "intervals: events are taken "
             "to come independently. Who was on the road for only a part of an event is counted, "
             "but has no "
             "parameters; the fitted ones are taken to stand for them."),
        Text("What is outside: other roads, weather and times of day than those recorded; "
             "encounters of no class here; "
             "crossing traffic and people on foot; the sizes of bodies, which are those of a car "
             "in the files; and "
             "whatever is rarer than these kilometres show: tails are the model's, not the "
             "data's.", "note"),
    ]  # fmt: skip
    for name, learnt in lesson.learnt.items():
        charts = (
            []
            if learnt.joint is None
            else [Chart(f"{name}: recorded and modelled", _marginals(learnt))]
        )
        out.append(Fold(name, SCENES[name].about, (*charts, *_class_parts(learnt, classes[name]))))
    return out


def _class_parts(learnt: Learnt, known: Mapping[str, Any]) -> list[Text | Table]:
    """What is known of a class, without its chart."""
    met = learnt.encounters
    out: list[Text | Table] = [
        Text(f"{met.events} events ({met.ghosts} ghosts dropped); {len(met.rows)} with all "
             "parameters, "
             f"{known['against_a_constraint']} of them against a constraint of the scenario.")
    ]  # fmt: skip
    without = known["without_parameters"]
    if without:
        out.append(
            table(
                {"without parameters because": why, "events": count}
                for why, count in without.items()
            )
        )
    if learnt.logical is None:
        return [
            *out,
            Text(
                f"{known['events_needed']} events with all parameters are needed: no scenario "
                "file.",
                "note",
            ),
        ]
    out += [
        table({"parameter": name, **values} for name, values in known["parameters"].items()),
        Text(
            "All intervals of these ends and correlations, and one of the rate, "
            f"{interval(*learnt.measured.rate_together)} per vehicle-km, hold at once with 95 %, "
            "where events do not "
            "grow rare towards the ends. By itself the rate has the narrower one above."
        ),
    ]
    if learnt.thinned:
        out.append(Text(f"{learnt.thinned} events are left out of the distribution, evenly."))
    out += [
        Text(f"{name} does not vary: {value:g} in the file.")
        for name, value in known["constants"].items()
    ]
    return [
        *out,
        *([table(known["rank_correlations"])] if known["rank_correlations"] else []),
        table(
            {"model": item.model, "held-out log-likelihood, nats an event": item.log_likelihood,
             "Kolmogorov distance": item.kolmogorov}
            for item in learnt.models
        ),
        table({"replay error, m": what, **values} for what,
            values in known["replay_error"].items()),
    ]  # fmt: skip


def _marginals(learnt: Learnt) -> Any:
    """Each parameter as recorded, and as the model has it."""
    joint = learnt.joint
    assert joint is not None
    points = joint.draw(DRAWN, random_stream(0, "drawn", len(joint.names)))
    panels = []
    for j, name in enumerate(joint.names):
        edges = np.linspace(joint.low[j], joint.high[j], BINS + 1)
        data, model = (
            np.histogram(values[:, j], edges, density=True)[0]
            for values in (np.array(joint.events), points)
        )
        middle = (edges[1:] + edges[:-1]) / 2.0
        marks = (
            Marks("data", middle, data, COLOURS[0], bars=True),
            Marks("model", middle, model, COLOURS[1], "-"),
        )
        panels.append(Panel(marks, title=name))
    across = min(len(panels), 4)
    return on_page(panels, across, 240 * -(-len(panels) // across) + 60)
