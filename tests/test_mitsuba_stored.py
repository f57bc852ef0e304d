"""Mitsuba 3 still makes of its scenes what the file of its features says.

Rendered anew with other seeds: one of the scenes, another every day, with a third of the seeds, or
all of them with all, if MCRT_ALL_ON_GPU is set, as `make validate` does. False alarms:
`comparing.ALPHA` for each scene.
"""

import datetime
import os

import comparing
import mitsuba_reference
import mitsuba_stored
import numpy as np
import pytest
from scipy import stats

pytestmark = pytest.mark.cpu_only("simulates nothing")
JOBS = mitsuba_stored.jobs()
OTHER_SEEDS = 1000
EVERYTHING = bool(os.environ.get("MCRT_ALL_ON_GPU"))
RARE = 0.15  # relative error of a mean that few paths make, as in `mitsuba_cases`


def chosen():
    """All, or the one of the day."""
    if EVERYTHING:
        return JOBS
    return [JOBS[datetime.date.today().toordinal() % len(JOBS)]]


@pytest.mark.parametrize("job", chosen(), ids=lambda job: job.name)
def test_mitsuba_still_says_so(job):
    if "inside" in job.name and not mitsuba_reference.select_variant():
        pytest.skip("the reference of a light inside needs LLVM 19")
    count = job.seeds if EVERYTHING else job.seeds // 3
    seeds = range(OTHER_SEEDS, OTHER_SEEDS + count)
    old, new = mitsuba_stored.stored(job), mitsuba_stored.estimate(job.render(seeds))
    known = np.ones(old.mean.shape, bool)
    for one in (old, new):
        known &= (one.variance > 0) & (np.sqrt(one.variance) < RARE * one.mean)
    assert known.sum() >= 5
    parts = [one.variance[known] for one in (old, new)]
    variance = sum(parts)
    # Welch's degrees of freedom of the two means.
    dof = variance**2 / sum(v**2 / (n.count - 1) for v, n in zip(parts, (old, new), strict=True))
    t = (new.mean - old.mean)[known] / np.sqrt(variance)
    p = 2 * stats.t.sf(np.abs(t), dof)
    print(f"smallest p {p.min():.1e} of {p.size}")
    assert p.min() > comparing.ALPHA / p.size


def test_the_file_holds_what_is_compared_and_nothing_else():
    assert mitsuba_stored.kept().keys() == {job.name for job in JOBS}
    for job in JOBS:
        mitsuba_stored.stored(job)
