"""A run as tables: what pandas and duckdb read is what was recorded."""

import csv
import json
import shlex
import shutil

import numpy as np
import pandas as pd
import pytest
from commands import cli_refuses
from evaluations import small
from laid import read_json
from record.runs import sumo_eval_cli, write_evaluation
from refusals import refusal

import sumo_eval
from sumo_eval.record.exchange import _to_parquet, export
from sumo_eval.record.facts_file import FORMAT_VERSION
from sumo_eval.record.run_folder import read_exposures, write_exposures
from sumo_eval.record.store import open_store
from sumo_eval.report.tables import write_tables
from sumo_eval.settings.toml_file import read_toml


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exchange")
    sumo_eval_cli("run", write_evaluation(folder, levels=2), "--out", folder / "run")
    return folder / "run"


def test_an_opened_run_gives_tables_and_trajectories(run):
    opened = sumo_eval.open_run(run)
    assert set(opened.cases["ads"]) == {"mine", "idm"}
    assert list(opened.scores["ads"]) == ["mine", "idm"]
    drives = opened.drives
    assert set(drives["role"]) >= {"ads", "human"}
    assert opened.counts["drives"].sum() == len(drives)
    case = opened.cases["case"][0]
    with open_store(run) as store:
        expected = store.trajectory(case)
    assert np.array_equal(opened.trajectories(case)["ego"].x, expected.x)
    assert set(opened.trajectory_table(case)["vehicle"]) == {"ego", "lead"}
    with refusal("no trajectory of case `nobody`"):
        opened.trajectories("nobody")


def test_csv_brings_every_number_back(run, tmp_path):
    sumo_eval_cli("export", run, "--out", tmp_path)
    opened = sumo_eval.open_run(run)
    cases, drives = pd.read_csv(tmp_path / "cases.csv"), pd.read_csv(tmp_path / "drives.csv")
    assert list(cases["case"]) == list(opened.cases["case"])
    assert list(drives["case"]) == list(opened.drives["case"])
    assert {"parameter_ego_speed", "parameter_lead_speed"} <= set(drives.columns)
    with (tmp_path / "trajectories.csv").open(newline="") as file:
        samples = list(csv.DictReader(file))
    assert {row["case"] for row in samples} == set(drives["case"])
    case = drives["case"][0]
    x = [float(row["x"]) for row in samples if (row["case"], row["vehicle"]) == (case, "ego")]
    assert x == opened.trajectories(case)["ego"].x.tolist()


def test_parquet_holds_the_same_as_csv(run, tmp_path):
    duckdb = pytest.importorskip("duckdb")
    written = export(run, tmp_path / "it's here", "parquet")
    assert [path.name for path in written] == [
        "cases.parquet",
        "drives.parquet",
        "trajectories.parquet",
    ]
    export(run, tmp_path / "csv")
    with refusal("Unknown format `xlsx` of an export"):
        export(run, tmp_path, "xlsx")
    for path in written:
        expected = pd.read_csv(tmp_path / "csv" / f"{path.stem}.csv")
        table = duckdb.sql("SELECT * FROM read_parquet(?)", params=[str(path)])
        assert table.columns == list(expected.columns)
        assert len(table) == len(expected)
        if path.stem == "trajectories":
            np.testing.assert_allclose(table.fetchnumpy()["x"], expected["x"], rtol=1e-14)
    assert sorted(path.name for path in (tmp_path / "it's here").iterdir()) == sorted(
        p.name for p in written
    )


