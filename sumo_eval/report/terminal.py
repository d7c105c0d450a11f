"""What a run says at its end on a terminal or in a log."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from sumo_eval.report.words import (
    REASON_WITHOUT_C,
    count,
    drivers_are_synthetic,
    drivers_sentence,
    number,
    reason_without_d,
    unevaluated,
)
from sumo_eval.results import Evaluation, ScenarioResult

COLUMNS = ("ADS", "scenario", "C", "D", "S", "collisions", "in safe zone", "cases", "not evaluated")
NOT_COMPUTED = "not computed"
LONGEST_SENTENCE = 200  # characters of an error on a terminal; the report has all of it
MOST_LISTED = 5  # cases that could not be evaluated; the report lists them all


def score_table(evaluation: Evaluation) -> Table:
    """C, D and S of every ADS in every logical scenario, for a terminal."""
    table = Table(title=Text(f"{evaluation.name}: C and D within 0..1, S of 100 points"), title_justify="left")
    for index, heading in enumerate(COLUMNS):
        table.add_column(heading, justify="left" if index < 2 else "right", overflow="fold")
    for position, score in enumerate(evaluation.scores):
        last_of_scenario = (
            position + 1 < len(evaluation.scores) and evaluation.scores[position + 1].scenario != score.scenario
        )
        # Text, because an ADS may be called `[red]`: rich would read that as a colour.
        table.add_row(
            *(Text(cell, _style(cell, heading)) for cell, heading in _row(score)), end_section=last_of_scenario
        )
    return table


def plain_table(evaluation: Evaluation) -> str:
    """The same table as aligned text without lines, for logs and pipes."""
    rows = [COLUMNS, *(tuple(cell for cell, _ in _row(score)) for score in evaluation.scores)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def closing_lines(evaluation: Evaluation) -> list[str]:
    """What a person must know besides the table, one sentence a line."""
    lines = [
        f"C of {score.ads} in {score.scenario} is not computed: {REASON_WITHOUT_C}. Its term counts 0 points."
        for score in evaluation.scores
        if score.c is None
    ]
    lines += [
        f"D of {score.ads} in {score.scenario} is not computed: {reason_without_d(score)}. Its term counts 0 points."
        for score in evaluation.scores
        if score.d is None
    ]
    missing = unevaluated(evaluation)
    if missing:
        lines.append(f"{count(len(missing), 'case')} could not be evaluated and left the means:")
        lines += [
            f"  {_one_line(case.case)}: {_shortened(_one_line(sentence))}" for case, sentence in missing[:MOST_LISTED]
        ]
        if len(missing) > MOST_LISTED:
            lines.append(f"  and {len(missing) - MOST_LISTED} more, all in the report.")
    lines += [
        f"{score.ads} in {score.scenario}: {note}"
        for score in evaluation.scores
        for note in score.notes
        if "could not be evaluated" not in note  # said above, with the cases
    ]
    lines += [f"Zones of {zone.scenario}: {note}" for zone in evaluation.zones for note in zone.notes]
    if drivers_are_synthetic(evaluation.settings):
        lines.append(drivers_sentence(evaluation.settings))
    lines.append(f"The report is {evaluation.folder / 'report.html'}")
    return lines


def _row(score: ScenarioResult) -> list[tuple[str, str]]:
    cells = (
        score.ads,
        score.scenario,
        _with_interval(NOT_COMPUTED if score.c is None else number(score.c, 3), score.c_interval, 3),
        _with_interval(NOT_COMPUTED if score.d is None else number(score.d, 3), score.d_interval, 3),
        _with_interval(number(score.s, 1), score.s_interval, 1),
        str(score.collisions),
        str(score.safe_collisions),
        str(score.cases),
        str(score.not_evaluated),
    )
    return [(_one_line(cell), heading) for cell, heading in zip(cells, COLUMNS, strict=True)]


def _with_interval(cell: str, interval: tuple[float, float] | None, digits: int) -> str:
    """A value whose cases are not all there is never shown without what it could have been."""
    if interval is None:
        return cell
    return f"{cell} ({number(interval[0], digits)}..{number(interval[1], digits)})"


def _style(cell: str, heading: str) -> str:
    """Bold for the score, yellow for what a person should look into."""
    if heading == "S":
        return "bold"
    warns = cell.startswith(NOT_COMPUTED) or (heading in {"in safe zone", "not evaluated"} and cell != "0")
    return "yellow" if warns else ""


def _shortened(sentence: str) -> str:
    return sentence if len(sentence) <= LONGEST_SENTENCE else f"{sentence[: LONGEST_SENTENCE - 2]} …"


def _one_line(text: str) -> str:
    """Without line breaks and without control characters, which would repaint a terminal."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
