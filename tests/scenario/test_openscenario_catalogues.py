"""Public catalogues of OpenSCENARIO files by their names, and what they say beside our own
scenarios."""

import itertools
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laid import replace_in
from refusals import refusal
from tables import values_of

from sumo_eval.ads.r157 import HUMAN_BRAKING
from sumo_eval.cosim import simulate
from sumo_eval.cosim.stage import Stage
from sumo_eval.record.facts import resolve
from sumo_eval.scenario import lane_change
from sumo_eval.scenario.catalogue import find, load
from sumo_eval.scenario.formats import expanded
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import ScenarioSettings, SimulationSettings
from tests.scenario.test_openscenario import ALKS, CATALOGUES, needs_catalogues
from tests.scenario.test_openscenario import NCAP as STANDARD

NCAP = CATALOGUES / "osc_ncap"
CUT_OUT = ALKS / "alks_scenario_4_5_1_cut_out_fully_blocking_variation.xosc"


def test_a_catalogue_needs_a_folder_that_holds_it(tmp_path):
    with refusal(r"Catalogue `ncap_2026` must have a `folder`: your copy of vectorgrp/"):
        expanded((ScenarioSettings("ncap_2026"),), tmp_path)
    with refusal(r"`folder` of the catalogue .* must be one with OpenSCENARIO/NCAP/CA-FC_2026"):
        expanded((ScenarioSettings("ncap_2026", folder="."),), tmp_path)
    with refusal(r"`folder` of scenario `cut_in` is for catalogues: osc_alks, ncap_2026"):
        expanded((ScenarioSettings("cut_in", folder="."),), tmp_path)
    plain = (ScenarioSettings("cut_in?lateral_acceleration=1.5"),)
    assert expanded(plain, tmp_path) == plain


@needs_catalogues
def test_a_catalogue_is_a_scenario_for_each_file_and_says_what_does_not_play(tmp_path):
    content = {"name": "n", "scenario": [{"use": "ncap_2026", "folder": str(NCAP)}],
               "ads": [{"name": "idm", "controller": "idm"}]}  # fmt: skip
    settings = resolve(content, tmp_path, resume=False).settings
    # an ego that turns has a road for each of its three radii
    assert len(settings.scenario) == 20 + 2 * 3
    assert not settings.scenario[0].not_played
    for name in ("CCRs.xosc", "CPNA.xosc"):
        shutil.copy(STANDARD / name, tmp_path)
    base = (STANDARD / "../../CCRs.xosc").resolve()
    replace_in(tmp_path / "CCRs.xosc", "../../CCRs.xosc", str(base))
    content["scenario"] = [{"use": "ncap_2026", "folder": str(tmp_path)}]
    settings = resolve(content, tmp_path, resume=False).settings
    assert [Path(entry.use).name for entry in settings.scenario] == ["CCRs.xosc"]
    ((name, why),) = settings.scenario[0].not_played.items()
    assert name == "CPNA.xosc"
    assert "is not there" in why


@needs_catalogues
def test_a_file_with_five_roads_is_five_scenarios():
    file = ALKS / "alks_scenario_4_1_2_swerving_lead_vehicle_variation.xosc"
    spaces = [find(entry.use) for entry in expanded((ScenarioSettings(str(file)),), Path())]
    assert len({space.name for space in spaces}) == 5
    assert [space.road.bent for space in spaces] == [False, True, True, True, True]
    assert all(space.names == ("Ego_InitSpeed_Ve0_kph", "LeadVehicle_Model") for space in spaces)


@needs_catalogues
def test_zones_are_searched_in_few_parameters_only():
    with refusal(
        r"`zones=1` of alks_\S+.xosc must be asked of a file with at most 3 parameters .*, "
        r"got 5\."
    ):
        find(f"{CUT_OUT}?zones=1")