def test_parquet_holds_text_as_it_is_where_csv_quotes_it(tmp_path):
    duckdb = pytest.importorskip("duckdb")
    ads = dict.fromkeys(("=1+1", "-x", "'plain", "007", "NA"), "idm")
    evaluation = small(ads, drivers=2, steps={"ego_speed": 100.0, "lead_speed": 100.0})
    write_tables(sumo_eval.evaluate(evaluation, tmp_path / "run"))
    export(tmp_path / "run", tmp_path / "csv")
    export(tmp_path / "run", tmp_path / "parquet", "parquet")
    for table, column in (("cases", "ads"), ("drives", "driver")):
        rows = csv.DictReader((tmp_path / "csv" / f"{table}.csv").read_text().splitlines())
        assert {"'=1+1", "'-x", "'plain", "007", "NA"} <= {row[column] for row in rows}
        path = tmp_path / "parquet" / f"{table}.parquet"
        found = duckdb.sql(
            f"SELECT DISTINCT {column} FROM read_parquet(?)", params=[str(path)]
        ).fetchall()
        assert {(name,) for name in ads} <= set(found)
    assert set(sumo_eval.open_run(tmp_path / "run").cases["ads"]) == set(ads)


def test_names_of_digits_stay_texts(tmp_path):
    duckdb = pytest.importorskip("duckdb")
    evaluation = small({"007": "idm"}, drivers=2, steps={"ego_speed": 100.0, "lead_speed": 100.0})
    write_tables(sumo_eval.evaluate(evaluation, tmp_path / "run"))
    export(tmp_path / "run", tmp_path, "parquet")
    table = str(tmp_path / "cases.parquet")
    assert duckdb.sql("SELECT ads FROM read_parquet(?)", params=[table]).fetchall() == [("007",)]
    (tmp_path / "t.csv").write_text("collision_with,index\n1,\n")
    parquet = _to_parquet([tmp_path / "t.csv"], tmp_path)[0]
    columns = f"SELECT collision_with, typeof(index) FROM '{parquet}'"
    assert duckdb.sql(columns).fetchall() == [("1", "DOUBLE")]


@pytest.mark.parametrize("name", ["manifest.json", "exposure.json"])
def test_an_edited_file_of_a_run_is_reported_wherever_it_is_read(run, tmp_path, name):
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    content = read_json(copy / name)
    content["seed"] = 7
    (copy / name).write_text(json.dumps(content, indent=2))
    commands = [("score", copy), ("report", copy), ("compare", run, copy)]
    if name == "manifest.json":  # exposures are written again by a run that goes on
        commands += [
            ("run", "--out", copy, "--resume"),
            ("export", copy, "--out", tmp_path / "x"),
            ("verify", copy),
        ]
    for command in commands:
        cli_refuses(f"{name} is not as it was written", *command)


def test_a_scenario_may_be_called_as_the_seal(tmp_path):
    for exposures in ({"seal": {"known": True}}, {"cut_in": {}}):
        write_exposures(tmp_path, exposures)
        assert read_exposures(tmp_path) == exposures
    (tmp_path / "exposure.json").unlink()
    (tmp_path / "exposure.json").mkdir()
    with refusal("cannot be read: it is a folder"):
        read_exposures(tmp_path)


def test_a_run_that_is_none_unscored_or_newer_is_refused(run, tmp_path):
    for command in (("export", tmp_path, "--out", tmp_path / "out"), ("verify", tmp_path)):
        cli_refuses("is not a run folder", *command)
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("evaluation.toml", "facts.sqlite"):
        (copy / name).write_bytes((run / name).read_bytes())
    manifest = (run / "manifest.json").read_text()
    (copy / "manifest.json").write_text(manifest)
    with refusal(r"has not been scored, cases\.csv is missing"):
        export(copy, tmp_path / "out")
    (copy / "manifest.json").write_text(
        manifest.replace(f'"format_version": {FORMAT_VERSION}', '"format_version": 99')
    )
    with refusal("format version 99"):
        sumo_eval.open_run(copy)


def test_a_printed_command_takes_a_folder_with_spaces(run, tmp_path):
    copy = shutil.copytree(run, tmp_path / "it's my run")
    (copy / "cases.csv").unlink()
    with refusal() as unscored:
        export(copy, tmp_path / "out")
    with refusal() as no_file:
        read_toml(copy, "evaluation file")
    first = str(unscored.value).partition("first: ")[2].removesuffix(".")
    assert shlex.split(first) == ["sumo-eval", "score", str(copy)]
    assert shlex.split(str(no_file.value).split("`")[1]) == ["sumo-eval", "score", str(copy)]
