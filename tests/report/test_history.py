"""The order of nights, accepted nights, and since when a limit fails: histories without a drive."""

from datetime import UTC, datetime

import builders
from refusals import refusal

from sumo_eval.nightly.bases import (
    accept,
    find_bases,
    finished_within,
    in_force,
    pin_of,
    pinned_by_itself,
)
from sumo_eval.nightly.history import Accepted, Night, open_history
from sumo_eval.nightly.judged import failing_since
from sumo_eval.nightly.night import _prune, _size
from sumo_eval.report.gate_result import GateResult
from sumo_eval.scoring.gate_settings import GateSettings

FUTURE, TODAY, LATER = "2999-01-01T02-00-00Z", "2026-11-25T02-00-00Z", "2026-11-26T02-00-00Z"
FAILED = GateResult(
    "min_gap", builders.CALM, builders.SCENARIOS[0], False, "smallest gap: 1 nearer", 1.0, None
)


def add(history, name, evaluation, *gates, imported=False):
    (history / "nights" / name).mkdir(parents=True)
    status = 1 if gates else 0
    night = Night(
        name, "made", f"nights/{name}", 1.0, status, None, "verdict", "0.1", "1.28", imported
    )
    with open_history(history, create=True) as lines:
        lines.add(night, evaluation, gates)


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
    assert accepted == [f"{builders.CALM} in {builders.SCENARIOS[0]}: smallest gap: 1 nearer"]
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
    assert (since.night, since.nights, since.words) == (LATER, 2, f"since {LATER}, 2 nights")


def test_a_dead_mans_switch_knows_its_hours(evaluation, tmp_path):
    """From 02:00 to 04:00 of the next day are 26 h."""
    add(tmp_path, TODAY, evaluation)
    on_time, late = (datetime(2026, 11, 26, 4, 0, second, tzinfo=UTC) for second in (0, 1))
    assert finished_within(tmp_path, "26h", on_time)[0]
    assert not finished_within(tmp_path, "26h", late)[0]
    assert finished_within(tmp_path, "2d", late) == (
        True, f"The last finished night {TODAY} began 26.0 h ago, within 2d."
    )  # fmt: skip
    for age in ("26", "h", "0h", "-1h", "999999d", "26 h"):
        with refusal("such as 26h"):
            finished_within(tmp_path, age)
