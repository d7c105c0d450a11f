"""An evaluation as a notebook shows it: a table, and a picture of the scores.

`results.py` and `cases.py` load the functions by their names when a notebook shows something.
"""

from collections.abc import Mapping
from html import escape
from typing import Any

from click import unstyle

from sumo_eval.cases import CaseResult
from sumo_eval.errors import needs_extra
from sumo_eval.report.citation import citation
from sumo_eval.report.headline import headline
from sumo_eval.report.page import REPORT
from sumo_eval.report.score_table import FIRST, LEGEND, MORE, cells_of, score_lines
from sumo_eval.report.terminal import closing_lines
from sumo_eval.report.words import number
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.text import point_words


def html_table(evaluation: Evaluation) -> str:
    """The scores of every ADS in every logical scenario, a row each, with the headline above and
    notes below.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in ("ADS", "scenario", *FIRST, *MORE))
    rows = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in _cells(score).values())}</tr>"
        for score in evaluation.scores
    )
    first_words = headline(evaluation)
    above = "<br>".join(
        f"<b>{escape(question)}:</b> {escape(answer)}" for question, answer in first_words.answers
    )
    alarms = "".join(
        f'<br><span style="color:#b00">{escape(ads)}: {escape(words)}</span>'
        for ads, words in first_words.alarms
    )
    notes = (
        LEGEND,
        citation(evaluation),
        *closing_lines(evaluation),
        f"The report is {evaluation.folder / REPORT}",
    )
    lines = "<br>".join(map(escape, notes))
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f"<p>{above}{alarms}</p>{table}<p><small>{lines}</small></p>"


def text_table(evaluation: Evaluation) -> str:
    """The scores as `sumo-eval run` prints them, without colours."""
    return unstyle("\n".join(score_lines(evaluation)))


def _cells(score: ScenarioResult) -> dict[str, str]:
    cells = cells_of(score)
    named = {heading: cells[heading] for heading in (*FIRST, *MORE)}
    return {"ADS": score.ads, "scenario": score.scenario} | named


def _column(cells: Mapping[str, str]) -> str:
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(words)}</td></tr>" for name, words in cells.items()
    )
    return f"<table><tbody>{rows}</tbody></table>"


def score_html(score: ScenarioResult) -> str:
    """One ADS in one logical scenario: its scores, each with its interval, and its collisions."""
    return _column(_cells(score))


def case_html(case: CaseResult) -> str:
    """One case: its point, its outcome and its scores."""
    return _column({
        "case": case.case, "ADS": case.ads, "scenario": case.scenario,
        "at": point_words(case.values),
        "zone": case.zone, "outcome": case.outcome, "U": number(case.severity, 3),
        "Ug": number(case.ideal_severity, 3), "D_i": number(case.index, 3),
        "in H": number(case.human_likeness, 3)
    })  # fmt: skip


def picture(evaluation: Evaluation) -> Any:
    """S+ of every ADS with its interval, a panel for each logical scenario: a figure of
    matplotlib.
    """
    try:
        from sumo_eval.report.drawing import Drawing
    except ImportError as error:
        raise needs_extra("A plot", "plots") from error
    scenarios, ads = evaluation.scenario_names, evaluation.ads_names
    figure = Drawing(figsize=(4.0 * len(scenarios), 1.0 + 0.4 * len(ads)), layout="constrained")
    panels = figure.subplots(1, len(scenarios), sharey=True, squeeze=False)[0]
    for panel, scenario in zip(panels, scenarios, strict=True):
        # `run.only` may leave a scenario without cases of some ADSs: these have no score here
        for score in evaluation.scores_in(scenario):
            row = ads.index(score.ads)
            if score.s_plus is None:
                panel.annotate("not computed", (1.0, row), va="center")
                continue
            panel.barh(row, score.s_plus, color="tab:blue", alpha=0.6)
            if score.s_plus_interval is not None:
                panel.plot(score.s_plus_interval, [row, row], color="black")
        panel.set(title=scenario, xlabel="S+ (line: its interval)", xlim=(0.0, 100.0))
        panel.set_yticks(range(len(ads)), ads, parse_math=False)  # a name may hold `$`
        if panel is panels[0]:  # all panels share its axis
            panel.invert_yaxis()
    return figure
