"""What is missing from C and D widens them: worked numbers, and the exit status that follows."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from evaluations import EMPTY
from record.runs import sumo_eval_cli, write_evaluation

from sumo_eval.report.notes import score_note
from sumo_eval.report.score_table import score_lines
from sumo_eval.results import Evaluation
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import (
    AdsSettings,
    CollisionSettings,
    EvaluationSettings,
    MethodSettings,
    ScenarioSettings,
)

SETTINGS = EvaluationSettings("e", (ScenarioSettings("s"),), (AdsSettings("a", "idm"),))
HIT = replace(
    EMPTY,
    case="hit",
    status="collision",
    collided=True,
    severity=10.0,
    ideal_severity=4.0,
    weight=0.5,
)
SAFE = replace(EMPTY, case="safe", zone="safe", exposure=3.0, index=0.8, task_share=1.0)
LOST = replace(EMPTY, case="lost", status="sim_error")
LOST_HIT = replace(LOST, ideal_severity=4.0, weight=1.5)
LOST_SAFE = replace(LOST, case="lost_safe", zone="safe")


def combined(*cases):
    return combine("a", "s", cases, MethodSettings())


def test_a_complete_score_has_no_interval():
    result = combined(HIT, SAFE)
    assert result.c_interval is None
    assert result.d_interval is None
    assert result.s_interval is None


def test_a_missing_hazardous_case_widens_c_by_its_own_weight():
    result = combined(HIT, SAFE, LOST_HIT)
    assert result.c == pytest.approx(0.4), "the mean over what is there: 4 / 10"
    low, high = result.c_interval or (0.0, 0.0)
    assert low == pytest.approx(0.5 * 0.4 / 2.0), (
        "far harder than the ideal vehicle: (0.5 * 0.4 + 1.5 * 0) / (0.5 + 1.5)"
    )
    assert high == pytest.approx((0.5 * 0.4 + 1.5) / 2.0), "as gentle as the ideal vehicle"
    assert result.d_interval is None
    assert result.s_interval == (
        pytest.approx(50 * 0.1 + 50 * 0.8),
        pytest.approx(50 * 0.85 + 50 * 0.8),
    )


def test_a_missing_safe_case_widens_d_by_its_exposure_and_may_leave_no_d():
    result = combined(SAFE, LOST_SAFE)
    assert result.d == pytest.approx(0.8)
    assert result.d_interval == (pytest.approx(3 * 0.8 / 4), pytest.approx((3 * 0.8 + 1) / 4))
    assert result.c_interval == (0.0, 1.0), "no other collision: it alone would be C"
    low, high = result.s_interval or (9.0, 9.0)
    assert low == 0.0, "had it been a collision in the safe zone, there would be no D"
    assert high == pytest.approx(50 + 50 * 0.85)


def test_a_collision_without_the_ideal_vehicles_case_is_missing_from_c():
    result = combined(HIT, replace(HIT, case="other", ideal_severity=None), SAFE)
    assert result.not_evaluated == 1
    assert result.c_interval == (pytest.approx(0.2), pytest.approx(0.7)), (
        "(0.4 + 0) / 2 and (0.4 + 1) / 2"
    )


KNOWN = replace(HIT, case="known", severity=5.0, ideal_severity=0.0, weight=1.0)
NO_IDEAL = replace(KNOWN, case="no ideal", ideal_severity=None)


@pytest.mark.parametrize(
    "severity, lowest, highest",
    [(9.0, 1 - (5 + 9) / (10 + 10), 1 - 5 / (10 + 1)), (0.0, 0.5, 1 - 5 / (10 + 10))],
    ids=[
        "it hit: the ideal vehicle avoids, or hits as hard",
        "it avoided: the point has no part in A, or a whole one",
    ],
)
def test_an_ideal_drive_that_is_missing_widens_a_and_s_plus(severity, lowest, highest):
    result = combined(KNOWN, replace(NO_IDEAL, severity=severity or None, collided=severity > 0.0))
    assert result.avoided_share == 0.5, "over the points whose ideal vehicle is known"
    assert result.not_evaluated == 1
    assert result.avoided_share_interval == (pytest.approx(lowest), pytest.approx(highest))
    assert score_note(result.notes[0]).startswith("1 case could not be evaluated")
    alone = combine(
        "a", "s", (KNOWN, NO_IDEAL, replace(SAFE, index=None)), MethodSettings(), people=False
    )
    assert alone.s_plus_interval == pytest.approx(
        [50 * end for end in alone.avoidance_grade_interval or ()]
    )


def test_a_case_given_up_counts_as_doing_nothing_and_is_counted_apart():
    """A = 1 - (0 + 10) / (10 + 10) = 0.5; T = (3 * 1 + 1 * 0) / 4; H = (3 * 0.8 + 1 * 0) / 4; C and
    D as without it."""
    safe = replace(SAFE, human_likeness=0.8, weight=1.0)
    given_up = replace(
        EMPTY,
        case="raised",
        zone="safe",
        status="ads_error",
        weight=1.0,
        task_share=0.0,
        human_likeness=0.0,
    )
    result, without = combined(safe, given_up), combined(safe)
    assert result.avoided_share == pytest.approx(0.5)
    assert result.task_share == pytest.approx(0.75)
    assert result.human_likeness == pytest.approx(0.6)
    assert result.c == without.c
    assert result.d == without.d
    assert result.gave_up == 1
    assert result.not_evaluated == 1
    everywhere = combined(given_up, replace(given_up, case="again"))
    assert everywhere.s_plus == 0.0
    assert everywhere.c is None
    assert everywhere.s is None


def test_a_departure_is_avoidable_harm_and_no_collision():
    """U = 12 of a contact with a standing car, where doing nothing has 10: A = 1 - 12/10 is below
    0."""
    left = replace(
        SAFE, case="left", departure_time=3.0, departure_speed=12.0, departure_severity=12.0,
        weight=1.0,
        task_share=0.0, human_likeness=0.0,
    )  # fmt: skip
    result = combined(left)
    assert result.departures == 1
    assert result.collisions == 0
    assert result.c == 1.0
    assert result.avoided_share == pytest.approx(-0.2)
    assert result.s_plus == 0.0
    assert left.incident_severity == 12.0


def test_one_more_incident_never_raises_s_plus():
    clean = [replace(SAFE, case=str(n), human_likeness=0.5, weight=1.0) for n in range(4)]
    before = combined(*clean).s_plus
    for harm in (
        {"departure_time": 1.0, "departure_severity": 0.5},
        {"status": "ads_timeout"},
        {"collided": True, "status": "collision", "severity": 0.5},
    ):
        after = combined(
            replace(clean[0], task_share=0.0, human_likeness=0.0, **harm), *clean[1:]
        ).s_plus
        assert after < before


def test_a_missing_drive_without_reaction_widens_a():
    result = combined(KNOWN, replace(KNOWN, case="other", severity=2.0, no_reaction_severity=None))
    assert result.avoided_share == 0.5
    low, high = result.avoided_share_interval or (9.0, -9.0)
    assert low == pytest.approx(1 - (5 + 2) / (10 + 2)), "doing nothing hits as hard as it did"
    assert high == pytest.approx(1 - (5 + 2) / (10 + 10)), "as hard as anywhere else"


def test_of_points_that_are_not_sure_only_those_that_lower_a_have_a_part_in_its_lower_end():
    cases = [
        replace(NO_IDEAL, case=str(severity), severity=severity)
        for severity in (1.0, 6.0, 9.0, 4.9)
    ]
    result = combined(KNOWN, *cases)
    low, _ = result.avoided_share_interval or (9.0, -9.0)
    subsets = [
        part for size in range(5) for part in itertools.combinations((1.0, 6.0, 9.0, 4.9), size)
    ]
    assert low == pytest.approx(
        min(1 - (5 + sum(part)) / (10 + 10 * len(part)) for part in subsets)
    )


def test_c_is_its_upper_end_if_the_missing_is_avoidable():
    for weight in (0.0, 0.1, 1.0, 3.0):
        result = combined(HIT, SAFE, replace(LOST, weight=weight))
        low, high = result.c_interval or (9.0, -9.0)
        assert low <= high == result.c
    of_a_loss = MethodSettings(collision=CollisionSettings(severity="mine.py:own"))
    interval = combine("a", "s", (HIT, replace(LOST, weight=0.5)), of_a_loss).c_interval
    assert interval == pytest.approx((0.2, 0.7)), "a contact without loss: (0.4 + 1) / 2"


def test_the_note_says_how_many_are_missing_and_where_and_the_table_shows_the_interval():
    result = combined(HIT, SAFE, LOST_HIT, replace(LOST_HIT, zone="safe", weight=1.0))
    counted, interval = map(score_note, result.notes)
    assert counted.startswith(
        "2 cases could not be evaluated (1 in the hazardous zone and 1 in the safe zone)"
    )
    assert interval.startswith(
        "With the missing cases counted as worst and as best: C within 0.067..0.900, D within"
    )
    table = score_lines(Evaluation("e", Path(), SETTINGS, {}, (), (result,), ()), everything=True)
    assert "0.400 (0.067..0.900)" in "\n".join(table)


@pytest.mark.parametrize("setting, status", [("shown", 3), ("gate", 1)])
def test_a_setting_decides_whether_an_incomplete_score_fails_the_gate(setting, status, tmp_path):
    ads = "def MyAds(traci, ego, time):\n    raise ValueError(traci.vehicle.getSpeed(ego))\n"
    path = write_evaluation(tmp_path, ads, levels=2)
    path.write_text(path.read_text() + f'incomplete = "{setting}"\n')
    done = sumo_eval_cli("run", path, "--out", tmp_path / "run", "--all", status=status)
    assert "– (0.000..1.000)" in done.stdout
    assert ("The gate failed" in done.stdout) == (setting == "gate")
    beside = sumo_eval_cli("compare", tmp_path / "run", tmp_path / "run", status=status)
    assert ("The gate failed" in beside.stdout) == (setting == "gate")