@needs_catalogues
def test_a_vehicle_off_the_lanes_moves_the_same_set_twice(monkeypatch):
    """A pedestrian crosses a bend of 250 m: SUMO hears of him in one step of ten, or, as where an
    ADS asks, in each."""
    file = ALKS / "alks_scenario_4_2_3_crossing_pedestrian_variation.xosc"
    case = find(f"{file}?road=2").concrete(Ego_InitSpeed_Ve0_kph=60.0)
    assert case.road.bent
    assert case.actors[0].on_map is not None
    seldom = simulate(case, "no_reaction")
    exchange = Stage.exchange
    monkeypatch.setattr(Stage, "exchange", lambda *given: (1, exchange(*given)[1]))
    always = simulate(case, "no_reaction")
    assert seldom.end_reason == always.end_reason == "contact"
    assert seldom.collision == always.collision
    for name, drive in seldom.actors.items():
        np.testing.assert_array_equal(drive.x, always.actors[name].x)
        np.testing.assert_array_equal(drive.y, always.actors[name].y)


COSINE = 'do = "change_lane_cosine"\nduration = "0.5 * 3.141592653589793 * 3.5 / lateral_speed"'
AS_THEIRS = {
    "ncap_ccrs": {"length = 4.5 ": "length = 4.358 ", "width = 1.8\n": "width = 1.815\n"},
    "ncap_ccrm": {"length = 4.5 ": "length = 4.358 ", "width = 1.8\n": "width = 1.815\n"},
    "ncap_ccrb": {
        "length = 4.5 ": "length = 4.358 ", "width = 1.8\n": "width = 1.815\n",
        'do = "brake"\ndeceleration': f'do = "accelerate"\nspeed = {2.0 / 3.6!r}\nacceleration',
    },
    "front_vehicle_braking": {"4.3": "5.0", "width = 1.9": "width = 2.0"},
    "cut_in": {
        "length = 4.3": "length = 5.0", "width = 1.9": "width = 2.0",
        'do = "move_sideways"\nspeed = "lateral_speed"\nacceleration = '
        '"lateral_acceleration"': COSINE,
    },
    "r157_cut_out": {
        "4.3": "5.0", "width = 1.9": "width = 2.0", 'do = "move_sideways"\nspeed = '
                                                    '"lateral_speed"': COSINE,
    },
}  # fmt: skip
"""What a user changes in a copy of our file to have the bodies and the moves of the imported one,
text by text."""


def like_theirs(name, folder):
    """A copy of a shipped scenario file with the bodies and the moves of the imported one."""
    text = scenario_files()[name].read_text()
    for ours, theirs in AS_THEIRS[name].items():
        assert ours in text, (name, ours)
        text = text.replace(ours, theirs)
    (folder / f"{name}.toml").write_text(text)
    return find(f"{name}.toml", folder)


def their_cut_out(kph, gap, lateral):
    """The imported cut-out, its obstacle `gap` m beyond the lead, which leaves with `lateral` m/s."""
    return find(str(CUT_OUT)).concrete(
        Ego_InitSpeed_Ve0_kph=kph, CutOutVehicle_RelativeTargetLane=1.0,
        FrontOfLead_Distance_dx0_f_m=gap,
        CutOutVehicle_LaneChange_MaxLateralVelocity_Vy_mps=lateral, TargetBlocking_Model=1.0,
    )  # fmt: skip


