"""Absorbed power where the absorption coefficient varies within voxels, found by itself.

False alarms: 1e-5 per assertion (Bonferroni over voxels), about 30 assertions.
"""

import os
from unittest.mock import patch

import comparing
import mcrt
import numpy as np
import pytest
from scipy import stats

CPU = pytest.mark.cpu_only("the GPU has one walk; other cases take it through the same shaders")

SHAPE = (4, 3, 5)
SPACING = (1.2, 1.0, 0.8)
FINER = 6


def steep(seed=1):
    """Voxels of density 0 and 1 side by side."""
    return (np.random.default_rng(seed).random(SHAPE) < 0.4).astype(np.float32)


def varied(seed=2):
    return np.random.default_rng(seed).random(SHAPE, dtype=np.float32)


RGB = (0.5, 1.5, 4.0)
CASES = {
    "grey": {},
    "scalar": {"simd": "scalar"},
    "march": {"tracker": "march"},
    "albedo": {"albedo": varied()},
    "albedo alone": {"volume": np.ones(SHAPE, np.float32), "albedo": varied()},
    "albedo, march": {"albedo": varied(), "tracker": "march"},
    "rgb": {"albedo": (0.2, 0.6, 0.9)},
    "chromatic": {"extinction": RGB, "tracker": "woodcock"},
    "chromatic march": {"extinction": RGB, "tracker": "march"},
    "thin": {"extinction": (0.02, 0.1, 0.2), "tracker": "woodcock"},
    "anisotropic": {"phase": mcrt.HenyeyGreenstein(0.6)},
    "two orders": {"max_scatterings": 1},
    "emission": {"emission": varied(), "light": []},
    "beam": {"light": mcrt.PencilBeam((1.9, 1.3, 9.0), (0.1, 0.2, -1.0))},
}
LOCAL = ("grey", "march", "albedo", "albedo alone", "chromatic", "chromatic march", "thin", "beam")


def cases(names, everywhere):
    return [pytest.param(name, marks=() if name in everywhere else CPU) for name in names]


def scene(case, **options):
    base = {
        "volume": steep(),
        "spacing": SPACING,
        "extinction": 2.0,
        "albedo": 0.6,
        "light": mcrt.EnvironmentLight(1.0),
        "method": "photon",
        "outputs": ("fluence",),
        "progress": False,
    }
    arguments = base | CASES[case] | options
    with patch.dict(os.environ, {"MCRT_SIMD": arguments.pop("simd", "")}):
        return mcrt.simulate(**arguments)


def finer(values):
    """The values that linear interpolation gives, on voxels so fine that each has its mean."""
    for axis in range(3):
        n = values.shape[axis]
        at = np.clip((np.arange(n * FINER) + 0.5) / FINER - 0.5, 0, n - 1)
        low = np.minimum(at.astype(int), max(n - 2, 0))
        part = (at - low).reshape([-1 if a == axis else 1 for a in range(3)])
        upper = values.take(np.minimum(low + 1, n - 1), axis)
        values = values.take(low, axis) * (1 - part) + upper * part
    return values.astype(np.float32)


def coarser(values):
    """Means over the voxels that `finer` cut."""
    nz, ny, nx = SHAPE
    return values.reshape(nz, FINER, ny, FINER, nx, FINER, -1).mean((1, 3, 5), dtype=float)


@pytest.mark.parametrize("case", cases(CASES, ("grey", "albedo", "chromatic", "chromatic march")))
def test_absorbed_power_adds_up_to_the_energy(case):
    runs = [scene(case, photons=5e3, seed=seed) for seed in range(24)]
    volume = np.prod(SPACING)
    sums = np.array([r.absorbed.astype(float).sum((0, 1, 2)) * volume for r in runs])
    energies = np.array([r.energy.absorbed * np.asarray(r.energy.launched) for r in runs])
    for c, mean in enumerate(np.atleast_1d(energies.mean(0))):
        difference = (sums - energies).reshape(len(runs), -1)[:, c]
        comparing.assert_mean(1 + difference / mean, 1.0, what=f"{case}, channel {c}")


