"""Results of a night for programs and for the morning: night.json, a Markdown summary, GitHub
annotations.

Users: `cli/compare.py`, `nightly/night.py`.
"""

import json
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_eval.nightly.bases import NIGHT
from sumo_eval.nightly.history import Night
from sumo_eval.nightly.judgement import Judgement, Since
from sumo_eval.report.comparison_lines import difference_lines, gate_lines, ways_to, worst_lines
from sumo_eval.report.gate_result import GateResult, failed
from sumo_eval.report.page import REPORT, Json, case_key, write_page
from sumo_eval.report.words import one_line
from sumo_eval.results import Evaluation
from sumo_eval.scoring.comparison import builds_besides

SUMMARY = "summary.md"
CHAT = "chat.json"
MOST_IN_CHAT = 5  # failed limits


class NightResult(NamedTuple):
    """Result of a night.

    notes: sentences on folders that were removed, nights that were not compared, and drives that
        were left out.
    report, trend: paths of the two pages.
    """

    night: Night
    evaluation: Evaluation
    judgement: Judgement
    notes: tuple[str, ...]
    report: Path
    trend: Path


def write_night(
    history: Path, night: Night, word: str, judgement: Judgement, notes: Sequence[str]
) -> None:
    """Write `night.json` and `summary.md` into a night's folder, and `chat.json` beside the
    history.

    word: the verdict in one word, as in `verdict.Word`.
    """
    folder = history / night.folder
    record = _record(night, word, judgement, notes, folder)
    for path, text in (
        (folder / NIGHT, json.dumps(record, indent=2, ensure_ascii=False)),
        (folder / SUMMARY, "\n".join(markdown_lines(night, judgement, folder))),
        (history / CHAT, json.dumps({"text": chat_text(night, judgement)})),
    ):
        write_page(path, text + "\n", "A result of the night")  # a path need not be UTF-8


def _record(
    night: Night, word: str, judgement: Judgement, notes: Sequence[str], folder: Path
) -> Json:
    """The content of `night.json`.

    folder: of the night.
    """
    bases = judgement.bases
    comparison = bases.comparison
    return {
        "night": night.night,
        "evaluation": night.evaluation,
        "verdict": word,
        "sentence": night.verdict,
        "exit_status": night.exit_status,
        "base": night.base,
        "accepted": None if bases.accepted is None else bases.accepted.night,
        "since": min((start.night for start in judgement.since.values()), default=None),
        "failed": [
            _plain(gate, judgement.since[gate.name], folder) for gate in failed(judgement.gates)
        ],
        "not_judged": [
            f"{gate.ads}: {gate.sentence}" for gate in judgement.gates if gate.passed is None
        ],
        "pairs": 0 if comparison is None else comparison.pairs,
        "differences": [
            difference._asdict() for difference in (comparison.differences if comparison else ())
        ],
        "unpaired": [group._asdict() for group in (comparison.unpaired if comparison else ())],
        "repeats": {ads: repeats._asdict() for ads, repeats in judgement.noise.repeats.items()},
        "builds": judgement.builds,
        "notes": notes,
    }


def _plain(gate: GateResult, since: Since, folder: Path) -> Json:
    """A failed limit, as `night.json` has it."""
    return {
        "quantity": gate.quantity,
        "ads": gate.ads,
        "scenario": gate.scenario,
        "sentence": gate.sentence,
        "against": gate.against or "last good night",
        "own": gate.own,
        "since": since.night,
        "nights": since.nights,
        "cases": [
            change._asdict()
            | {
                "words": change.words,
                "replay": ways["again"],
                "run": ways["alone"],
                "link": f"{REPORT}#case:{case_key(change.case)}",
            }
            for change in gate.worst
            for ways in [ways_to(folder, change.case)]  # commands that drive the case again
        ],
        "keys": gate.cases,
    }


