"""Evidence for a safety case, and the qualification that a run names."""

import hashlib
import json
import platform
import shutil
import sys
import tomllib
from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR
from importlib.metadata import version

import pytest
from laid import read_json
from refusals import refusal
from tables import rows_of, values_of

from sumo_eval import evaluate, score
from sumo_eval.record.qualification import read_qualification
from sumo_eval.report.checks import checks_content
from sumo_eval.report.evidence import _outward, evidence_of, write_evidence
from sumo_eval.report.qualification import qualification_content, qualification_sentence
from sumo_eval.report.terminal import closing_lines
from sumo_eval.report.verdict import Additions

SCENE = """name = "approach"
[[parameter]]
name = "gap0"
unit = "m"
low = 20.0
high = 60.0
step = 40.0
[ego]
speed = 20.0
[[vehicle]]
name = "lead"
speed = 10.0
gap = "gap0"
[zone]
obstacle = "lead"
[end]
x = 300.0
[[require]]
name = "keeps clear"
check = "collided == 0"
"""
HERE = {
    "python": sys.version.split()[0],
    **{name: version(name) for name in ("sumo_eval", "libsumo", "numpy", "scipy", "scikit-learn")},
}
MACHINE = {"system": platform.platform(), "processor": platform.machine(), "node": platform.node()}


def qualification(folder, passed=(True, True), **versions):
    """A file as `qualify` writes it, with so many checks."""
    path = folder / "qualification.json"
    content = {
        "format_version": 1, "created": "2026-11-22T08:00:00+00:00", "versions": HERE | versions,
        "machine": MACHINE,
        "checks": [{"name": f"check {k}", "passed": one} for k, one in enumerate(passed)],
    }  # fmt: skip
    path.write_text(json.dumps(content))
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evidence")
    (folder / "approach.toml").write_text(SCENE)
    content = tomllib.loads(f"""
name = "claims"
scenario = [{{ use = "{folder}/approach.toml" }}]
drivers = {{ count = 2 }}
ads = [{{ name = "nothing", controller = "no_reaction" }}, {{ name = "ideal", controller = "ideal_braking" }}]
run = {{ engine = "serial", qualification = "{qualification(folder)}" }}
""")
    evaluate(content, folder / "run", workers=1)
    return folder / "run"


def test_claims_say_what_the_facts_bear_out(run, tmp_path):
    """A car that does nothing closes 20 m at 10 m/s, and 60 m within 6 s and 120 m: both of its
    cases collide, the ideal vehicle's none. Of two equally frequent cases without a collision at
    least 1 - 0.025^(1/2) = 0.842 is open."""
    page, plain = write_evidence(score(run), tmp_path)
    found = read_json(plain)
    claims = {claim["id"]: claim for claim in found["claims"]}
    assert set(claims) == {
        f"approach/{ads}/{kind}"
        for ads in ("nothing", "ideal")
        for kind in ("complete", "collisions", "preventability", "avoided", "checks")
    }
    nothing, ideal = (claims[f"approach/{ads}/preventability"] for ads in ("nothing", "ideal"))
    assert nothing["verdict"] == "not supported"
    assert ideal["verdict"] == "supported"
    assert len(nothing["cases"]) == 2
    assert nothing["evidence"][0].startswith(
        "2 incidents: 2 preventable for a skilled driver, 0 unpreventable"
    )
    share = claims["approach/ideal/collisions"]
    assert share["claim"].endswith(
        "is below 0.842 in this space under equal weights of its points."
    )
    assert share["interval"]["high"] == pytest.approx(1.0 - 0.025**0.5)
    # both of its cases: no limit below 1 can be told
    everything = claims["approach/nothing/collisions"]
    assert everything["interval"]["high"] == 1.0
    assert everything["verdict"] == "open"
    assert share["verdict"] == "supported"
    assert any("every point counts the same" in text for text in share["assumptions"])
    assert claims["approach/nothing/checks"]["verdict"] == "not supported"
    assert claims["approach/ideal/checks"]["verdict"] == "supported"
    assert (
        found["hashes"]["facts.sqlite"]
        == hashlib.sha256((run / "facts.sqlite").read_bytes()).hexdigest()
    )
    assert (
        found["run"]["id"] == hashlib.sha256((run / "manifest.json").read_bytes()).hexdigest()[:16]
    )
    assert found["qualified"]
    text = page.read_text()
    assert "unpreventable for a skilled driver" in text
    first_what_is_not_borne_out = sorted(found["claims"], key=lambda claim: str(claim["verdict"]))
    places = [text.index(f"<code>{claim['id']}</code>") for claim in first_what_is_not_borne_out]
    assert places == sorted(places)


