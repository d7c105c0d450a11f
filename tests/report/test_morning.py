"""What a night leaves for the morning: summary, chat, annotations, JUnit; the pin, and a drift
beside it."""

import contextlib
import functools
import json
import os
import shlex
import sqlite3
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import junitparser
import pytest
import report_cases
from builders import CALM, LOW_SPEED
from laid import read_json
from refusals import refusal
from report_cases import HIT, pick, with_case
from report_cases import calm as with_calm

from sumo_eval.nightly.bases import (
    Bases,
    _steady,
    accept,
    find_bases,
    finished_within,
    in_force,
    pin_of,
    pinned_by_itself,
)
from sumo_eval.nightly.gates import judge
from sumo_eval.nightly.history import Accepted, GateLine, ShakyCase, open_history
from sumo_eval.nightly.judgement import (
    Judgement,
    Since,
    failing_since,
    judge_night,
    judge_repeats,
    new_pin,
)
from sumo_eval.nightly.morning import _code, github_annotations, tell_github, write_night
from sumo_eval.nightly.night import _prune, _refuse_without_history, _size
from sumo_eval.nightly.repeats import _differences, bad_again, shaky_cases
from sumo_eval.nightly.rule_limits import EVERYWHERE, judge_rule
from sumo_eval.nightly.trend import write_trend
from sumo_eval.record.progress import quiet
from sumo_eval.report.gate_result import GateResult, failed, in_order
from sumo_eval.report.junit import comparison_suites, write_junit
from sumo_eval.scoring.comparison import compare
from sumo_eval.scoring.gate_settings import GateSettings, LimitSettings
from sumo_eval.scoring.rule import Noise, Repeats

SETTINGS = GateSettings(resamples=100)
FIRST, SECOND = "2026-11-24T02-00-00Z", "2026-11-25T02-00-00Z"


night = functools.partial(report_cases.night, verdict="WORSE than *yesterday*")


def built(evaluation, build):
    return replace(evaluation, manifest={**evaluation.manifest, "builds": {CALM: build}})


def calm(evaluation, gap):
    """Every case of `calm` that ended well came as near as that, m."""
    return with_calm(evaluation, min_gap=gap, min_ttc=9.0)


def nearer(evaluation, gap):
    """One case of `calm` alone came as near as that, m."""
    return with_case(evaluation, pick(evaluation, collided=False), min_gap=gap, min_ttc=9.0)


@pytest.fixture
def judged(evaluation):
    """A night in which one case came nearer and whose ADS is another build."""
    base, new = built(calm(evaluation, 0.92), "abc"), built(calm(evaluation, 0.92), "def")
    new = nearer(new, 0.32)
    comparison = compare(base, new, SETTINGS)
    bases = Bases(night(FIRST), None, comparison, None, (), unusable=False)
    gates = judge(new, comparison, SETTINGS)
    return Judgement(bases, gates, Noise(), frozenset(), {CALM: "def"})


@pytest.fixture
def folder(judged, tmp_path):
    """What that night wrote."""
    found = tmp_path / "nights" / SECOND
    found.mkdir(parents=True)
    since = {gate.name: Since(SECOND, 1) for gate in failed(judged.gates)}
    write_night(tmp_path, night(SECOND, 1), "worse", judged._replace(since=since), ())
    return found


def test_a_history_whose_path_is_not_utf8_has_its_results(judged, tmp_path):
    history = tmp_path / os.fsdecode(b"nights\xff")
    (history / "nights" / SECOND).mkdir(parents=True)
    since = {gate.name: Since(SECOND, 1) for gate in failed(judged.gates)}
    write_night(history, night(SECOND, 1), "worse", judged._replace(since=since), ())
    (limit,) = read_json(history / "nights" / SECOND / "night.json")["failed"]
    assert str(history) in limit["cases"][0]["replay"]


def test_summary_and_chat_say_what_failed_and_since_when(judged, folder):
    (gate,) = failed(judged.gates)
    case = gate.worst[0].case
    summary = (folder / "summary.md").read_text()
    chat = read_json(folder.parents[1] / "chat.json")["text"]
    assert summary.startswith("## WORSE than \\*yesterday\\*\n")
    assert f"- **{CALM}** in {gate.scenario} (new): smallest gap ahead: 1 worse" in summary
    assert f"`{case}`: " in summary
    assert f"--only {case}`" in summary
    assert f"build of {CALM}: abc in the base, def in the new run" in summary
    assert "smallest gap ahead: 1 worse, 0 better" in chat
    assert f"{case}: 0.92 m -> 0.32 m" in chat
    assert f"differs: build of {CALM}: abc in the base, def in the new run" in chat