def markdown_lines(night: Night, judgement: Judgement, folder: Path) -> Iterator[str]:
    """The morning's screen in Markdown, e.g. for `$GITHUB_STEP_SUMMARY`."""
    yield f"## {_escaped(night.verdict)}"
    yield ""
    for gate in failed(judgement.gates):
        since = judgement.since[gate.name].words
        yield f"- **{_escaped(gate.ads)}** in {gate.scenario} ({since}): {_escaped(gate.sentence)}"
        for case in gate.worst:
            yield f"  - {_code(case.case)}: {_escaped(case.point)}: {_escaped(case.words)}"
        if gate.worst:
            yield from (f"  - {_code(way)}" for way in ways_to(folder, gate.worst[0].case).values())
    yield from (f"- {_escaped(words)}" for words in _context(judgement))


def chat_text(night: Night, judgement: Judgement) -> str:
    """The morning's screen in a few plain lines."""
    bad = failed(judgement.gates)
    lines = [night.verdict]
    for gate in bad[:MOST_IN_CHAT]:
        worst = "".join(f"; {case.case}: {case.words}" for case in gate.worst[:1])
        lines.append(
            f"{gate.ads} in {gate.scenario} ({judgement.since[gate.name].words}): "
            f"{gate.sentence}{worst}"
        )
    lines += [f"and {len(bad) - MOST_IN_CHAT} more"] if len(bad) > MOST_IN_CHAT else []
    return "\n".join(map(one_line, [*lines, *_context(judgement)]))


def _context(judgement: Judgement) -> list[str]:
    """Builds, and differences in anything but the ADS."""
    comparison = judgement.bases.comparison
    differences = comparison.differences if comparison else ()
    return [
        *builds_besides(judgement.builds, comparison),
        *(f"differs: {difference.words}" for difference in differences),
    ]


def github_annotations(gates: Sequence[GateResult]) -> list[str]:
    """GitHub's workflow commands, one for each limit that failed."""
    return [
        f"::error title={_command(f'{gate.quantity} of {gate.ads}', ':,')}::"
        + _command("\n".join([gate.sentence, *worst_lines(gate, None)]))
        for gate in failed(gates)
    ]


def morning_lines(result: NightResult) -> list[str]:
    """The first screen of a night: differences in anything but the ADS, cases without a partner,
    builds, the verdict, failed limits with new ones first.

    Capitals mark a difference that could change a score though no ADS changed.
    """
    judgement, comparison = result.judgement, result.judgement.bases.comparison
    lines = difference_lines(comparison) if comparison else []
    lines += [
        f"no partner: {one_line(group.ads)} in {group.scenario}: {group.lost} of {group.of} "
        f"cases lost, {group.added} added"
        + (f" ({', '.join(group.examples)})" if group.examples else "")
        for group in (comparison.unpaired if comparison else ())
    ]
    since = {name: start.words for name, start in judgement.since.items()}
    lines += map(one_line, builds_besides(judgement.builds, comparison))
    return [*lines, result.night.verdict, *gate_lines(judgement.gates, result.report.parent, since)]


def tell_github(result: NightResult) -> list[str]:
    """Append the summary to the file `$GITHUB_STEP_SUMMARY`, if that is set. Return lines for the
    log: annotations, if GitHub runs the night, and the reason if the file cannot be written.
    """
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    lines = list[str]()
    if summary:
        try:
            text = (result.report.parent / SUMMARY).read_text("utf-8")
            with Path(summary).open("a", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:  # the night is over, and its exit status counts
            lines = [f"$GITHUB_STEP_SUMMARY cannot be written: {error}."]
    if os.environ.get("GITHUB_ACTIONS") == "true":
        lines += github_annotations(result.judgement.gates)
    return lines


def _escaped(text: str) -> str:
    """Text on one line with Markdown's and HTML's special characters escaped."""
    return " ".join(re.sub(r"[\\`*_<|\[\]&]", r"\\\g<0>", text).split())


def _code(text: str) -> str:
    """Text as code of Markdown, between more backticks than it has in a row."""
    fence = "`"
    while fence in text:
        fence += "`"
    return f"{fence}{text}{fence}" if fence == "`" else f"{fence} {text} {fence}"


def _command(text: str, ends: str = "") -> str:
    """Text in a workflow command, with the characters that would end it percent-encoded.

    ends: further characters that end a property such as `title`; GitHub decodes these only there.
    """
    return "".join(f"%{ord(it):02X}" if it in f"%\r\n{ends}" else it for it in text)
