"""The human reference from recordings and the exposure from their events, on traffic made by
hand."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from drivers.test_events import track
from evaluations import small
from refusals import refusal
from scipy import stats

from sumo_eval.drivers.recorded.exposure import exposure_of, fit_exposure
from sumo_eval.drivers.recorded.recordings import Recordings, write_csv
from sumo_eval.drivers.recorded.reference import (
    Reference,
    matching_events,
    notes_of,
    open_people,
    reference,
)
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.logical import Counterpart
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scenario.road.reference_line import arc
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import DeclaredDistribution, DriverSettings, ExposureSettings

LOGICAL = catalogue.load("front_vehicle_low_speed")
MOTORWAY = sorted(file for name, file in scenario_files().items() if name.startswith("motorway_"))


def write_people(folder, speeds, *, seconds=60.0, same_driver=(), lead_step=0.0, side=1):
    """A recording for each speed: somebody at it approaches a leader at 15 m/s (or faster by up to
    two steps), and overtakes at 12 s.

    side: 1: on the left, -1: on the right.
    """
    parts = []
    for number, speed in enumerate(speeds):
        ego = track("ego", 0.0, speed, move=(12.0, 5.0, 3.75 * side), seconds=seconds)
        slow = 15.0 + lead_step * (number % 3)
        lead = track("lead", 3.5 * speed + 10.0 * (speed - slow) + 5.0, slow, seconds=seconds)
        driver = "anna" if number in same_driver else ""
        parts.append(pd.concat([ego, lead]).assign(recording=f"r{number}", driver=driver))
    table = pd.concat(parts, ignore_index=True)
    table["lane"] = np.round(table["y"] / 3.75).astype(int) + (side < 0)
    path = folder / "people.csv"
    write_csv(Recordings(table), path)
    return path


def settings_for(path, **changes):
    return replace(DriverSettings(source="recorded", recordings=(path.name,)), **changes)


CONCRETE = LOGICAL.concrete(ego_speed=25.0, lead_speed=15.0)


def found_in(settings, folder):
    """The drivers recorded like that case."""
    return reference(CONCRETE, open_people(settings, folder), settings, LOGICAL.recorded)


def test_drives_begin_at_the_egos_start_and_lateral_moves_are_stretched_to_the_scenarios_lane(
    tmp_path,
):
    found = found_in(settings_for(write_people(tmp_path, [25.0])), tmp_path)
    (drive,) = found.drives
    assert drive.time[0] == 0.0
    assert drive.x[0] == CONCRETE.ego.x
    assert drive.y[0] == pytest.approx(CONCRETE.ego.y, abs=1e-6)
    assert drive.x[-2] < CONCRETE.road.length <= drive.x[-1]
    # The event begins 10 s into the recording; the lane change ends at 17 s: 9 s later it is one
    # lane to the left.
    assert np.interp(9.0, drive.time, drive.y) == pytest.approx(3.75, abs=0.3)
    assert found.names == ("r0/ego",)


def test_only_events_within_the_tolerance_count_nearest_first(tmp_path):
    path = write_people(tmp_path, [25.0, 23.0, 26.0, 30.0])
    assert found_in(settings_for(path), tmp_path).names == ("r0/ego", "r2/ego", "r1/ego")
    narrow = settings_for(path, tolerance={"ego_speed": 0.5})
    assert found_in(narrow, tmp_path).names == ("r0/ego",)


def test_a_driver_counts_once_and_a_recording_that_ends_too_early_does_not(tmp_path):
    path = write_people(tmp_path, [25.0, 24.5, 25.5], same_driver=(0, 1))
    assert len(found_in(settings_for(path), tmp_path).drives) == 2
    # 10 s of 550 m at 25 m/s, in the same file, which is read again once it has changed
    write_people(tmp_path, [25.0], seconds=20.0)
    short = found_in(settings_for(path), tmp_path)
    assert not short.drives
    share = 25.0 * 9.9 / (CONCRETE.road.length - CONCRETE.ego.x)
    assert short.left_out == pytest.approx((share,))


def test_a_driver_counts_once_on_both_sides_of_a_hole(tmp_path):
    path = write_people(tmp_path, [25.0], seconds=30.0)
    table = pd.read_csv(path)
    pd.concat([table, table.assign(t=table["t"] + 100.0)]).to_csv(path, index=False)
    assert found_in(settings_for(path), tmp_path).names == ("r0/ego",)


def test_a_recorded_drive_that_leaves_the_road_does_not_count(tmp_path):
    path = write_people(tmp_path, [25.0], side=-1)
    assert found_in(settings_for(path), tmp_path) == Reference(left_out=(math.inf,))


def test_drives_in_named_cases_are_taken_as_they_are(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    time = np.arange(0.0, 5.0, 0.1)
    pd.DataFrame({"driver": "ben", "t": time, "x": 50 + 25 * time, "y": 0.3}).to_csv(
        folder / "ben.csv", index=False
    )
    cases = pd.DataFrame([["front_vehicle_low_speed", "ben.csv", 25.0, 15.0]])
    cases.columns = ["scenario", "file", "ego_speed", "lead_speed"]
    cases.to_csv(folder / "cases.csv", index=False)
    settings = DriverSettings(source="recorded", cases="mine")
    people = open_people(settings, tmp_path)
    found = reference(CONCRETE, people, settings, LOGICAL.recorded)
    assert found.names == ("ben",)
    assert found.drives[0].y.tolist() == [0.3] * 50
    # 0.3 m outside a curve of 300 m it is 0.1 % faster than along its line
    curve = replace(CONCRETE.road, line=(arc(600.0, -300.0),))
    bent = reference(replace(CONCRETE, road=curve), people, settings, LOGICAL.recorded)
    assert bent.drives[0].speed == pytest.approx(25.025, rel=5e-5)
    (folder / "ben.csv").write_text((folder / "ben.csv").read_text().replace("ben,", "01,"))
    assert reference(CONCRETE, people, settings, LOGICAL.recorded).names == ("01",)
    (folder / "ben.csv").write_text((folder / "ben.csv").read_text().replace("01,", ","))
    nameless = reference(CONCRETE, people, settings, LOGICAL.recorded)
    assert nameless.names == ("ben",), "the file names its driver where the column is empty"
    assert (
        reference(
            LOGICAL.concrete(ego_speed=25.0, lead_speed=10.0), people, settings, LOGICAL.recorded
        ).drives
        == ()
    )
    whole = (folder / "ben.csv").read_text()
    (folder / "ben.csv").write_text("t,x,y\n0,50,0\n0,51,0\n1,75,0\n")
    with refusal("ben.csv: `time` of a Trajectory must be finite and strictly increasing"):
        reference(CONCRETE, people, settings, LOGICAL.recorded)
    (folder / "ben.csv").write_text("".join(whole.splitlines(keepends=True)[:2]))
    with refusal("ben.csv: a drive must have at least two samples"):
        reference(CONCRETE, people, settings, LOGICAL.recorded)
    wrong = cases.assign(lead_speed="slow", fil=1)
    wrong = pd.concat([wrong, wrong.assign(scenario="cut_in")])
    wrong.to_csv(folder / "cases.csv", index=False)
    (folder / "ben.csv").write_text(whole.replace("driver", "drivr"))
    people = open_people(settings, tmp_path)
    assert [note[:25] for note in notes_of(people, {LOGICAL.name: LOGICAL.names})] == [
        "Column `fil` of cases.csv", "Scenario `cut_in` of case", "Column `drivr` of ben.csv"
    ]  # fmt: skip
    with refusal(r"`lead_speed` in row 2 of .*cases\.csv"):
        reference(CONCRETE, people, settings, LOGICAL.recorded)


def test_names_of_files_and_scenarios_may_be_numbers(tmp_path):
    """As numbers they were another file, and another scenario, whose drives were not found."""
    (tmp_path / "007").write_text("t,x,y\n0,50,0\n1,75,0\n")
    table = tmp_path / "cases.csv"
    table.write_text("scenario,file,ego_speed,lead_speed\n2024,007,25,15\n")
    settings = DriverSettings(source="recorded", cases=".")
    numbered = replace(CONCRETE, scenario="2024")
    found = reference(numbered, open_people(settings, tmp_path), settings, None)
    assert found.names == ("007",)
    table.write_text(table.read_text() + "2024,,25,15\n")
    with refusal(r"`file` in row 3 of .*cases\.csv must be a name, got nothing"):
        open_people(settings, tmp_path)


def test_recorded_people_without_a_recording_are_refused(tmp_path):
    with refusal(r"`drivers\.recordings` or `drivers\.cases`"):
        open_people(DriverSettings(source="recorded"), tmp_path)
    with refusal("There is no file"):
        open_people(DriverSettings(source="recorded", recordings=("nobody.csv",)), tmp_path)
    path = write_people(tmp_path, [25.0])
    with refusal("different names, got 'r0' twice"):
        open_people(settings_for(path, recordings=(path.name, path.name)), tmp_path)


# --- exposure -------------------------------------------------------------------------------------


def test_the_exposure_is_the_kde_of_scipy_and_says_where_it_has_no_support():
    events = np.random.default_rng(3).normal([20.0, 10.0], [3.0, 2.0], (200, 2))
    model = fit_exposure(events, ("ego_speed", "lead_speed"))
    values = {"ego_speed": np.array([20.0, 28.0]), "lead_speed": np.array([10.0, 3.0])}
    expected = stats.gaussian_kde(events.T)(np.array([[20.0, 28.0], [10.0, 3.0]]))
    assert model.density(values) == pytest.approx(expected)
    assert model.supported(np.array([[20.0, 10.0], [60.0, 60.0]])).tolist() == [True, False]


def test_held_out_likelihood_prefers_a_kde_where_the_events_have_two_modes():
    stream = np.random.default_rng(5)
    events = np.concatenate(
        [stream.normal(10.0, 1.0, (150, 1)), stream.normal(30.0, 1.0, (150, 1))]
    )
    stream.shuffle(events)
    held_out = fit_exposure(events, ("ego_speed",)).held_out
    assert held_out["cross_validated"] >= held_out["scott"] > held_out["single_gaussian"] + 0.3
    # Two halves of deviation 1: the entropy of the mixture is ln 2 + ln(2 pi e) / 2 = 2.11 nats.
    assert held_out["cross_validated"] == pytest.approx(-2.11, abs=0.12)


def test_a_declared_exposure_is_a_product_of_its_distributions(tmp_path):
    settings = ExposureSettings(
        "declared", declared={"ego_speed": DeclaredDistribution("normal", 25.0, 4.0)}
    )
    density = exposure_of(LOGICAL, settings, DriverSettings(), tmp_path).density
    values = {"ego_speed": np.array([25.0, 29.0]), "lead_speed": np.array([5.0, 20.0])}
    assert density(values)[1] / density(values)[0] == pytest.approx(np.exp(-0.5))
    wrong = ExposureSettings(
        "declared", declared={"ego_sped": DeclaredDistribution("normal", 25.0, 4.0)}
    )
    with refusal("Did you mean `ego_speed`"):
        exposure_of(LOGICAL, wrong, DriverSettings(), tmp_path)
    with refusal("greater than 0"):
        DeclaredDistribution("normal", 25.0, 0.0)
    with refusal("greater than `first` \\(25\\), got"):
        DeclaredDistribution("uniform", 25.0, 25.0)


@pytest.mark.parametrize("varied", [[], [3], [3, 8]])  # nowhere, or within one fold only
def test_events_that_do_not_vary_are_refused(varied):
    events = np.column_stack([np.arange(20.0), np.full(20, 15.0)])
    events[varied, 1] = 20.0
    with refusal("must vary in each of ego_speed, lead_speed"):
        fit_exposure(events, ("ego_speed", "lead_speed"))


def test_too_few_events_and_scenarios_without_events_are_refused(tmp_path):
    path = write_people(tmp_path, [25.0])
    settings = ExposureSettings("recorded", recordings=(path.name,))
    with refusal("at least 10, got 1"):
        exposure_of(LOGICAL, settings, DriverSettings(), tmp_path)
    with refusal("no recorded event that corresponds to scenario `ncap_ccrm`"):
        exposure_of(catalogue.load("ncap_ccrm"), settings, DriverSettings(), tmp_path)


def test_names_of_a_reference_must_be_numbers_and_parameters(tmp_path):
    recorded = Counterpart("approach", (("ego_speed", "lead"),), (("ego_speed", 1.0),), "t")
    people = open_people(settings_for(write_people(tmp_path, [25.0])), tmp_path)
    with refusal(r"must name columns of numbers: .* column 'ego_speed'"):
        matching_events(people.events, "mine", recorded)
    with refusal(
        "`start` column .* must hold times within the ego's track, 0..59.9 s .*`gap` with 8"
    ):
        reference(CONCRETE, people, DriverSettings(), replace(LOGICAL.recorded, start="gap"))
    drivers = DriverSettings(tolerance={"gpa": 1.0})
    settings = replace(small(scenarios=("cut_in",)), drivers=drivers)
    with refusal(r"`drivers\.tolerance`\. Did you mean `gap`"):
        Resolved.of(settings, tmp_path)


@pytest.mark.parametrize("file", MOTORWAY, ids=lambda file: file.stem)
def test_the_motorway_variants_can_be_placed_and_name_their_event(file):
    assert "possible points" in check_file(file)[1]
    logical = read_scenario(file)
    columns, tolerance = map(dict, (logical.recorded.columns, logical.recorded.tolerance))
    assert set(columns) == set(logical.names) == set(tolerance)