def test_a_name_with_backticks_is_code_of_the_summary():
    assert _code("a`b``") == "``` a`b`` ```"


def test_night_json_names_case_and_ways_to_it(folder):
    told = read_json(folder / "night.json")
    (one,) = told["failed"]
    (case,) = one["cases"]
    assert case["before"] == 0.92
    assert case["after"] == 0.32
    assert case["replay"] == f"sumo-eval replay {folder} {case['case']}"
    assert case["run"] == f"sumo-eval run {folder} --only {case['case']}"
    assert case["link"] == f"report.html#case:{case['case']}"
    assert told["builds"] == {CALM: "def"}


def test_accept_lists_the_cases_that_it_accepts(judged, folder, evaluation):
    history = folder.parents[1]
    add(history, SECOND, evaluation, *judged.gates)
    (gate,) = failed(judged.gates)
    told = read_json(folder / "night.json")
    told["failed"].append({**told["failed"][0], "quantity": "pet"})
    (folder / "night.json").write_text(json.dumps(told))
    _, accepted, remaining = accept(history, None, "closer on purpose", None)
    sentence, moved = f"{gate.ads} in {gate.scenario}: {gate.sentence}", "0.92 m -> 0.32 m"
    assert accepted == [sentence, f"{gate.worst[0].case}: min_gap {moved}; pet {moved}"]
    assert not remaining


@pytest.mark.parametrize("alone", [True, False])
def test_a_limit_on_own_values_is_not_accepted(alone, judged, folder, evaluation):
    """`S` of at least 101 fails whatever the base; only a limit beside it can be accepted."""
    limit = GateSettings(limit=(LimitSettings("S", ads=CALM, at_least=101.0),))
    own = failed(judge(evaluation, None, limit))
    gates = own if alone else (*own, *failed(judged.gates))
    since = {gate.name: Since(SECOND, 1) for gate in gates}
    write_night(
        folder.parents[1], night(SECOND, 1), "worse", judged._replace(gates=gates, since=since), ()
    )
    add(folder.parents[1], SECOND, evaluation, *gates)
    if alone:
        with refusal("fails by limits on its own values alone"):
            accept(folder.parents[1], None, "on purpose", None)
    else:
        accepted = accept(folder.parents[1], None, "on purpose", None)
        assert len(accepted.remaining) == len(own)
        assert all("S is" in sentence for sentence in accepted.remaining)
        assert len(accepted.accepted) == 2


def test_an_annotation_is_one_line_for_github(judged):
    """GitHub decodes `:` and `,` in a title, and not in a message."""
    (gate,) = failed(judged.gates)
    (line,) = github_annotations([gate._replace(quantity="a: b, c", sentence="d: e, 5 %")])
    assert line.startswith(f"::error title=a%3A b%2C c of {CALM}::d: e, 5 %25%0A")
    (line,) = github_annotations(judged.gates)
    head, _, body = line.removeprefix("::").partition("::")
    assert head == f"error title=min_gap of {CALM}"
    assert "\n" not in line
    assert "0.92 m -> 0.32 m" in body


def test_a_summary_that_cannot_be_written_is_only_said(judged, folder, monkeypatch):
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder))
    said = tell_github(SimpleNamespace(judged=judged, report=folder / "report.html"))
    assert said[0].startswith("$GITHUB_STEP_SUMMARY cannot be written: [Errno 21]")


def test_new_failures_stand_first_and_of_these_the_gravest_ends(judged):
    (gate,) = failed(judged.gates)
    names = "min_ttc", "departed", "min_gap", "severity", "collided"
    other, old, near, harder, hit = (gate._replace(quantity=name) for name in names)
    other = other._replace(passed=True)
    nights = {old.name: 2} | dict.fromkeys((near.name, harder.name, hit.name), 1)
    assert in_order([other, old, near, harder, hit], nights) == (hit, harder, near, old, other)


