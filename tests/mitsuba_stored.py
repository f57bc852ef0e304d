"""What Mitsuba 3 makes of the scenes that the tests compare with, kept in `mitsuba_features.json`.

    python tests/mitsuba_stored.py

renders what the file lacks, or has of another scene, budget or Mitsuba, and writes it.
`test_mitsuba_stored` renders anew, with other seeds: in CI one of the jobs, in `make validate` all.
"""

import functools
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

FILE = Path(__file__).with_name("mitsuba_features.json")


@dataclass(frozen=True)
class Estimate:
    """Means of independent samples, the variance of each mean, and how many samples there were."""

    mean: np.ndarray
    variance: np.ndarray
    count: int


def estimate(samples):
    """Along the first axis; the only sample of something deterministic has variance 0."""
    samples = np.asarray(samples, float)
    n = len(samples)
    variance = samples.var(0, ddof=1) / n if n > 1 else np.zeros_like(samples[0])
    return Estimate(samples.mean(0), variance, n)


@dataclass(frozen=True)
class Job:
    """Something that Mitsuba renders."""

    name: str
    scene: str  # `digest` of all that Mitsuba is given
    seeds: int  # of the file's estimate
    render: Callable[[range], np.ndarray]  # samples (seeds, ...)


def digest(*values):
    """A hash of what Mitsuba is given; of numbers five digits, for machines round differently."""
    return hashlib.sha256(spelt(values).encode()).hexdigest()[:24]


def spelt(value):
    if isinstance(value, dict):
        return repr([(key, spelt(value[key])) for key in sorted(value)])
    if isinstance(value, list | tuple):
        return repr([*map(spelt, value)])
    if isinstance(value, mi.ScalarTransform4f):
        value = np.array(value.matrix)
    if isinstance(value, mi.VolumeGrid | mi.Bitmap | np.ndarray):
        array = np.array(value)
        return " ".join(f"{number:.5g}" for number in array.ravel()) + repr(array.shape)
    return f"{value:.5g}" if isinstance(value, float | np.floating) else repr(value)


@functools.cache
def kept():
    return json.loads(FILE.read_text())


def stored(job):
    """The estimate in the file; an error if the scene is another one by now."""
    one = kept().get(job.name)
    renew = f"run `python tests/{Path(__file__).name}`"
    assert one, f"Mitsuba has not rendered {job.name!r}: {renew}"
    assert one["scene"] == job.scene, f"the scene {job.name!r} has changed: {renew}"
    return Estimate(np.array(one["mean"]), np.array(one["error"]) ** 2, one["count"])


def jobs():
    """All that the file holds."""
    import test_mitsuba
    import test_mitsuba_pairs
    import test_mitsuba_wrong

    lists = (test_mitsuba.jobs(), test_mitsuba_pairs.jobs(), test_mitsuba_wrong.jobs())
    return list({job.name: job for some in lists for job in some}.values())


def short(array, digits):
    """Nested lists of numbers with so many significant digits."""
    if np.ndim(array):
        return [short(part, digits) for part in array]
    return float(f"{array:.{digits}g}")


def main():
    old = kept() if FILE.exists() else {}
    new = {}
    for job in jobs():
        new[job.name] = old.get(job.name)
        if not new[job.name] or new[job.name]["scene"] != job.scene:
            print("rendering", job.name, flush=True)
            found = estimate(job.render(range(job.seeds)))
            new[job.name] = {
                "scene": job.scene,
                "count": found.count,
                "mean": short(found.mean, 6),
                "error": short(np.sqrt(found.variance), 4),
            }
    lines = (f"{json.dumps(name)}: {json.dumps(one)}" for name, one in new.items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
