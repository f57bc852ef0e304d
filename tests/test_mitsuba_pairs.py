"""Every pair of features of the scenes, trackers and methods, against Mitsuba 3 (`mitsuba_cases`).

All comparisons together raise a false alarm with probability `suite.ALPHA` at most.
"""

import mitsuba_cases as suite
import pytest

CASES = suite.covering(2)
LEVEL = suite.level(CASES)


@pytest.mark.parametrize("case", CASES, ids=suite.name)
def test_images_are_those_of_mitsuba(case):
    if case["light"] == "inside" and not suite.select_variant():
        pytest.skip("the reference of a light inside needs LLVM 19")
    found = suite.compare(case, suite.ours(case)[0], suite.reference(case)[0])
    assert found.p.min() > LEVEL, str(found)


@pytest.mark.cpu_only("simulates nothing")
@pytest.mark.parametrize("strength", [2, 3])
def test_the_table_holds_every_combination(strength):
    cases = suite.covering(strength)
    assert all(suite.possible(case) for case in cases)
    held = set().union(*(suite.subsets(case, strength) for case in cases))
    assert held >= suite.combinations(strength).keys()