def test_junit_has_values_before_and_after(judged, tmp_path):
    write_junit(comparison_suites(judged.bases.comparison, judged.gates), tmp_path / "junit.xml")
    suites = junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    (bad,) = [
        case for suite in suites if suite.name == "gates" for case in suite if case.is_failure
    ]
    assert "0.92 m -> 0.32 m" in bad.result[0].text
    assert "--only" in bad.result[0].text


def test_a_drift_of_two_percent_is_found_by_night_ten(evaluation):
    """0.9 m times 0.98 a night: 0.1 m are gone after 6 nights (0.9 (1 - 0.98^5) = 0.086, ^6 =
    0.103)."""
    pinned = calm(evaluation, 0.9)

    def fails(base, number):
        tonight = calm(evaluation, 0.9 * 0.98**number)
        return bool(failed(judge_rule(compare(base, tonight, SETTINGS), SETTINGS, Noise())))

    assert not any(
        fails(calm(evaluation, 0.9 * 0.98 ** (number - 1)), number) for number in range(1, 11)
    )
    assert [fails(pinned, number) for number in (5, 6, 10)] == [False, True, True]


def test_a_limit_holds_against_the_accepted_night_too(evaluation, tmp_path, monkeypatch):
    """4 cm a night pass a limit of 5 cm each time; beside the accepted night it is 8 cm."""
    limit = LimitSettings("min_gap", ads=CALM, worse_by=0.05)
    gate = replace(SETTINGS, limit=(limit,), noise=replace(SETTINGS.noise, cases=0))
    tonight = calm(evaluation, 0.82)
    good, accepted = (compare(calm(evaluation, gap), tonight, gate) for gap in (0.86, 0.9))
    accepted = accepted._replace(base_folder=tmp_path / FIRST)
    bases = Bases(night(SECOND), night(FIRST), good, accepted, (), unusable=False)
    monkeypatch.setattr("sumo_eval.nightly.judgement.find_bases", lambda *_: bases)
    with open_history(tmp_path, create=True) as lines:
        gates = judge_night(tmp_path, lines, tonight, gate, quiet).gates
    assert {(gate.quantity, gate.against) for gate in failed(gates)} == {("min_gap", FIRST)}


def pin_after(history, comparison, noise=Noise()):  # noqa: B008 - frozen
    """The night that is pinned after one that is compared so."""
    bases = Bases(None, night(FIRST), comparison, None, (), unusable=False)
    with open_history(history, create=True) as lines:
        line = night(SECOND)
        pin = new_pin(line, Judgement(bases, (), noise, frozenset(), {}), lines, SETTINGS)
        return pin.reason if pin else ""


def test_lost_repeatability_fails_and_names_its_cases(evaluation):
    """All repeated in the last good night: six that differ tonight fail, 1/64 by chance; five are
    named only. After seven such nights in a row two fail, 1/64. A slower drive does not differ."""
    line = GateLine(FIRST, CALM, EVERYWHERE, "repeats", True, None, "")
    cases = [row for row in evaluation.cases if row.ads == CALM and row.max_jerk]

    def limits(lines, number):
        other = [replace(case, max_jerk=9.0) for case in cases[:number]]
        rows = {row.case: replace(row, latency_relative=99.0) for row in other + cases[number:]}
        repeats = Repeats(30, 0, *_differences(evaluation, CALM, rows, SETTINGS))
        history = SimpleNamespace(gates=lambda: lines)
        noise = Noise({CALM: repeats})
        return list(judge_repeats(noise, night(FIRST), history, SETTINGS))

    for lines, number in (([line], 5), ([], 6), ([line] * 6, 2), ([line._replace(passed=None)], 6)):
        (gate,) = limits(lines, number)
        assert (gate.passed, cases[0].case in gate.sentence) == (None, True)
    assert limits([line] * 7, 2)[0].passed is False
    assert limits([line, line._replace(passed=None), *[line] * 6], 2)[0].passed is None
    (gate,) = limits([line], 6)
    assert (gate.passed, gate.worst[0].words) == (False, "largest jerk 1.5 m/s³ -> 9 m/s³")
    # a note counts those that differ at all
    assert limits([], 0)[0].sentence == (
        "0 of 30 cases differed beyond tolerances in a second drive"
    )
    assert limits([], 0)[0].passed


