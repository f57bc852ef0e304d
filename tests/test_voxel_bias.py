"""`photon` against `path`: their difference is the bias of the voxels' size, falling with h^2.

Optically thick blobs (25 extents deep at most), orders 2 and up, on 16, 32 and 64 voxels along
each axis. `path` has no such bias. The statistic is the mean of the image, over independent seeds
of both, for pixels of `photon` share photons. 32 voxels are 0.65 +- 0.06 % too dark, 64 by a fourth
of that within the noise, and 16, where a blob is 4 voxels wide and h^4 counts too, 2.05 +- 0.08 %:
as 16 seeds of 1e6 photons and 2000 samples had it.
"""

import comparing
import mcrt
import numpy as np
import pytest
from conftest import cached

pytestmark = pytest.mark.cpu_only("a bias of the method, whatever runs it")

# Paths have more of the noise, and more seeds; of photons a run of few is mostly overhead.
PHOTONS, PATHS = 12, 32
EFFORT = {"photon": {"photons": 7e5}, "path": {"spp": 700}}
COARSEST = {"photon": {"photons": 4e5}, "path": {"spp": 250}}  # as sharp as it counts
BLOBS = [(0.35, 0.4, 0.35, 0.25, 0.9), (0.65, 0.6, 0.55, 0.28, 0.8)]


def scene(n):
    z, y, x = np.meshgrid(*[(np.arange(n) + 0.5) / n] * 3, indexing="ij")
    total = sum(
        weight * np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius**2)
        for cx, cy, cz, radius, weight in BLOBS
    )
    return np.clip(total - 0.05, 0, None).astype(np.float32), {
        "spacing": 1 / n,
        "extinction": 25.0,
        "albedo": 0.95,
        "light": mcrt.DirectionalLight((0.6, 0.3, -1), 3.0),
        "camera": mcrt.PerspectiveCamera(
            (-1.6, -2.4, 1.6), (0.5, 0.5, 0.5), fov=24, resolution=(24, 24)
        ),
        "outputs": ("image",),
        "progress": False,
    }


@cached
def bias(n):
    """Relative difference of the image's mean, its standard error, and the degrees of freedom of
    that by Welch."""
    volume, options = scene(n)

    def means(method, seeds):
        effort = COARSEST if n == 16 else EFFORT
        how = {"method": method, **effort[method], **options}
        runs = [mcrt.simulate(volume, seed=seed, **how) for seed in range(1, seeds + 1)]
        return np.array([run.image(order="2+").mean(dtype=float) for run in runs])

    photon, path = means("photon", PHOTONS), means("path", PATHS)
    a, b = photon.var(ddof=1) / PHOTONS, path.var(ddof=1) / PATHS
    dof = (a + b) ** 2 / (a**2 / (PHOTONS - 1) + b**2 / (PATHS - 1))
    return photon.mean() / path.mean() - 1, np.sqrt(a + b) / path.mean(), dof


def test_coarse_voxels_are_biased():
    value, error, dof = bias(32)
    print(f"32^3: {value:+.3%} +- {error:.3%}, dof {dof:.0f}")
    assert abs(value) > comparing.limit(dof=dof) * error


def test_bias_falls_with_the_square_of_the_voxel():
    (coarse, coarse_error, _), (value, error, dof) = bias(32), bias(64)
    print(f"64^3: {value:+.3%} +- {error:.3%}, h^2 says {coarse / 4:+.3%}")
    spread = np.hypot(error, coarse_error / 4)
    assert abs(value - coarse / 4) < comparing.limit(dof=dof) * spread
    # About 5 standard errors apart: a bias that stays is not taken for one that falls.
    assert abs(value - coarse) > 3.0 * np.hypot(error, coarse_error)


def test_bias_of_few_voxels_falls_faster_than_the_voxel():
    (coarse, coarse_error, _), (value, error, dof) = bias(16), bias(32)
    print(f"16^3: {coarse:+.3%} +- {coarse_error:.3%}, {coarse / value:.1f} times that of 32^3")
    noise = comparing.limit(dof=dof) * np.hypot(coarse_error, 4 * error)
    # As h alone would be 2 times; h^2 is 4 times, less what h^4 takes off.
    assert 2 * abs(value) < abs(coarse) < 4 * abs(value) + noise
