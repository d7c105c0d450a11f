from pathlib import Path

import builders
import pytest

from sumo_eval.method.zone_partition import ZonePartition, partition
from sumo_eval.report.html import write_report
from sumo_eval.results import Evaluation
from sumo_eval.scenario import catalogue


@pytest.fixture(scope="session")
def partitions() -> dict[str, ZonePartition]:
    return {name: partition(catalogue.load(name)) for name in builders.SCENARIOS}


@pytest.fixture(scope="session")
def evaluation(
    tmp_path_factory: pytest.TempPathFactory, partitions: dict[str, ZonePartition]
) -> Evaluation:
    return builders.evaluation(tmp_path_factory.mktemp("runs") / "hand", partitions)


@pytest.fixture(scope="session")
def report(evaluation: Evaluation, partitions: dict[str, ZonePartition]) -> Path:
    return write_report(evaluation, partitions)


@pytest.fixture(scope="session")
def page(report: Path) -> str:
    return report.read_text()
