"""The scenarios that the suite leaves out: drives, people and scores are the golden ones."""

import pytest

from golden import golden

OTHERS = [scenario for part in golden.PARTS[2:] for scenario in part]


@pytest.mark.campaign
@pytest.mark.parametrize("scenario", OTHERS)
def test_drives_people_and_scores_are_the_golden_ones(scenario):
    golden.check(scenario)