@pytest.mark.parametrize("case", cases(LOCAL, ("albedo",)))
def test_absorbed_is_that_of_fine_voxels(case):
    options = {"volume": steep()} | CASES[case]
    options = {
        name: finer(value) if isinstance(value, np.ndarray) else value
        for name, value in options.items()
    }
    options["spacing"] = tuple(np.divide(SPACING, FINER))
    options["interpolation"] = "nearest"
    runs = [scene(case, photons=6e3, seed=seed, **options) for seed in range(24)]
    fine = np.array([coarser(run.absorbed) for run in runs])
    linear = scene(case, photons=1e5, seed=100)
    shape = (*SHAPE, -1)
    comparing.assert_z(
        linear.absorbed.reshape(shape),
        fine.mean(0),
        linear.absorbed_error.reshape(shape),
        stats.sem(fine),
        dof=len(fine) - 1,
        # Beams are narrower than fine voxels, whose faces they may follow: these are 4 % off, and
        # .3 % where they are 24 to a voxel.
        # The others: fine voxels hold means, whose second order is 1 / (12 * 36) of a voxel's.
        relative=3e-2 if case == "beam" else 2e-3,
        what=case,
    )


@pytest.mark.parametrize("extinction", [0.5, 5.0])
def test_a_single_voxel_in_a_void_absorbs_beyond_its_faces(extinction):
    # Light enters all of the hat by the plane z = 3.5, cut into midpoints.
    middle = (np.arange(400) + 0.5) / 400 * 5
    x, y = np.meshgrid(middle, middle)
    slant = np.sqrt(1 + 0.4**2 + 0.1**2)
    column = np.zeros_like(x)
    for down in (np.arange(200) + 0.5) / 100:
        across = np.clip(1 - abs(x - 0.4 * down - 2.5), 0, None)
        across *= np.clip(1 - abs(y + 0.1 * down - 2.5), 0, None)
        column += across * (1 - abs(down - 1)) * slant / 100
    truth = (1 - np.exp(-extinction * column)).sum() * (5 / 400) ** 2 / slant
    density = np.zeros((5, 5, 5), np.float32)
    density[2, 2, 2] = 1.0
    light = mcrt.DirectionalLight((-0.4, 0.1, -1.0))
    result = mcrt.simulate(density, extinction=extinction, albedo=0.0, light=light, progress=False)
    total = result.absorbed.sum(dtype=float)
    assert total == pytest.approx(result.energy.absorbed * result.energy.launched, rel=1e-6)
    assert total == pytest.approx(truth, rel=1e-5)
    # Of a hat three quarters along each axis lie in its voxel, all together .42.
    assert result.absorbed[2, 2, 2] < 0.43 * total


def test_merged_and_saved_runs_keep_what_is_absorbed(tmp_path):
    a, b = (scene("grey", photons=4e3, seed=seed) for seed in (1, 2))
    merged = a + b
    np.testing.assert_allclose(merged.absorbed, (a.absorbed + b.absorbed) / 2, rtol=1e-6)
    error = np.hypot(a.absorbed_error, b.absorbed_error) / 2
    np.testing.assert_allclose(merged.absorbed_error, error, rtol=1e-6)
    merged.save(tmp_path / "run.npz")
    loaded = mcrt.Result.load(tmp_path / "run.npz")
    assert np.array_equal(loaded.absorbed, merged.absorbed)
    assert np.array_equal(loaded.absorbed_error, merged.absorbed_error)


@CPU
def test_absorption_is_tallied_only_where_it_varies_within_voxels():
    def bins(**options):
        plan = mcrt.plan(steep(), outputs=("fluence",), method="photon", photons=1000, **options)
        return plan["bytes_by_part"]["tally bins"]

    linear = bins()
    assert bins(interpolation="nearest") == bins(albedo=1.0) == linear / 2
    assert bins(albedo=varied()) == linear