def ours_and_theirs(load):
    """Cases that our files and the imported ones both have: the other starts as far ahead, and does
    as much.

    load: our scenario by its name.
    """

    def ncap(kind, kph, **own):
        theirs = find(str(STANDARD / f"{kind}.xosc"))
        own = load(f"ncap_{kind.lower()}").concrete(ego_speed=kph / 3.6, overlap=1.0, **own)
        return f"{kind} {kph}", own, theirs.concrete(Ego_speed_kph=kph, ImpactLocation=50.0)

    def braking(kph, rate):
        file = "alks_scenario_4_3_2_follow_lead_vehicle_emergency_brake_variation_reference.xosc"
        theirs = find(str(ALKS / file)).concrete(
            Ego_InitSpeed_Ve0_kph=kph,
            LeadVehicle_Model=0.0,
            LeadVehicle_Deceleration_Rate_mps2=rate,
        )
        own = load("front_vehicle_braking")
        own = own.concrete(ego_speed=kph / 3.6, headway=2.0, lead_deceleration=rate)
        return f"brakes {kph:g} {rate:g}", own, theirs

    def cuts_in(gap, lateral):  # of 60 km/h, 40 km/h: the speed that theirs keeps
        theirs = find(str(ALKS / "alks_scenario_4_4_1_cut_in_no_collision_variation.xosc")).concrete(
            Ego_InitSpeed_Ve0_kph=60.0, CutInVehicle_Model=0.0,
            CutInVehicle_InitPosition_RelativeLaneId=1.0,
            CutInVehicle_RelativeInitSpeed_Ve0_Vo0_kph=-20.0,
            CutInVehicle_HeadwayDistanceTrigger_dx0_m=gap,
            CutInVehicle_LaneChange_MaxLateralVelocity_Vy_mps=lateral,
            CutInVehicle_Acceleration_Rate_mps2=3.0,
        )  # fmt: skip
        own = {"ego_speed": 60 / 3.6, "cut_in_speed": 40 / 3.6, "gap": gap}
        own = load("cut_in").concrete(**own, lateral_speed=lateral)
        return f"cuts in {gap:g} {lateral:g}", own, theirs

    def cuts_out(*at):
        kph, gap, lateral = at
        own = load("r157_cut_out")
        own = own.concrete(ego_speed=kph / 3.6, obstacle_gap=gap, lateral_speed=lateral)
        return f"cuts out {kph:g} {gap:g} {lateral:g}", own, their_cut_out(*at)

    return [
        *(ncap("CCRs", kph) for kph in (10, 20, 30, 40, 50)),
        *(
            ncap("CCRm", kph, lead_speed=lead / 3.6)
            for kph, lead in values_of("""
        30, 20
        50, 20
        80, 20
        100, 40
        130, 70
        """)
        ),
        *(
            ncap("CCRb", kph, headway_distance=kph / 3.6, lead_deceleration=4.0)
            for kph in (30, 50, 80)
        ),
        *itertools.starmap(braking, ((50.0, 3.0), (60.0, 6.0), (60.0, 9.0))),
        *itertools.starmap(cuts_in, ((10.0, 1.0), (20.0, 3.0), (60.0, 1.0))),
        *itertools.starmap(cuts_out, ((30.0, 100.0, 3.0), (60.0, 100.0, 1.0), (60.0, 20.0, 1.0))),
    ]


@pytest.mark.campaign
@needs_catalogues
def test_a_car_that_does_nothing_hits_as_hard_in_our_own_scenarios_as_in_the_imported_ones():
    """Closing speeds at contact: 50 of CCRs, 80 - 20 of CCRm, 60 - 40 of the cut-in and 60 km/h of
    the cut-out; the braking lead has come to a stop in both.
    """
    cases = {name: (own, theirs) for name, own, theirs in ours_and_theirs(load)}
    for name, kph in values_of("""
        "CCRs 50", 50.0
        "CCRm 80", 60.0
        "cuts in 60 1", 20.0
        "cuts out 60 100 1", 60.0
        "brakes 60 9", 60.0
        """):  # fmt: skip
        for case in cases[name]:
            hit = simulate(case, "no_reaction").collision
            assert hit is not None, name
            assert closing(hit) == pytest.approx(kph / 3.6, abs=0.01), name


SIMULATION = SimulationSettings()
STRONGEST = {
    "no_reaction": 0.0,
    "careful_driver": HUMAN_BRAKING,
    "idm": SIMULATION.vehicle.max_deceleration,
}
"""m/s2, as hard as each of them can brake."""
ROUNDING = 0.005
"""m/s between two impacts that are the same by physics: what SUMO's positions of 1 mm make of a
speed."""


def furthest_apart(own, theirs, own_idle, theirs_idle, braking, step):
    """By how much the closing speeds of two impacts may differ, m/s, of one driver in our scenario
    and in theirs.

    Our lead moves from t = 0 on, at a look of the driver; the imported one moves when a condition
    holds, within a step. The same move is therefore seen, and braked for, up to one step dt sooner
    or later. Who is late by d <= dt is d u0 further when the same braking begins, u0 the closing
    speed without it. So contact is where the other still has
    d u0 to go, and over these metres brakes of at most a change u^2 / 2 by at most a d u0:

        |u1^2 - u2^2| / 2 <= a dt u0, thus |u1 - u2| <= a dt u0 / ((u1 + u2) / 2).

    Where the other moves into the ego's side, the moment of contact is his, and |u1 - u2| <= a d,
    which is less. Where both leads begin at a look nothing differs: the impacts of who does nothing
    are whole steps apart then. own_idle, theirs_idle: those, with u0.
    """
    steps = (theirs_idle.time - own_idle.time) / step
    if abs(steps - round(steps)) * step < 1e-6:
        return ROUNDING
    mean = 0.5 * (closing(own) + closing(theirs))
    return ROUNDING + braking * step * max(closing(own_idle), closing(theirs_idle)) / mean


