import builders
import pytest
from builders import SCENARIOS

from sumo_eval.method.zone_partition import partition
from sumo_eval.report.html import write_report
from sumo_eval.scenario import catalogue


@pytest.fixture(scope="session")
def partitions():
    return {name: partition(catalogue.load(name)) for name in SCENARIOS}


@pytest.fixture(scope="session")
def evaluation(tmp_path_factory, partitions):
    return builders.evaluation(tmp_path_factory.mktemp("runs") / "hand", partitions)


@pytest.fixture(scope="session")
def report(evaluation, partitions):
    return write_report(evaluation, partitions)


@pytest.fixture(scope="session")
def page(report):
    return report.read_text()
