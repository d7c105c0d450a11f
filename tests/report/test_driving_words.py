"""What one case looks like in driving words: worked scenes, each with its quantity, people and
time."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import LOW_SPEED
from scipy.integrate import cumulative_trapezoid

from sumo_eval import Trajectory
from sumo_eval.method.measures import smooth_motion
from sumo_eval.method.plausibility import EXTREMES, MOTORWAY_PEOPLE
from sumo_eval.report import driving_words as words
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import Way
from sumo_eval.scoring.drive_beside import HALF_WINDOWS, CaseDrives, braking_before

FINE = {
    "length_factor": 1.0,
    "operation_tolerance": 1.0,
    "mixture_similarity": 1.0,
    "plausibility": 1.0,
}


def drive(speeds, seconds=10.0, x=50.0, y=0.0):
    """A drive with speeds, m/s, at times, s, linear between them; or with one speed."""
    time = np.arange(0.0, seconds + 0.05, 0.1)
    speed = np.interp(time, *np.transpose(speeds if np.ndim(speeds) else [(0, speeds)]))
    along = x + cumulative_trapezoid(speed, dx=0.1, initial=0.0)
    return Trajectory(time, along, np.full(time.size, y), speed=speed)


@pytest.fixture
def case(evaluation):
    safe = next(one for one in evaluation.cases if one.zone == "safe" and not one.incident)
    return replace(safe, scenario=LOW_SPEED, values={"ego_speed": 20.0, "lead_speed": 5.0}, **FINE)


def scene(case, ego, *drivers, **actors):
    return CaseDrives(
        case,
        ego,
        actors,
        catalogue.load(case.scenario).road,
        drivers,
        {f"driver_{place}": one for place, one in enumerate(drivers)},
    )


def test_every_extreme_has_words():
    assert set(EXTREMES) <= set(words.EXTREME_WORDS)


@pytest.mark.parametrize("name", HALF_WINDOWS)
def test_an_extreme_is_dated_at_the_middle_of_its_window(name):
    """A drive as long as the window has one value."""
    drives = (drive([(0, 10), (9, 20)], seconds) for seconds in np.arange(0.5, 5.0, 0.1))
    quantity = name.removeprefix("max_").replace("deceleration", "acceleration")
    window = next(it.duration for it in drives if getattr(smooth_motion(it), quantity).size == 1)
    assert HALF_WINDOWS[name] == pytest.approx(window / 2.0)


def test_braking_without_effect_before_a_contact_is_zero():
    """The command to brake comes one sample before the contact, while the ego speeds up."""
    ego = replace(drive([(0, 10), (10, 20)]), acceleration=np.full(101, 1.0))
    assert braking_before(ego, 3.0, 2.95) == (2.95, 0.0)


def test_hard_braking_before_the_lead_brakes_in_words(case):
    """20 to 2 m/s between 2 and 4 s: 9 m/s2 over any whole second.

    The lead brakes from 5.0 s on.
    """
    lead = drive([(0, 20), (5, 20), (8, 8), (10, 8)], x=300.0)
    braking = scene(
        replace(case, plausibility=0.0), drive([(0, 20), (2, 20), (4, 2), (10, 2)]), lead=lead
    )
    ((sentence, when),) = words.likeness_words(braking, MOTORWAY_PEOPLE)
    assert sentence.startswith("Braked at 9.0 m/s2 at 2.")
    assert "s before `lead` braked; none of the recorded people does" in sentence
    assert "half of them stay below 0.6 m/s2 (213 people" in sentence
    assert 2.4 <= when <= 2.7, "the middle of the first whole second at 9 m/s2"


def test_an_extreme_at_the_start_is_at_0_s(case):
    """The lead pulls away from the start on: the least TTC, 55.5 m / 10 m/s, is the first."""
    lead = drive([(0, 10), (10, 40)], x=110.0)
    away = scene(replace(case, plausibility=0.0), drive(20), lead=lead)
    ((sentence, when),) = words.likeness_words(away, MOTORWAY_PEOPLE)
    assert sentence.startswith("Came within 5.5 s of a collision at 0.0 s")
    assert when == 0.0


def test_standing_and_crawling_name_the_references(case):
    """At 20 m/s the asked way ends 5 m short of 200 m; a stop from 20 m/s in 4 s takes 40 m."""
    logical = catalogue.load(case.scenario)
    begin = logical.placed(case.values).ego.x
    reference = drive(20, x=begin)
    stops = scene(
        replace(case, task_share=0.2), drive([(0, 20), (4, 0), (10, 0)], x=begin), reference
    )

    def said(driven):
        ((sentence, _),) = words.task_words(driven, logical, 0.5)
        return sentence

    assert said(stops) == "Stood after 40 m of 195 m, from 4.0 s on; 1 driver drove on."
    excused = stops._replace(case=replace(stops.case, excused=True))
    assert said(excused) == "Needed 4.0 s for 40 m; the slowest of 1 driver needed 2.0 s."
    crawls = scene(replace(case, task_share=0.5), drive(10, 30.0, x=begin), reference)
    sentence = said(crawls)
    assert sentence == "Needed 19.5 s for 195 m; the slowest of 1 driver needed 9.8 s."
    away = drive(20, 5.0, x=begin, y=-3.0)  # no reference: it left the road
    assert [*words.task_words(crawls._replace(drivers=(reference, away),
                                      references={"a": reference, "b": away}), logical, 0.5)] == [
        (sentence, 19.5)
    ]  # fmt: skip
    hurries = [(0, 20), (1, 5), (3, 5), (5, 60), (10, 60)]
    last = scene(replace(case, task_share=0.8), drive(hurries, x=begin), reference)
    own, theirs = map(float, re.findall(r"([\d.]+) s\b", said(last)))
    assert own > theirs, "late on the way, although first at its end"


def test_a_missed_lane_change_is_said(case):
    """The reference changes to the left lane by 100 m, the ego never: t_i is 0 from there on."""
    logical = catalogue.load(case.scenario)
    placed = logical.placed(case.values)
    due = replace(placed, ego=replace(placed.ego, way=Way(3.5, 0.0, placed.ego.x + 100.0, False)))
    both = (drive(20, x=placed.ego.x) for _ in range(2))
    logical = SimpleNamespace(placed=lambda _: due, road=logical.road)
    said = [*words.task_words(scene(replace(case, task_share=0.5), *both), logical, 0.5)]
    assert said == [("Missed the lane change that was due after 100 m.", pytest.approx(5.0))]


@pytest.mark.parametrize("offset, speed, expected", [
    (1.5, 20.0, "1.5 m further left than 3 drivers in the mean"),
    (0.0, 10.0, "it drove 36 km/h where 3 drivers drove 68 to 76 km/h"),
])  # fmt: skip
def test_unlike_path_or_speed_names_place_and_drivers(case, offset, speed, expected):
    drivers = [drive(one) for one in (19.0, 20.0, 21.0)]
    ego = drive(speed, 20.0, y=offset)
    ((sentence, _),) = words.likeness_words(
        scene(replace(case, mixture_similarity=0.1), ego, *drivers), MOTORWAY_PEOPLE
    )
    assert expected in sentence


def test_picture_is_as_wide_as_the_drive_and_marks_the_moment(case):
    ego, mark, scale = words.picture(scene(case, drive([(0, 20), (5, 0), (10, 0)])), 5.0)
    assert len(ego.split()[1]) == words.PICTURE
    assert ego.split()[1][0] == "█"
    assert ego.split()[1][-1] == "▁"
    assert mark.index("^") == 10 + round(0.5 * (words.PICTURE - 1)), (
        "half way, behind two blanks and a name of 8"
    )
    assert "0 to 72 km/h over 10.0 s" in scale