def test_reruns_count_for_each_base(evaluation, monkeypatch):
    """A noisy ADS collides in all five drives, softly in four. Compared with the good base, five
    are bad. Compared with the accepted base, which collided, the hard one is."""
    case = pick(evaluation, collided=False)
    softly, hard = (with_case(evaluation, case, **HIT | {"severity": u}) for u in (6.0, 9.0))
    comparisons = [compare(base, hard, SETTINGS) for base in (evaluation, softly)]
    monkeypatch.setattr(
        "sumo_eval.nightly.repeats._rerun",
        lambda _, keys, __: {key: softly.case(key) for key in keys},
    )
    noise = Noise({CALM: Repeats(30, 0)})
    bad = bad_again(comparisons, hard, noise, SETTINGS, None)
    assert bad == [{case.case: 5}, {case.case: 1}]
    assert not shaky_cases(hard, bad, SETTINGS), "no drive was as good as the good base"
    assert shaky_cases(hard, bad[1:], SETTINGS)
    results = judge_rule(comparisons[0], SETTINGS, noise._replace(bad=bad[0]))
    assert [gate.quantity for gate in failed(results)] == ["collided"]


def test_only_what_a_base_did_may_be_chance(evaluation, tmp_path):
    """Cases that were bad in some drives count from good and accepted nights; all repeats alike in
    the base, as its `night.json` has them, leave nothing to chance."""
    failed_case, good_case = (ShakyCase("calm", "cut_in", point) for point in ("gap 1", "gap 2"))
    with open_history(tmp_path, create=True) as lines:
        lines.add(night(FIRST, 1), evaluation, (), shaky=[failed_case])
        lines.add(night(SECOND), evaluation, (), shaky=[good_case])
        assert lines.shaky() == {good_case}
        lines.accept(Accepted(FIRST, FIRST, "known", None, itself=False))
        assert lines.shaky() == {failed_case, good_case}
    record = tmp_path / "night.json"
    assert not _steady(record)
    repeats = {"steady": {"cases": 3, "alike": 3}, "noisy": {"cases": 3, "alike": 2}}
    record.write_text(json.dumps({"repeats": repeats | {"none": {"cases": 0, "alike": 0}}}))
    assert _steady(record) == {"steady"}
    record.write_text("{")
    with refusal("Remove this file"):
        _steady(record)


def test_only_a_better_night_moves_the_pin(evaluation, tmp_path):
    base = calm(evaluation, 0.9)
    better, same = compare(base, nearer(base, 1.5), SETTINGS), compare(base, base, SETTINGS)
    assert pin_after(tmp_path, None) == "the first good night"
    add(tmp_path, FIRST, evaluation)
    accept(tmp_path, FIRST, "begun", None)
    assert pin_after(tmp_path, better) == "paired cases only improved"
    assert pin_after(tmp_path, same) == ""
    assert pin_after(tmp_path, compare(base, nearer(base, 0.89), SETTINGS)) == ""
    assert pin_after(tmp_path, better, Noise({CALM: Repeats(30, 29)})) == "", "it would ratchet"
    add(tmp_path, SECOND, evaluation)
    accept(tmp_path, SECOND, "while the night ran", None)
    assert pin_after(tmp_path, better) == "", "it would replace the user's choice"


def test_an_acceptance_of_yesterday_counts_no_more(evaluation, tmp_path):
    for name in (FIRST, SECOND):
        add(tmp_path, name, evaluation)
    for until, pinned in (("2999-01-01", SECOND), ("2026-11-24", FIRST)):
        accept(tmp_path, FIRST, "begun", None)
        with open_history(tmp_path) as lines:
            lines.accept(Accepted(SECOND, FIRST, "softer brakes", until, itself=False))
            pin = pin_of(lines)
        assert pin.night == pinned


def test_the_trend_shows_departures_builds_and_acceptance(evaluation, tmp_path):
    add(tmp_path, FIRST, built(calm(evaluation, 0.9), "abc"))
    accept(tmp_path, FIRST, "softer brakes", "2999-01-01")
    with open_history(tmp_path) as lines:
        near = sum(one.value or 0.0 for one in lines.values() if one.quantity == "near_misses")
        page = write_trend(tmp_path, lines).read_text()
    assert near >= sum(case.ads == CALM and case.status == "ok" for case in evaluation.cases)
    for words in (
        ">Left the road",
        ">Near misses",
        "accepted: softer brakes, until 2999-01-01",
        f"{CALM} abc",
    ):
        assert words in page


