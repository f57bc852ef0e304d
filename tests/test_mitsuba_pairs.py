"""Every pair of features of the scenes, trackers and methods, against Mitsuba 3 (`mitsuba_cases`).

All comparisons together raise a false alarm with probability `suite.ALPHA` at most.
"""

import mitsuba_cases as suite
import mitsuba_reference
import pytest
from mitsuba_stored import stored

CASES = suite.covering(2)
LEVEL = suite.level(CASES)
REST = pytest.mark.cpu_only("the GPU takes cases until each value was in one")


def jobs():
    """What Mitsuba renders for this file."""
    return [mitsuba_reference.job(case) for case in CASES]


def marked():
    """The cases, those marked that hold no value of an axis that was not in one before."""
    held = set()
    for case in CASES:
        values = suite.subsets(case, 1)
        yield pytest.param(case, marks=[REST] if values <= held else [])
        held |= values


@pytest.mark.parametrize("case", list(marked()), ids=suite.name)
def test_images_are_those_of_mitsuba(case):
    true = stored(mitsuba_reference.job(case))
    found = suite.compare(case, suite.ours(case)[0], true)
    assert found.p.min() > LEVEL, str(found)


@pytest.mark.cpu_only("simulates nothing")
@pytest.mark.parametrize("strength", [2, 3])
def test_the_table_holds_every_combination(strength):
    cases = suite.covering(strength)
    assert all(suite.possible(case) for case in cases)
    held = set().union(*(suite.subsets(case, strength) for case in cases))
    assert held >= suite.combinations(strength).keys()
