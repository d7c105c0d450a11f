"""Some of the scenarios whose zones have a closed form: drives, people and scores are the golden
ones."""

import pytest

from golden import golden


@pytest.mark.parametrize("scenario", golden.PARTS[0])
def test_drives_people_and_scores_are_the_golden_ones(scenario):
    golden.check(scenario)