def test_the_command_for_a_folder_with_a_blank_is_quoted(tmp_path):
    lost = tmp_path / "my nights" / "nights" / FIRST
    lost.mkdir(parents=True)
    with refusal() as error:
        _refuse_without_history(lost.parents[1])
    _, _, command = str(error.value).partition("of these nights: ")
    words = shlex.split(command.partition(". Nothing")[0])
    assert words == ["sumo-eval", "trend", str(lost.parents[1]), "--import", str(lost)]


# --- order of nights, accepted nights, since when a limit fails -----------------------------------


FUTURE, TODAY, LATER = "2999-01-01T02-00-00Z", SECOND, "2026-11-26T02-00-00Z"
FAILED = GateResult("min_gap", CALM, LOW_SPEED, False, "smallest gap: 1 nearer", 1.0, None)


def add(history, name, evaluation, *gates, imported=False):
    (history / "nights" / name).mkdir(parents=True, exist_ok=True)
    with open_history(history, create=True) as lines:
        lines.add(night(name, int(bool(gates)))._replace(imported=imported), evaluation, gates)


def test_a_clock_that_ran_ahead_once_decides_nothing(evaluation, tmp_path):
    for name in (FUTURE, TODAY, LATER):
        add(tmp_path, name, evaluation)
    with open_history(tmp_path, create=True) as lines:
        assert [night.night for night in lines.nights()] == [FUTURE, TODAY, LATER]
        _prune(tmp_path, lines, keep=1)
    assert [path.name for path in (tmp_path / "nights").iterdir()] == [LATER]


def test_a_link_that_leads_nowhere_has_a_size(tmp_path):
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    assert _size(tmp_path) > 0


def test_an_expired_acceptance_gives_way_to_the_one_before():
    first = Accepted("a", "2026-11-01", "the first good night", None, itself=True)
    second = Accepted("b", "2026-11-02", "on purpose", "2026-11-25", itself=False)
    assert in_force([first, second], "2026-11-25") == [first, second]
    assert in_force([first, second], "2026-11-26") == [first]
    assert pinned_by_itself("c", "only improved", second).until == "2026-11-25"


def test_pruning_keeps_each_night_that_will_be_the_pin(evaluation, tmp_path):
    """The last acceptance counts until January, the one before until March, then the first."""
    names = [f"2026-11-{day}T02-00-00Z" for day in range(20, 25)]
    for name in names:
        add(tmp_path, name, evaluation)
    with open_history(tmp_path, create=True) as lines:
        for name, until in zip(
            names, (None, "2998-12-31", "2999-03-31", "2999-01-31"), strict=False
        ):
            lines.accept(Accepted(name, "2026-11-25", "on purpose", until, itself=False))
        _prune(tmp_path, lines, keep=1)
    left = sorted(path.name for path in (tmp_path / "nights").iterdir())
    assert left == [names[0], *names[2:]]


def test_a_night_that_is_no_base_is_named_once_a_gone_one_not(evaluation, tmp_path):
    for name in (FUTURE, TODAY, LATER):
        add(tmp_path, name, evaluation)
    (tmp_path / "nights" / FUTURE).rmdir()
    with open_history(tmp_path) as lines:
        lines.accept(pinned_by_itself(LATER, "first", None))
        bases = find_bases(tmp_path, lines, evaluation, GateSettings())
        assert [note.split()[1] for note in bases.notes] == [LATER, TODAY]
        assert bases.unusable
        for name in (TODAY, LATER):
            (tmp_path / "nights" / name).rmdir()
        bases = find_bases(tmp_path, lines, evaluation, GateSettings())
    assert bases.notes[0] == "The folders of all good nights are gone."
    assert bases.unusable


