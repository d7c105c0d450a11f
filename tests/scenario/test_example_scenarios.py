"""The scenario files of docs/examples/scenarios can be read, placed at their points and driven, in packs as alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.sampling.samples import sample

FILES = sorted((Path(__file__).parents[2] / "docs" / "examples" / "scenarios").glob("*.toml"))


def test_every_file_has_a_line_in_the_page_and_says_that_its_ranges_are_no_limits() -> None:
    page = (Path(__file__).parents[2] / "docs" / "traffic.md").read_text(encoding="utf-8")
    assert len(FILES) == 11
    for file in FILES:
        assert f"[`{file.stem}`](examples/scenarios/{file.name})" in page
        assert "research range, not a standard limit" in read_scenario(file).source


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_file_drives_at_points_of_its_space_and_somebody_who_does_nothing_may_collide(file: Path) -> None:
    assert "possible points" in check_file(file)[1]
    logical = read_scenario(file)
    points = sample(logical).points
    chosen = points[np.random.default_rng(0).permutation(len(points))[:12]]
    cases = logical.concretes(chosen)
    packed = list(simulate_many(cases, "no_reaction"))
    alone = simulate(cases[0], "no_reaction")
    assert all(found.error is None for found in packed)
    assert any(found.collision is not None for found in packed)
    for name, track in alone.actors.items():
        assert np.array_equal(track.x, packed[0].actors[name].x)
        assert np.array_equal(track.y, packed[0].actors[name].y)
