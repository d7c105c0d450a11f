"""Whom plausibility is judged by: people on a motorway, or the recorded drivers of the run."""

import numpy as np
import pytest

from sumo_eval.method.plausibility import LEAST_PEOPLE, MOTORWAY_PEOPLE
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.store import RECORDED, open_store
from sumo_eval.report.words import score_note
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.settings import PlausibilitySettings
from sumo_eval.trajectory import Recording, Trajectory

LOGICAL = catalogue.load("front_vehicle_low_speed")
RECORDED_TABLE = PlausibilitySettings(table="recorded")


def people(path, count, settings):
    """Person i follows for 20 s, (1 + i / 10) s behind a lead of 10 m/s that started 3.5 * 20 = 70
    m ahead."""
    concrete = LOGICAL.concrete(ego_speed=20.0, lead_speed=10.0)
    time = np.arange(201) / 10.0
    (lead,) = concrete.actors
    with open_store(path, create=True) as store:
        for index in range(count):
            gap = 10.0 * (1.0 + index / 10.0)
            x = np.array([lead.x(t) for t in time]) - 0.5 * (lead.length + 4.5) - gap
            add(store, concrete, index, Trajectory(time, x, 0.0 * x, speed=0.0 * x + 10.0))
        return plausible_people(LOGICAL, store, settings)


def add(store, concrete, index, drive):
    case = Case(0, concrete, "human", f"recorded_{index:02d}", RECORDED)
    store.add(Outcome(case, "ok", Recording(drive, {}, None, "recorded"), log=f"person {index}"))


def test_the_default_is_the_people_of_the_motorway_and_says_nothing(tmp_path):
    found = people(tmp_path / "facts.sqlite", 3, PlausibilitySettings())
    assert (found.people, found.notes) == (MOTORWAY_PEOPLE, ())


def test_the_recorded_drivers_of_the_run_are_measured_among_its_other_vehicles(tmp_path):
    found = people(tmp_path / "facts.sqlite", 40, RECORDED_TABLE)
    assert tuple(map(score_note, found.notes)) == (
        "Plausibility compares with 40 recorded drivers of the run (40 drives).",
    )
    assert (found.people.people, found.people.drives) == (40, 40)
    assert found.people.values["min_thw"][0] == pytest.approx(1.0, abs=0.01)
    # ten of forty: 1.0 to 1.9 s
    assert found.people.share("min_thw", 1.9) == pytest.approx(0.25, abs=0.01)
    assert found.people.share("min_thw", 0.5) == 0.0


def test_people_meet_an_actor_where_it_crosses(tmp_path):
    """At 10 m/s over x = 300 m at y = 0 after 5.315 s, 4.5 m x 1.8 m: in a 1.8 m wide way until 5.6
    s. The nearest front, at 290 + 5.6 + 2.25 m, is then 1.25 m away, at 1 m/s."""
    logical, time = catalogue.load("crossing_path"), np.arange(61) / 10.0
    concrete = logical.concrete(ego_speed=14.0, other_speed=10.0, arrival=1.0)
    with open_store(tmp_path / "facts.sqlite", create=True) as store:
        for index in range(LEAST_PEOPLE):
            add(store, concrete, index, Trajectory(time, 290.0 - index + time, 0.0 * time))
        found = plausible_people(logical, store, RECORDED_TABLE).people
    assert found.values["min_ttc"][0] == pytest.approx(1.25)


def test_too_few_recorded_drivers_give_no_table_and_a_note(tmp_path):
    found = people(tmp_path / "facts.sqlite", LEAST_PEOPLE - 1, RECORDED_TABLE)
    assert found.people is MOTORWAY_PEOPLE
    assert tuple(map(score_note, found.notes)) == (
        "Plausibility compares with 213 people on a motorway: the run has 19 recorded drivers in "
        "`front_vehicle_low_speed`, and a table needs 20.",
    )