def test_accept_keeps_what_when_and_why(evaluation, tmp_path):
    add(tmp_path, TODAY, evaluation)
    add(tmp_path, LATER, evaluation, FAILED)
    add(tmp_path, FUTURE, evaluation, imported=True)
    night, accepted, _ = accept(tmp_path, None, "softer on purpose", None)
    assert night.night == LATER
    assert accepted == [f"{CALM} in {LOW_SPEED}: smallest gap: 1 nearer"]
    with open_history(tmp_path) as lines:
        pin = pin_of(lines)
    assert (pin.night, pin.reason, pin.until, pin.itself) == (
        LATER,
        "softer on purpose",
        None,
        False,
    )
    for name, reason, until, words in (
        (LATER, " ", None, "--reason must say why"),
        (LATER, "x", "2020-12-31", "--until must be today"),
        ("2026-11-25T02-00-01Z", "x", None, "Did you mean"),
    ):
        with refusal(words):
            accept(tmp_path, name, reason, until)
    edited = '{"failed": [1]}', '{"failed": [{"cases": [{}]}]}'
    for text in ('{"night"', "{}", "[]", *edited):
        (tmp_path / "nights" / LATER / "night.json").write_text(text)
        with refusal("is damaged"):
            accept(tmp_path, LATER, "x", None)


def test_a_failure_says_since_when_without_a_break(evaluation, tmp_path):
    """It failed in the first night, not in the second, then in the third and tonight: since the
    third, 2 nights."""
    for name, gates in ((FUTURE, (FAILED,)), (TODAY, ()), (LATER, (FAILED,))):
        add(tmp_path, name, evaluation, *gates)
    with open_history(tmp_path) as lines:
        since = failing_since(lines, [FAILED], "tonight")[FAILED.name]
    assert since.night == LATER
    assert since.nights == 2
    assert since.words == f"since {LATER}, 2 nights"


def test_a_failure_that_spreads_keeps_its_name_and_since(evaluation, tmp_path):
    """A near miss in one scenario, in the next night in two."""
    cases = [
        next(case for case in evaluation.cases if (case.ads, case.scenario) == key and case.min_gap)
        for key in ((CALM, scenario) for scenario in evaluation.scenario_names)
    ]
    nights = [evaluation]
    for case in cases:
        nights.append(with_case(nights[-1], case, status="ok", min_gap=0.1))
    one, two = (
        next(gate for gate in failed(gates) if gate.quantity == "min_gap")
        for gates in (
            judge(new, compare(evaluation, new, SETTINGS), SETTINGS) for new in nights[1:]
        )
    )
    add(tmp_path, TODAY, evaluation, one)
    with open_history(tmp_path) as lines:
        since = failing_since(lines, [two], LATER)
    assert since[two.name].nights == 2
    assert f", worse in {cases[0].scenario}, {cases[1].scenario}" in two.sentence


def test_each_limit_of_a_quantity_has_its_own_since(evaluation, tmp_path):
    """Three limit the smallest gap; in the night before, only the first of the file failed."""
    first, second = (FAILED._replace(bound=f"below {gap} m", own=True) for gap in ("0.5", "1"))
    add(tmp_path, TODAY, evaluation, first)
    with open_history(tmp_path) as lines:
        since = failing_since(lines, [FAILED, first, second], LATER)
    assert [since[gate.name].nights for gate in (FAILED, first, second)] == [1, 2, 1]
    # a history of an earlier version has no bounds
    with contextlib.closing(sqlite3.connect(tmp_path / "history.sqlite")) as file:
        file.execute("ALTER TABLE gates DROP COLUMN bound")
    for create in (False, True):
        with open_history(tmp_path, create=create) as lines:
            assert [line.bound for line in lines.gates()] == [""]
    add(tmp_path, LATER, evaluation, first)


def test_a_dead_mans_switch_knows_its_hours(evaluation, tmp_path):
    """From 02:00 to 04:00 of the next day are 26 h."""
    add(tmp_path, TODAY, evaluation)
    on_time, late = (datetime(2026, 11, 26, 4, 0, second, tzinfo=UTC) for second in (0, 1))
    assert finished_within(tmp_path, "26h", on_time)[0]
    assert not finished_within(tmp_path, "26h", late)[0]
    assert finished_within(tmp_path, "2d", late) == (
        True, f"The last finished night {TODAY} began 26.0 h ago, within 2d."
    )  # fmt: skip
    before = datetime(2026, 1, 1, 2, tzinfo=UTC)  # after such a night the clock went back
    recent, words = finished_within(tmp_path, "26h", before)
    assert (recent, words.endswith("began 7872.0 h from now, more than 26h.")) == (False, True)
    for age in ("26", "h", "0h", "-1h", "999999d", "26 h"):
        with refusal("such as 26h"):
            finished_within(tmp_path, age)
