"""Bases of a night: the last good night, and the accepted one. For nights, `sumo-eval accept`, and
`sumo-eval nightly --newer-than`.

Free: sentences. Fixed: keys that are read from `night.json`, which `nightly/morning.py` writes, and
the form of a night's name.

Users: `cli/compare.py`, `nightly/judgement.py`, `nightly/morning.py`, `nightly/night.py`.
"""

import json
import re
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError, check_known
from sumo_eval.evaluation import score
from sumo_eval.input_file import taking_apart
from sumo_eval.nightly.history import Accepted, History, Night, is_begun, open_history
from sumo_eval.results import Evaluation
from sumo_eval.scoring.comparison import Comparison, side_by_side
from sumo_eval.scoring.gate_settings import GateSettings
from sumo_eval.text import duration_words, timestamp

NIGHT = "night.json"


class Bases(NamedTuple):
    """The nights that a night is compared with.

    good: the last night that was good, or that an acceptance in force makes one.
    accepted: the night of the newest acceptance in force.
    comparison: with the last good night.
    pinned: comparison with the accepted night; None if both are one night, or there is none.
    notes: sentences on nights that could not be used.
    unusable: whether there are good nights but none that can be compared with, or an accepted night
        that cannot be compared with.
    steady: ADSs whose repeats in the last good night were all equal to the last bit.
    """

    good: Night | None
    accepted: Night | None
    comparison: Comparison | None
    pinned: Comparison | None
    notes: tuple[str, ...]
    unusable: bool
    steady: frozenset[str] = frozenset()

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All comparisons that exist."""
        return tuple(filter(None, (self.comparison, self.pinned)))


def find_bases(
    history: Path, database: History, evaluation: Evaluation, settings: GateSettings
) -> Bases:
    """Compare a night with two bases: the last good night that can be used, in the order of adding,
    and the accepted night.

    history: folder of the nights.
    """
    nights = database.nights()
    notes = []
    accepted_nights = {pin.night for pin in in_force(database.accepted())}
    good = [night for night in nights if night.good or night.night in accepted_nights]
    kept = [night for night in good[::-1] if (history / night.folder).is_dir()]
    if good and not kept:
        notes.append("The folders of all good nights are gone.")
    last, comparison = _first_usable(history, kept, evaluation, settings, notes)

    pin = pin_of(database)
    pinned_night = next((night for night in nights if pin and night.night == pin.night), None)
    pinned = None
    unusable = bool(good) and last is None
    if pinned_night is not None and pinned_night != last:
        pinned_night, pinned = _first_usable(history, [pinned_night], evaluation, settings, notes)
        unusable |= pinned is None
    steady = frozenset[str]()
    if last is not None:
        try:
            steady = _steady(history / last.folder / NIGHT)
        except InputError as error:  # the night stays a base
            notes.append(str(error))
    # an accepted night that was also tried as the last good one has its note twice
    once = tuple(dict.fromkeys(notes))
    return Bases(last, pinned_night, comparison, pinned, once, unusable, steady)


def _steady(record: Path) -> frozenset[str]:
    """ADSs whose repeats were all equal to the last bit in a night, from its `night.json`."""
    if not record.is_file():
        return frozenset()
    with taking_apart(record, "Remove this file; the night stays a base."):
        repeats = json.loads(record.read_text("utf-8")).get("repeats", {})
        return frozenset(ads for ads, it in repeats.items() if 0 < it["alike"] == it["cases"])


def _first_usable(
    history: Path,
    nights: Sequence[Night],
    evaluation: Evaluation,
    settings: GateSettings,
    notes: list[str],
) -> tuple[Night | None, Comparison | None]:
    """The first of the nights that can be compared with, and the comparison. A note on each night
    before it is added to `notes`.
    """
    for night in nights:
        try:
            return night, side_by_side(score(history / night.folder), evaluation, settings)
        except InputError as error:
            notes.append(f"Night {night.night} cannot be compared with: {error}")
    return None, None


def in_force(accepted: Sequence[Accepted], today: str = "") -> list[Accepted]:
    """Acceptances that have not expired, the oldest first.

    today: `2026-11-25`.
    """
    day = today or datetime.now(UTC).date().isoformat()
    return [pin for pin in accepted if pin.until is None or pin.until >= day]


def pin_of(database: History) -> Accepted | None:
    """The acceptance that counts: the newest that has not expired."""
    return next(reversed(in_force(database.accepted())), None)


class Acceptance(NamedTuple):
    """An accepted night, with sentences on its failures.

    accepted: failures that the next nights will not show, as they are part of the base.
    remaining: failures that no base changes, so that the next night shows them again.
    """

    night: Night
    accepted: list[str]
    remaining: list[str]


def accept(history: Path, night: str | None, reason: str, until: str | None) -> Acceptance:
    """Accept a night as a base.

    night: its name or folder; None: the newest that ran here, else the newest imported one.
    until: the last day on which the acceptance counts.

    Raises InputError, also for a night that fails only by limits on its own values: with it as a
    base, the next night would fail all the same.
    """
    if not reason.strip():
        raise InputError("--reason must say why the night is accepted, got an empty text.")
    if until is not None and until < timestamp()[:10]:
        raise InputError(f"--until must be today (UTC) or later, got {until}.")
    # `create` adds tables that an older history lacks; a folder without a history is refused
    with open_history(history, create=is_begun(history)) as database:
        nights = {night.night: night for night in database.nights()}
        if not nights:
            raise InputError(
                f"The history in {history} has no night yet; accept one after it has run."
            )
        ran = [night.night for night in database.ran()] or [*nights]
        name = ran[-1] if night is None else Path(night).name
        check_known("night", nights, name)
        if not (history / nights[name].folder).is_dir():
            raise InputError(
                f"The folder of night {name} is gone; only a night whose folder is kept can be a "
                "base."
            )
        own, changes = _failed(history / nights[name].folder / NIGHT)
        accepted, remaining = list[str](), list[str]()
        for gate in database.gates():
            if gate.night == name and gate.passed == 0:
                sentences = remaining if gate.sentence in own else accepted
                sentences.append(f"{gate.ads} in {gate.scenario}: {gate.sentence}")
        if remaining and not accepted:
            raise InputError(
                f"Night {name} fails by limits on its own values alone, which no accepted night "
                f"changes: change the gate. {'; '.join(remaining)}."
            )
        database.accept(Accepted(name, timestamp(), reason, until, itself=False))
    accepted += [f"{case}: {'; '.join(words)}" for case, words in changes.items()]
    return Acceptance(nights[name], accepted, remaining)


def _failed(record: Path) -> tuple[set[str], dict[str, list[str]]]:
    """Failed limits of a night, from its `night.json`; none without that file.

    Returns the sentences of the failed limits on the night's own values, and for each changed case
    the failed limits that name it.
    """
    own, changes = set[str](), defaultdict[str, list[str]](list)
    with taking_apart(record, "Accept another night."):
        for limit in json.loads(record.read_text("utf-8"))["failed"] if record.is_file() else ():
            if limit.get("own"):
                own.add(limit["sentence"])
                continue
            for case in limit["cases"]:
                # nights of earlier versions have no words
                changes[case["case"]].append(f"{limit['quantity']} {case.get('words', 'failed')}")
    return own, changes


UNITS = {"m": "minutes", "h": "hours", "d": "days"}  # of an age: arguments of `timedelta`


def finished_within(history: Path, age: str, now: datetime | None = None) -> tuple[bool, str]:
    """Whether the last finished night began within a time such as `26h`, and a sentence on it."""
    parts = re.fullmatch(r"(\d{1,5})([mhd])", age)
    if parts is None or not int(parts[1]):
        raise InputError(
            f"--newer-than must be a number of minutes, hours or days such as 26h, got {age!r}."
        )
    with open_history(history) as database:
        night = next(reversed(database.ran()), None)
    if night is None:
        return False, f"No night has finished in {history}."
    began = datetime.strptime(night.night, "%Y-%m-%dT%H-%M-%SZ").replace(tzinfo=UTC)
    elapsed = (now or datetime.now(UTC)) - began
    # a night before which the clock went back began in the future
    recent = abs(elapsed) <= timedelta(**{UNITS[parts[2]]: int(parts[1])})
    return (
        recent,
        f"The last finished night {night.night} began "
        f"{duration_words(abs(elapsed).total_seconds())} "
        f"{'ago' if elapsed >= timedelta() else 'from now'}, "
        f"{'within' if recent else 'more than'} {age}.",
    )


def pinned_by_itself(night: str, reason: str, pin: Accepted | None) -> Accepted:
    """Acceptance of a night that becomes the base without a user, at most until the acceptance of
    the earlier base expires.

    pin: acceptance of the earlier base; None: there was none.
    """
    return Accepted(night, timestamp(), reason, None if pin is None else pin.until, itself=True)
