"""`sumo-eval plot`: a figure of a run for a paper."""

from pathlib import Path

import click

from sumo_eval.cli.options import RUN, path_option, trusting
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import tell


@click.command(epilog="Example: sumo-eval plot results/first zone_map --ads idm --out zones.pdf")
@RUN
@click.argument("figure")
@path_option("--out", help="The file: .svg, .png or .pdf (default: RUN/FIGURE.svg).")
@click.option(
    "--scenario",
    help="One scenario (default: all; where a figure shows one, that of its case or the first).",
)
@click.option(
    "--ads", help="One ADS (default: all; where a figure shows one, that of its case or the first)."
)
@click.option("--case", help="A case, for figures of drives (default: the least human-like one).")
@click.option("--width", default="page", help="`column` (88 mm) or `page` (180 mm, the default).")
@trusting
def plot(
    run: Path,
    figure: str,
    out: Path | None,
    scenario: str | None,
    ads: str | None,
    case: str | None,
    width: str,
) -> None:
    """Draw FIGURE for a paper. A run has zone_map, field, trajectories, time_history,
    collisions, boundary, intervals, points, opinion; a folder of nights has trend; a folder that
    `sumo-eval boundary` wrote has boundary.
    """
    from sumo_eval.extras.figures.drawn import FIGURES, draw
    from sumo_eval.extras.figures.style import ending_of, refuse_without_matplotlib, save, width_of

    file = out or run / f"{figure}.svg"
    # `draw` scores the run of most figures: what can be refused at once is checked before
    if figure in FIGURES:  # `draw` refuses any other
        width_of(width)
        ending_of(file)
        refuse_without_matplotlib()
    with Progress() as progress:
        drawn = draw(
            run, figure, scenario=scenario, ads=ads, case=case, width=width, progress=progress
        )
    tell(str(save(drawn, file)))