def closing(hit):
    """Closing speed along the road, m/s."""
    return hit.ego_velocity[0] - hit.other_velocity[0]


SHAPE_DECIDES = {("careful_driver", "cuts out 60 20 1")}
"""Cases that come out differently with the shape of the lead's move."""


@needs_catalogues
@pytest.mark.campaign
@pytest.mark.parametrize("ads", ["careful_driver", "no_reaction", "idm"])
def test_our_own_scenarios_come_out_as_the_imported_ones(ads, tmp_path):
    """Contact or none in every case, and impacts as hard, of a copy of our file with the bodies and
    moves of theirs; of our file as it ships in all cases but those in which the shape of the lead's
    move decides.
    """
    for name, own, theirs in ours_and_theirs(lambda name: like_theirs(name, tmp_path)):
        assert own.ego_body == theirs.ego_body, name
        assert {(it.length, it.width) for it in own.actors} == {
            (it.length, it.width) for it in theirs.actors
        }, name
        one, two = (simulate(case, ads, SIMULATION).collision for case in (own, theirs))
        assert (one is None) == (two is None), name
        if one is not None and two is not None:
            idle, its_idle = (
                simulate(case, "no_reaction", SIMULATION).collision for case in (own, theirs)
            )
            assert idle is not None, name
            assert its_idle is not None, name
            apart = furthest_apart(one, two, idle, its_idle, STRONGEST[ads], SIMULATION.step)
            assert closing(one) == pytest.approx(closing(two), abs=apart), name
    for name, own, theirs in ours_and_theirs(load):
        one, two = (
            simulate(replace(case, ego_body=theirs.ego_body), ads).collision
            for case in (own, theirs)
        )
        alike = (one is None) == (two is None)
        assert alike == ((ads, name) not in SHAPE_DECIDES), name
        if one is not None and two is not None:
            # the target of their CCRb goes on at that
            assert closing(one) == pytest.approx(closing(two), abs=2.0 / 3.6), name


@needs_catalogues
@pytest.mark.campaign
def test_how_the_lead_leaves_its_lane_alone_decides_on_a_cut_out_close_to_the_limit():
    """60 km/h, 20 m, 1 m/s, 2 s of headway, all bodies 5 x 2 m as theirs: `careful_driver` stops
    behind a lead that leaves evenly in 3.5 s, and hits the obstacle where it leaves along half a
    cosine with that peak, in 3.5 pi/2 = 5.5 s: as hard in our own scenario as in the imported file.
    """
    theirs = their_cut_out(60.0, 20.0, 1.0)
    own = load("r157_cut_out").concrete(ego_speed=60 / 3.6, obstacle_gap=20.0, lateral_speed=1.0)
    lead, obstacle = (
        replace(actor, start=replace(actor.start, x=own.ego.x + ahead), length=5.0, width=2.0)
        for actor, ahead in zip(
            own.actors, (2.0 * 60 / 3.6 + 5.0, 2.0 * 60 / 3.6 + 5.0 + 25.0), strict=True
        )
    )
    speeds = []
    for way in (lead.lateral_moves[0], lane_change(0.0, 0.5 * math.pi * 3.5, 3.5, cosine=True)):
        case = replace(own, actors=(replace(lead, acts=(way,)), obstacle), ego_body=theirs.ego_body)
        hit = simulate(case, "careful_driver").collision
        speeds.append(0.0 if hit is None else hit.ego_velocity[0])
    hit = simulate(theirs, "careful_driver").collision
    assert speeds == [0.0, pytest.approx(hit.ego_velocity[0], abs=0.1)]
