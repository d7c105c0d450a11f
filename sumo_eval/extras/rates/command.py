"""Commands for crash rates: `learn` logical scenarios from traffic, run a `campaign` over them."""

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from sumo_eval.cli import out_folder
from sumo_eval.cli.exit_status import DONE, NOT_EVALUATED
from sumo_eval.cli.options import RESUME, count_option, path_argument, path_option
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, tell
from sumo_eval.errors import InputError
from sumo_eval.extras.rates import BUDGET

NAMED = 3  # files that a sentence names one by one


def called(recordings: Sequence[Path]) -> str:
    """Names of files for a sentence; more than `NAMED` files as their number, first and last."""
    names = [path.name for path in recordings]
    if len(names) <= NAMED:
        return ", ".join(names)
    return f"{len(names)} files, {names[0]} to {names[-1]}"


@click.command(epilog="Example: sumo-eval learn people.csv.gz --out learned")
@path_argument("recordings", nargs=-1, required=True)
@path_option("--out",
              help="Folder for the scenario files and the page (default: "
                   "results/learned-TIME).")  # fmt: skip
@click.option("--format", "form", default="csv", show_default=True,
              help="csv: tables that `humans import` wrote; or a format that it "
                   "reads.")  # fmt: skip
def learn(recordings: tuple[Path, ...], out: Path | None, form: str) -> None:
    """Learn logical scenarios from RECORDINGS: files with ranges, joint distribution and events per
    vehicle-km.

    Every class of encounters (cut-in, overtaken and cut off, merging, cut-out, braking, approach,
    lane change with a vehicle behind) becomes a scenario file, its events as CSV and as
    OpenSCENARIO value sets; a page shows the data against the model.
    """
    from sumo_eval.drivers.recorded.importing import each_of
    from sumo_eval.extras.rates.learn_page import sentences, write_lesson
    from sumo_eval.extras.rates.learned import learn as learn_from

    # before the first is read, because reading takes long
    for path in recordings:
        if not path.exists():
            raise InputError(f"Recordings {path} are not there.")
        # the files that are written name it
        if path.name.encode(errors="replace").decode() != path.name:
            raise InputError(f"Recordings must have a name in UTF-8, got {path}: rename them.")
    out = out or out_folder.default("learned")
    out_folder.ready(out)
    with Progress() as progress:
        lesson = learn_from(
            each_of(form, recordings), out, called(recordings),
            lambda what, done: progress(what, done, done),  # the total is unknown
        )  # fmt: skip
    say(sentences(lesson))
    say(map(str, write_lesson(lesson, out)))


@click.command(epilog="Example: sumo-eval campaign learned/campaign.toml --out results/rates")
@path_argument("file", metavar="CAMPAIGN.toml")
@path_option("--out",
              help="Folder for campaign.html and campaign.json (default: "
                   "results/CAMPAIGN-TIME).")  # fmt: skip
@click.option(
    "--budget",
    type=click.IntRange(*BUDGET),
    help="Drives of an ADS in a scenario, instead of the file's.",
)
@count_option("--workers", help="Processes that simulate, instead of the file's.")
@RESUME
def campaign(
    file: Path, out: Path | None, budget: int | None, workers: int | None, resume: bool
) -> None:
    """Estimate collisions per million km of the ADSs of CAMPAIGN.toml, with intervals.

    Points of every scenario are drawn where encounters occur and collisions are likely, and
    weighted by their exposure. A scenario file has its encounters per vehicle-km ([met], as `learn`
    writes it).

    A stopped campaign keeps its drives. `--resume` continues it, with the folder in --out.
    """
    from sumo_eval.extras.rates.campaign import read_campaign, run_campaign
    from sumo_eval.extras.rates.campaign_page import lost_words, sentences, write_campaign
    from sumo_eval.extras.studies.trials import trials_in
    from sumo_eval.record.cases import Setup

    settings = read_campaign(file)
    settings = replace(
        settings,
        budget=budget or settings.budget,
        run=replace(settings.run, workers=workers or settings.run.workers),
    )
    out = out or out_folder.default(settings.name)
    # makes the folder, or refuses it before anything is driven
    with trials_in(
        out,
        Setup(settings.simulation, settings.run, file.parent),
        [ads.locator for ads in settings.ads],
        study=f"{settings.name} seed={settings.seed}",
        resume=resume,
    ) as trials:
        with Progress() as progress:
            result = run_campaign(settings, file.parent, trials, progress)
        say(sentences(result))
        lost = sum((rate.lost for rate in result.rates), Counter())
        if lost:
            tell(lost_words(lost))
        say(map(str, write_campaign(result, out)))
    sys.exit(NOT_EVALUATED if lost else DONE)
