"""Results of `sumo-eval learn`: a page, JSON, sentences, and a campaign file to begin with.

Users: `extras/rates/command.py`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.rates.intervals import kolmogorov_by_chance
from sumo_eval.extras.rates.learned import Learnt, Lesson
from sumo_eval.extras.rates.scenes import SCENES
from sumo_eval.report.page import Json, write_json, write_page
from sumo_eval.report.study_page import (
    Chart,
    Fold,
    Piece,
    Table,
    Text,
    interval,
    table,
    write_parts,
)
from sumo_eval.report.words import count
from sumo_eval.scenario.joint import Joint
from sumo_eval.settings.random_streams import random_stream

_CAMPAIGN = """name = "learned"
seed = 1
budget = 400      # drives of an ADS in a scenario, at most

{}[[ads]]
name = "idm"
controller = "idm"
"""
PAGE, JSON, CAMPAIGN = "learned.html", "learned.json", "campaign.toml"
CURVE_POINTS = 4096  # draws from the model for its curves
BINS = 40  # of each histogram
SUMMARY = (
    "class", "events", "per_vehicle_km", "per_vehicle_km_interval", "fitted", "model",
    "replay_error",
)  # fmt: skip
"""Entries of `_plain_class` that are the columns of the page's first table."""
NOTES = (
    Text(
        "By chance: a sample of as many events, drawn from the fitted distribution itself, has a "
        "larger Kolmogorov distance than this in one of twenty cases. A distance below it gives no "
        "reason to doubt the fit."
    ),
    Text(
        "Rates count every event except ghosts of the tracker, with exact Poisson intervals: "
        "events are assumed to come independently. An event with a vehicle that was on the road "
        "for only a part of it is counted, but has no parameters; they are assumed to be "
        "distributed as the fitted ones."
    ),
    Text(
        "Not covered: other roads, weather and times of day than those recorded; encounters of no "
        "class here; crossing traffic and pedestrians; the sizes of bodies, which are those of a "
        "car in the files; and events rarer than these kilometres show: tails are the model's, not "
        "the data's.",
        "note",
    ),
)


def write_lesson(lesson: Lesson, folder: Path) -> tuple[Path, ...]:
    """Write `learned.html`, `learned.json` and `campaign.toml`; return their paths.

    The campaign is over the learnt scenarios. If there are none, an earlier file is deleted.
    """
    page, data, campaign = (folder / name for name in (PAGE, JSON, CAMPAIGN))
    content = plain(lesson)
    write_json(data, content, "The lesson")
    campaign.unlink(missing_ok=True)
    names = [name for name, learnt in lesson.learnt.items() if learnt.logical is not None]
    if names:
        uses = "".join(f'[[scenario]]\nuse = "{name}.toml"\n\n' for name in names)
        write_page(campaign, _CAMPAIGN.format(uses), "The campaign")
    write_parts(
        page,
        kicker=f"Learnt from {lesson.source}",
        title="Scenarios learnt from recordings",
        sentences=[sentences(lesson)[0], f"Lanes are {lesson.survey.lane_width:.2f} m apart."],
        parts=[*(Text(note, "note") for note in lesson.survey.notes), *parts(lesson, content)],
    )
    return (page, data, campaign) if names else (page, data)


def plain(lesson: Lesson) -> Json:
    """All results in plain values, for `learned.json` and the page."""
    survey = lesson.survey
    return {
        "source": lesson.source,
        "recordings": survey.recordings,
        "vehicles": survey.vehicles,
        "vehicle_km": survey.kilometres,
        "vehicle_hours": survey.hours,
        "speed_quantiles": dict(zip(("5 %", "50 %", "95 %"), survey.speeds, strict=True)),
        "lane_width": survey.lane_width,
        "notes": survey.notes,
        "classes": {name: _plain_class(learnt) for name, learnt in lesson.learnt.items()},
    }


