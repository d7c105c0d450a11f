"""The driving task: no game of `tools/games.py`, which a safety engineer would not let on a road,
is worth driving."""

import pytest
from loaded import load

import sumo_eval
from sumo_eval.cosim import Command
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.evaluation import zone_partitions
from sumo_eval.report.explain import explain_case, known_case
from sumo_eval.report.terminal import closing_lines, ledger_lines

NO_ORDER = {"no_reaction"}
GIVING_UP = {"RaisesInDanger", "EndsInDanger"}


@pytest.fixture(scope="module")
def games():
    return load("tools/games.py")


def test_law_no_game_scores_as_much_as_an_ads_that_ships(games, tmp_path):
    """At some Sobol points of one scenario. Giving up is below the car that it drives like."""
    few = games.evaluation({"front_vehicle_cut_out": 3}, games.entries(), drivers=2, workers=1)
    table = games.table(sumo_eval.evaluate(few, tmp_path / "run")).set_index("ADS")
    plus, names = table["S+"], {game.__name__ for game in games.GAMES}
    worst = plus[[name for name in SHIPPED if name not in NO_ORDER]].min()
    assert plus[sorted(names - GIVING_UP)].max() < worst
    assert plus[sorted(GIVING_UP)].max() < plus["idm"]
    assert (table.loc[sorted(GIVING_UP), "gave up"] > 0).all()
    assert plus["LeavesTheRoad"] == 0.0 == table.loc["LeavesTheRoad", "T"]


class RaisesBesideTheRoad:
    def act(self, seen):
        assert seen.ego.y > -1.5
        return Command(0.0, -0.3)


class PushesTheLead:
    def step(self, traci, ego, time):
        traci.vehicle.setSpeed("lead", 30.0)


class ParksAtParkedCars:
    def act(self, seen):
        gap = min((one.gap for one in seen.vehicles if one.ahead > 0.0), default=1e3)
        return -4.0 if gap < 5.0 + seen.ego.speed**2 / 8.0 else 0.0


USE = {"use": "front_vehicle_low_speed", "sampling": {"levels": 2}}
CHILD = {"use": "child_from_behind_parked_cars", "sampling": {"method": "sobol", "count": 4}}
SETTINGS = {"name": "both", "scenario": [USE], "drivers": {"count": 2}}


@pytest.mark.parametrize(
    "ads, use, words",
    [
        (PushesTheLead, USE, "In 3 cases the ADS moved an actor"),
        (ParksAtParkedCars, CHILD, "In 2 of 2 safe cases the ego stands where the references"),
    ],
)
def test_ads_that_moves_an_actor_or_parks_is_reported(ads, use, words, tmp_path):
    conditions = {"conditions": {"interference": "record"}}
    settings = SETTINGS | {"scenario": [use], "simulation": conditions}
    done = sumo_eval.evaluate(settings, tmp_path, ads=[ads], engine="serial")
    assert words in "\n".join(closing_lines(done))


def test_who_leaves_the_road_and_gives_up_has_both_incidents(tmp_path):
    done = sumo_eval.evaluate(SETTINGS, tmp_path, ads=[RaisesBesideTheRoad], engine="serial")
    for case in done.cases:
        assert case.gave_up
        assert case.incident_severity == case.departure_speed
        words = explain_case(done, zone_partitions(done), known_case(tmp_path, case.case))
        assert "  The ADS gave the case up, which counts as doing nothing." in words
    assert any(" A " in line and "left the road" in line for line in ledger_lines(done))


@pytest.mark.campaign
def test_games_over_77_points_are_below_every_car_that_ships(games, tmp_path):
    """The bus, at its own braking among cars, collides in as many cases as the raising car gives
    up."""
    done = sumo_eval.evaluate(games.evaluation(games.POINTS, games.entries()), tmp_path / "run")
    assert len(done.cases) == 77 * len(done.settings.ads)
    plus = games.table(done).set_index("ADS")["S+"]
    cars = [name for name in SHIPPED if name not in {*NO_ORDER, "eu_2022_1426_bus"}]
    assert plus[[game.__name__ for game in games.GAMES]].max() < plus[cars].min()
