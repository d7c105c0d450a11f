"""The line that a run is cited by."""

from dataclasses import replace

import pytest
from evaluations import settings_of

from sumo_eval.report.citation import citation, digest
from sumo_eval.settings.config import suite_of


def test_citation_names_run_versions_seed_digest_and_command(evaluation):
    line = citation(evaluation)
    for part in (
        evaluation.name,
        "sumo_eval 0.0",
        "libsumo 1.28",
        "seed 0",
        digest(evaluation),
        "sumo-eval verify",
    ):
        assert part.replace("seed 0", f"seed {evaluation.settings.seed}") in line
    assert "\n" not in line


def test_digest_follows_every_score_and_no_order(evaluation):
    first, *rest = evaluation.scores
    assert digest(replace(evaluation, scores=(*rest, first))) == digest(evaluation)
    for changed in ({"s": 1.0}, {"avoided_share": 0.1}, {"departures": 7}, {"ads": "other"}):
        other = replace(evaluation, scores=(replace(first, **changed), *rest))
        assert digest(other) != digest(evaluation)
    once, again = (
        digest(replace(evaluation, scores=(replace(first, avoided_share=noise), *rest)))
        for noise in (-1e-12, 1e-12)
    )
    assert once == again, "the last bits are the machine's"


@pytest.mark.parametrize("changes", [{}, {"seed": 99}])
def test_suite_is_named_only_as_it_is(evaluation, changes):
    settings = replace(settings_of(scenario=[{"use": "suite:2026.1"}]), **changes)
    assert suite_of(settings) == ("" if changes else "2026.1")
    assert ("suite 2026.1" in citation(replace(evaluation, settings=settings))) == (not changes)
