"""The statistics of comparing a result with the truth, or with another.

False alarms: `assert_z` and `limit` take `ALPHA` as the two-sided false-alarm probability of a
whole family of comparisons (Bonferroni over its members, so correlated members only make it
smaller).
"""

import numpy as np
from scipy import stats

ALPHA = 1e-5  # false-alarm probability of one assertion


def limit(count=1, dof=np.inf, alpha=ALPHA):
    """The |z| that any of `count` comparisons exceeds with probability `alpha` at most."""
    return stats.t.isf(alpha / (2 * count), dof)


def z_scores(value, truth, error, truth_error=0.0, relative=1e-4):
    """What (value - truth) exceeds the part `relative` of the truth by, in standard errors.

    That part is for rounding, quadrature and bias, which no number of photons cures: it is allowed
    as it stands, and not times the bound on z.
    """
    truth = np.asarray(truth, float)
    scale = np.hypot(np.asarray(error, float), truth_error)
    difference = np.asarray(value, float) - truth
    excess = np.maximum(np.abs(difference) - relative * np.abs(truth), 0)
    scores = np.sign(difference) * excess / np.where(scale > 0, scale, 1e-300)
    return np.where(excess == 0, 0.0, scores)


def assert_z(value, truth, error, truth_error=0.0, *, dof=np.inf, relative=1e-4, what=""):
    """Every value within its family-wise bound of the truth."""
    assert np.all(np.isfinite(value)), f"{what}: not finite"
    z = z_scores(value, truth, error, truth_error, relative)
    worst = np.unravel_index(np.argmax(np.abs(z)), z.shape) if z.ndim else ()
    bound = limit(z.size, dof)
    assert abs(z[worst]) < bound, (
        f"{what}: z = {z[worst]:.2f} at {tuple(map(int, worst))}, bound {bound:.2f}; "
        f"got {np.asarray(value)[worst]}, "
        f"truth {np.broadcast_to(truth, z.shape)[worst]}; "
        f"z of all: mean {z.mean():.2f}, rms {np.sqrt((z**2).mean()):.2f}"
    )


def assert_mean(samples, truth, *, what=""):
    """The mean of independent, equally distributed samples is the truth (one-sample t test).

    Of few samples Student's limit is so far out (28 of 5, 9 of 10, 5.4 of 24) that it sees nothing.
    """
    samples = np.asarray(samples, float)
    assert len(samples) >= 24, f"{what}: {len(samples)} samples are too few"
    assert_z(
        samples.mean(), truth, stats.sem(samples), dof=len(samples) - 1, relative=1e-5, what=what
    )


def fraction_error(p, photons):
    """Bound on the standard error of a mean p of weights in [0, 1]: sqrt(p (1 - p) / N)."""
    return np.sqrt(np.clip(np.multiply(p, 1 - np.asarray(p)), 0, None) / photons)


def relative_rms(value, truth):
    """sqrt(mean((value - truth)^2)) / mean(truth)."""
    return np.sqrt(np.mean(np.square(np.asarray(value, float) - truth))) / np.mean(truth)


def dof(result, of="voxel"):
    """Degrees of freedom of Student's t that the z-scores of a result's voxels or pixels follow."""
    given = result.stats["degrees_of_freedom" if of == "voxel" else "degrees_of_freedom_pixel"]
    return given if given or result.stats["photons"] else 10**6  # no noise: no tail to allow for


def energy_sum(energy):
    """All fractions of the launched power: 1."""
    parts = (energy.missed, energy.unscattered, energy.absorbed, energy.truncated, energy.roulette)
    return sum(np.asarray(part, float) for part in (*parts, *energy.escaped.values()))


def assert_balance(energy, dof=7):
    """The fractions add up to 1 within the statistical error of their sum, and rounding.

    `dof` are the degrees of freedom of that error: at least 7, of 8 batches or 8 lattices of rays.
    """
    lacks = np.asarray(energy_sum(energy)) - 1
    np.testing.assert_allclose(energy.imbalance, lacks, rtol=0, atol=1e-12)
    assert np.all(np.abs(lacks) <= 1e-6 + limit(lacks.size, dof) * np.asarray(energy.error)), lacks