def test_nothing_is_claimed_of_harm_that_no_vehicle_could_do(run):
    """Where a car that does nothing touches nobody A is 1 by definition, with 1 to 1 as its
    interval."""
    whole = score(run)
    calm = replace(whole.scores[0], avoided_share=1.0, avoided_share_interval=(1.0, 1.0))
    (claim,) = (
        it for it in evidence_of(replace(whole, scores=(calm,))).claims if it.id.endswith("avoided")
    )
    assert claim.claim == f"{calm.ads} in approach had harm to avoid."
    assert claim.verdict == "open"


def test_a_varied_condition_is_no_missing_condition(run):
    """`No conditions are set` would be false of a space with a parameter `conditions.`."""
    whole = score(run)
    logical = whole.scenarios["approach"]
    delay = replace(logical.parameters[0], name="conditions.perception_delay")
    varied = replace(logical, parameters=(*logical.parameters, delay))

    def assumed(evaluation):
        return " ".join(evidence_of(evaluation).claims[1].assumptions)

    assert "no conditions are set" in assumed(whole)
    assert "no conditions are set" not in assumed(replace(whole, scenarios={"approach": varied}))


def test_points_alike_in_six_digits_are_two_rows_of_checks(run):
    whole = score(run)
    # Python's hashes of -1.0 and -2.0 are equal
    for near, words in (((40.00001, 40.00002), ["gap0=40", "gap0=40"]),
                        ((-1.0, -2.0), ["gap0=-1", "gap0=-2"])):  # fmt: skip
        gap = dict(zip((20.0, 60.0), near, strict=True))
        cases = [replace(it, values={"gap0": gap[it.values["gap0"]]}) for it in whole.cases]
        (table,) = checks_content(replace(whole, cases=tuple(cases)), Additions())["tables"]
        assert table["of"] == 2
        assert [point for point, _ in table["rows"]] == words


def test_the_report_carries_the_qualification_that_the_run_names(run):
    evaluation = score(run)
    (sentence,) = (line for line in closing_lines(evaluation) if line.startswith("Qualification"))
    assert sentence == (
        "Qualification of 2026-11-22T08:00:00+00:00: 2 of 2 known answers were found again, with "
        "the versions and on "
        "the machine of this run."
    )
    assert qualification_content(evaluation, Additions())["holds"]


def test_a_continued_run_needs_no_qualification(run, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    moved = run.parent / "qualification.json"
    kept = moved.read_bytes()
    moved.unlink()
    try:
        again = evaluate(None, tmp_path / "run", resume=True, workers=1)
        assert again.manifest["qualification"]["checks"] == 2
    finally:
        moved.write_bytes(kept)


@pytest.mark.parametrize(
    "passed, versions, sentence",
    [
        (
            (True, False),
            {},
            "1 of 2 known answers were found again, so the tool is NOT qualified: check 1.",
        ),
        (
            (True, True),
            {"libsumo": "1.0.0"},
            f"not with what made this run: libsumo 1.0.0 instead of {HERE['libsumo']}.",
        ),
    ],
)
def test_a_qualification_that_does_not_hold_is_said_to(tmp_path, passed, versions, sentence):
    named = read_qualification(
        "qualification.json", qualification(tmp_path, passed, **versions).parent
    )
    manifest = {"qualification": named, "versions": HERE, "machine": MACHINE}
    assert qualification_sentence(manifest).endswith(sentence)
    assert read_qualification(".", tmp_path) == named  # the folder will do


@pytest.mark.parametrize(
    "text, sentence",
    values_of("""
    None, "There is no qualification"
    "[]", "is not what `sumo-eval qualify` writes"
    "{", "is not what `sumo-eval qualify` " "writes"
    '{"checks": 3}', "is not what `sumo-eval qualify` writes"
    '{"checks": [], "created": "", "versions": {}, "machine": {}}', "holds no checks"
    """),
)  # fmt: skip
def test_a_wrong_qualification_is_refused_before_any_drive(tmp_path, text, sentence):
    if text is not None:
        (tmp_path / "q.json").write_text(text)
    content = tomllib.loads(f"""
name = "n"
scenario = [{{ use = "cut_in" }}]
ads = [{{ name = "idm", controller = "idm" }}]
run = {{ qualification = "{tmp_path}/q.json" }}
""")
    with refusal(sentence):
        evaluate(content, tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "end, below, at_least",
    rows_of("""
0.49977 | 0.5 | 0.499
0.5 | 0.5 | 0.5
0.1 | 0.1 | 0.1
0.0 | 0 | 0
-0.12345 | -0.123 | -0.124
1.2341e-07 | 1.24e-07 | 1.23e-07
""", float),
)  # fmt: skip
def test_a_claim_rounds_to_the_side_that_claims_less(end, below, at_least):
    assert _outward(end, ROUND_CEILING) == below
    assert _outward(end, ROUND_FLOOR) == at_least
