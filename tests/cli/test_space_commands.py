"""`sample`, `schema`, `boundary` and `check` of a scenario file, as a user has them."""

import csv
import json

import pytest
from commands import cli_refuses, sumo_eval
from laid import read_json

from tests.scenario.test_scenario_file import EXAMPLE


@pytest.fixture
def truck(tmp_path):
    path = tmp_path / "slow_truck.toml"
    path.write_text(EXAMPLE)
    return path


def test_sample_writes_and_draws_the_points_of_a_scenario_file(truck, tmp_path):
    # 5 speeds x 3 = 15, less (15, 15), (15, 22.2) and (20, 22.2): 3 of 15 are 20 %
    done = sumo_eval(f"sample {truck} --out {tmp_path}/out")
    assert "slow_truck: grid, 12 points; constraints refuse 3 of 15 (20.0%)." in done.said
    with (tmp_path / "out" / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert {float(row["truck_speed"]) for row in rows} == {10.0, 15.0, 22.2}
    assert all(float(row["truck_speed"]) < float(row["ego_speed"]) for row in rows)
    page = (tmp_path / "out" / "points.html").read_text()
    assert 'id="study-data"' in page or "truck_speed" in page


def test_a_space_of_many_parameters_is_drawn(tmp_path):
    """13 parameters: 12 rows of panels."""
    names = [f"p{number}" for number in range(13)]
    parameter = '[[parameter]]\nname = "{}"\nunit = "m/s"\nlow = 1.0\nhigh = 2.0\nstep = 1.0\n'
    scene = f'name = "many"\nzone = "none"\nego = {{ speed = "{" + ".join(names)}" }}\n'
    (tmp_path / "many.toml").write_text(scene + "".join(map(parameter.format, names)))
    sumo_eval(f"sample {tmp_path}/many.toml --method sobol --count 8 --out {tmp_path}/out")
    assert (tmp_path / "out" / "points.html").is_file()


def test_a_space_of_grid_points_alone_has_no_boundary_error(truck):
    truck.write_text(f'{EXAMPLE}\n[[constraint]]\nrequire = "ego_speed == 20.0"\n')
    assert "boundary: unknown, as no point" in sumo_eval("partition", truck).said


def test_who_names_no_folder_gets_a_new_one_under_results(truck, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = sumo_eval("sample", truck)
    (page,) = (tmp_path / "results").glob("slow_truck-points-*/points.html")
    assert str(page.relative_to(tmp_path)) in done.said


def test_the_same_seed_samples_the_same_points_and_another_seed_others(tmp_path):
    texts = []
    for number, seed in enumerate((1, 1, 2)):
        out = tmp_path / str(number)
        sumo_eval(f"sample cut_in --method sobol --count 8 --seed {seed} --out {out}")
        texts.append((out / "points.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


def test_a_single_point_is_one_point(tmp_path):
    done = sumo_eval(f"sample front_vehicle_braking --method sobol --count 1 --out {tmp_path}")
    assert "sobol, 1 point; constraints refuse 0 of 1 (0.0%)." in done.said


def test_points_of_the_first_round_are_named_so(tmp_path):
    done = sumo_eval(f"sample cut_in --method adaptive --count 20 --out {tmp_path}/20")
    assert "adaptive, 8 points" in done.said
    assert "The first round of 20 points" in done.said
    done = sumo_eval(f"sample cut_in --method adaptive --count 8 --out {tmp_path}/8")
    assert "first round" not in done.said


@pytest.mark.parametrize("what, key", [("scenario", "parameter"), ("evaluation", "ads")])
def test_schema_prints_a_json_schema(what, key):
    assert key in json.loads(sumo_eval("schema", what).said)["properties"]


def test_check_says_what_is_in_a_scenario_file_and_what_is_wrong(truck):
    assert "12 possible points; constraints refuse 3 more." in sumo_eval("check", truck).said
    truck.write_text(EXAMPLE.replace('"truck_speed < ego_speed"', '"truck_sped < ego_speed"'))
    cli_refuses("Did you mean `truck_speed`?", "check", truck)


def test_boundary_finds_an_edge_and_writes_it(tmp_path):
    held = "--fix ego_speed=30 --fix obstacle_speed=5"
    search = f"boundary front_vehicle_cut_out no_reaction {held} --budget 16 --workers 1"
    done = sumo_eval(f"{search} --out {tmp_path}/out")
    assert "no_reaction collides in 100.0% of the space" in done.said
    assert "Every trial ended alike" in done.said
    found = read_json(tmp_path / "out" / "boundary.json")
    assert found["simulations"] == 16
    assert found["held"] == {"ego_speed": 30.0, "obstacle_speed": 5.0}
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"trials.csv", "chances.csv", "boundary.json", "boundary.html"}


@pytest.mark.campaign
@pytest.mark.parametrize("held", [(), ("obstacle_speed=5",), ("ego_speed=30", "obstacle_speed=5")])
def test_an_edge_is_drawn_for_a_paper_from_what_the_search_wrote(tmp_path, held):
    pytest.importorskip("matplotlib")
    out = tmp_path / "edge"
    fixed = [word for value in held for word in ("--fix", value)]
    args = (
        "boundary",
        "front_vehicle_cut_out",
        "careful_driver",
        *fixed,
        "--budget",
        16,
        "--workers",
        1,
        "--out",
        out,
    )
    sumo_eval(*args)
    rows = (out / "chances.csv").read_text().splitlines()
    assert len(rows) == 1 + {0: 5 * 80 * 80, 1: 80 * 80, 2: 80}[len(held)]
    assert rows[0].endswith("gap,chance")
    sumo_eval(f"plot {out} boundary --out {tmp_path}/edge.svg")
    assert "collision" in (tmp_path / "edge.svg").read_text()
    cli_refuses("takes no `ads`", f"plot {out} boundary --ads idm")
    for damage in (rows[0], "\n".join([rows[0], *rows]), ""):
        (out / "chances.csv").write_text(damage)
        cli_refuses("Search it again.", f"plot {out} boundary")
    (out / "chances.csv").unlink()
    cli_refuses("Search it again.", f"plot {out} boundary")
