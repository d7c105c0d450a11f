"""Files that a user's scenario comes from: found whatever else stands on the line of their name."""

import pytest

from sumo_eval.record.scenario_files import files_of, hashes_of_scenario


@pytest.mark.parametrize(
    "scenario, text",
    [
        ("mine.toml", """joint = {about = "the driver's choice", events = "events.csv"}"""),
        ("mine.xosc", """<A author="O'Brien"><LogicFile filepath="events.csv"/></A>"""),
        ("mine.toml", """joint = {kind = 'a "kde"', events = 'events.csv'}"""),
        ("mine.toml", """joint = {events = "driver's.csv"}"""),
    ],
)
def test_a_named_file_counts_beside_an_apostrophe(tmp_path, scenario, text):
    (tmp_path / scenario).write_text(text)
    events = tmp_path / ("driver's.csv" if "driver's.csv" in text else "events.csv")
    events.write_text("1")
    assert files_of(scenario, tmp_path) == sorted([events, tmp_path / scenario])
    before = hashes_of_scenario(scenario, tmp_path)
    events.write_text("2")
    assert hashes_of_scenario(scenario, tmp_path) != before