def _plain_class(learnt: Learnt) -> Json:
    """Results of a class in plain values."""
    encounters, joint = learnt.encounters, learnt.joint
    content = {
        "class": encounters.name,
        "events": encounters.events,
        "per_vehicle_km": learnt.rate[0],
        "per_vehicle_km_interval": learnt.rate[1:],
        "ghosts": encounters.ghosts,
        "without_parameters": dict(sorted(encounters.left_out.items())),
        "against_a_constraint": _against(learnt),
        "constants": learnt.constants,
        # every k-th of many events stays
        "left_out_of_the_distribution_evenly": learnt.thinned,
    }
    if learnt.logical is None or joint is None:
        return content | {"file": None, "events_needed": learnt.needed}
    quantiles = np.quantile(joint.events, [0.0, 0.05, 0.5, 0.95, 1.0], axis=0).T.tolist()
    replay = np.quantile(learnt.replay, [0.5, 0.9], axis=0).T.tolist()
    best = learnt.models[0]
    fitted = len(joint.events)
    return content | {
        "file": f"{encounters.name}.toml",
        # together with the intervals below, of all ends and all correlations
        "per_vehicle_km_interval_with_all_below": learnt.rate_together,
        "fitted": fitted,
        "model": best.model,
        "bandwidth": joint.factor,
        "parameters": {
            item.name: {
                "unit": item.unit,
                "low": item.low,
                "high": item.high,
                "recorded_quantiles": recorded,
                "lower_end_interval": learnt.ends[item.name][0],
                "upper_end_interval": learnt.ends[item.name][1],
                "kolmogorov_held_out": best.kolmogorov[item.name],
                "kolmogorov_by_chance": kolmogorov_by_chance(fitted),
            }
            for item, recorded in zip(learnt.logical.parameters, quantiles, strict=True)
        },
        "rank_correlations": [
            {"of": pair, "value": value, "interval": limits}
            for pair, (value, *limits) in learnt.correlations.items()
        ],
        "held_out_log_likelihood": {item.model: item.log_likelihood for item in learnt.models},
        "replay_error": {
            name: dict(zip(("median", "90 %"), values, strict=True))
            for name, values in zip(("along", "across", "together"), replay, strict=True)
        },
    }


def _against(learnt: Learnt) -> int:
    """Number of measured events outside the scenario's ranges or against one of its constraints."""
    return int((~learnt.kept).sum())


def _lacking(learnt: Learnt) -> str:
    """Why those events of a class that have all parameters get no distribution."""
    if len(learnt.encounters.rows) - _against(learnt) < learnt.needed:
        return f"{learnt.needed} are needed"
    return "which do not vary in each parameter on its own"


def sentences(lesson: Lesson) -> list[str]:
    """The results: a line on the recordings, then one on each class."""
    survey = lesson.survey
    lines = [
        f"{count(len(survey.recordings), 'recording')}, {survey.vehicles} motor vehicles, "
        f"{survey.kilometres:.1f} vehicle-km in {survey.hours:.2f} h; 5 to 95 % of speeds "
        f"{interval(survey.speeds[0], survey.speeds[2])} m/s."
    ]
    for name, learnt in lesson.learnt.items():
        rate, low, high = learnt.rate
        events, rows = learnt.encounters.events, learnt.encounters.rows
        if learnt.joint is None:
            against = _against(learnt)
            ruled_out = f" ({against} of them against a constraint)" if against else ""
            result = (
                f"{len(rows)} with all parameters{ruled_out}, {_lacking(learnt)}: no scenario file."
            )
        else:
            best = learnt.models[0]
            fitted = len(learnt.joint.events)
            result = (
                f"{fitted} fitted ({best.model}), held out {best.log_likelihood:z.2f} nats an "
                f"event, Kolmogorov distance at most {max(best.kolmogorov.values()):.3f} (by "
                f"chance {kolmogorov_by_chance(fitted):.3f}), replay error "
                f"{np.median(learnt.replay[:, 2]):.2f} m (median)."
            )
        rates = f"{rate:.3g} ({interval(low, high)}) per vehicle-km"
        lines.append(f"{name}: {count(events, 'event')}, {rates}; {result}")
    return lines


def parts(lesson: Lesson, content: Json) -> list[Piece]:
    """The page, piece by piece.

    content: as made by `plain`.
    """
    classes = content["classes"]
    summary = table({key: each.get(key) for key in SUMMARY} for each in classes.values())
    folds = [
        Fold(name, SCENES[name].about, _class_parts(learnt, classes[name]))
        for name, learnt in lesson.learnt.items()
    ]
    return [summary, *NOTES, *folds]


def _class_parts(learnt: Learnt, content: Json) -> list[Text | Table | Chart]:
    """The results of a class.

    content: as made by `_plain_class`.
    """
    encounters = learnt.encounters
    pieces: list[Text | Table | Chart] = [
        Text(
            f"{count(content['events'], 'event')} ({count(content['ghosts'], 'ghost')} dropped); "
            f"{len(encounters.rows)} with all parameters, {content['against_a_constraint']} of "
            "them against a constraint of the scenario."
        ),
        table(
            {"without parameters because": why, "events": events}
            for why, events in content["without_parameters"].items()
        ),
    ]
    if learnt.joint is None:
        events = f"{count(len(encounters.rows), 'event')} with all parameters"
        pieces.append(Text(f"{events}, {_lacking(learnt)}: no scenario file.", "note"))
    else:
        caption = f"{encounters.name}: recorded and modelled"
        pieces = [Chart(caption, _marginals(learnt.joint)), *pieces, *_fit_parts(learnt, content)]
    # a table without a row is left out
    return [piece for piece in pieces if not isinstance(piece, Table) or piece.rows]


def _fit_parts(learnt: Learnt, content: Json) -> list[Text | Table]:
    """The fit of a class that has a distribution.

    content: as made by `_plain_class`.
    """
    together = interval(*learnt.rate_together)
    texts = [
        f"The intervals of all these ends and correlations and of the rate ({together} per "
        "vehicle-km) hold simultaneously with 95 %, if events do not grow rare towards the ends. "
        "The interval of the rate alone, above, is narrower."
    ]
    if learnt.thinned:
        texts.append(f"{learnt.thinned} events are left out of the distribution, evenly.")
    texts += [
        f"{name} does not vary: {value:g} in the file."
        for name, value in content["constants"].items()
    ]
    models = (
        {"model": item.model, "held-out log-likelihood, nats an event": item.log_likelihood,
         "Kolmogorov distance": item.kolmogorov}
        for item in learnt.models
    )  # fmt: skip
    return [
        table({"parameter": key, **values} for key, values in content["parameters"].items()),
        *(Text(text) for text in texts),
        table(content["rank_correlations"]),
        table(models),
        table(
            {"replay error, m": key, **values} for key, values in content["replay_error"].items()
        ),
    ]


def _marginals(joint: Joint) -> Any:
    """A figure with a panel for each parameter: its recorded histogram, and its density by the
    model.
    """
    drawn = joint.draw(CURVE_POINTS, random_stream(0, "drawn", len(joint.names)))
    recorded = np.array(joint.events)
    panels = []
    for column, name in enumerate(joint.names):
        edges = np.linspace(joint.low[column], joint.high[column], BINS + 1)
        middle = (edges[1:] + edges[:-1]) / 2.0
        data, model = (
            np.histogram(points[:, column], edges, density=True)[0] for points in (recorded, drawn)
        )
        marks = (
            Marks("data", middle, data, COLOURS[0], bars=True),
            Marks("model", middle, model, COLOURS[1], "-"),
        )
        panels.append(Panel(marks, title=name))
    across = min(len(panels), 4)
    rows = -(-len(panels) // across)  # rounded up
    return on_page(panels, across, 240 * rows + 60)  # px: rows and the legend
