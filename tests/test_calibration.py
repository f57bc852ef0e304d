"""Error bars are true, runs are reproducible, merged runs are one run.

False alarms: 1e-5 per assertion, about 15 assertions (the Kolmogorov-Smirnov tests by Bonferroni
over what they test). 200 runs of 2000 photons, each compared with one long run of a thousand times
as many.
"""

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached
from scipy import stats

pytestmark = pytest.mark.cpu_only("test_gpu.py holds the GPU's voxels and pixels against the CPU's")

SHAPE, SPACING = (3, 4, 5), (1.0, 0.8, 0.6)
VIEW = truth.View((9, -6, 3), (1.5, 1.6, 1.5), (4, 3), fov=18)
SEEDS = 200
REFERENCE = 2e6  # photons


def scene(kind, **options):
    rng = np.random.default_rng(91)
    density = rng.gamma(2.0, 0.5, SHAPE).astype(np.float32)
    light = (
        mcrt.DirectionalLight((0.4, -0.5, -0.8), 1.0)
        if kind == "directional"
        else mcrt.EnvironmentLight(1.0)
    )
    base = {
        "spacing": SPACING,
        "extinction": 1.0,
        "albedo": 0.95,
        "light": light,
        "camera": VIEW.camera(),
    }
    return mcrt.simulate(density, **base | {"method": "photon"} | options)


@cached
def replicas(kind, photons):
    """z-scores (seeds, values) of voxels and of pixels, their degrees of freedom, and what they are
    scores of."""
    reference = scene(kind, photons=REFERENCE, seed=10**6)
    voxels, absorbed, pixels = [], [], []
    off = {"voxel": [], "absorbed": [], "pixel": []}
    for seed in range(SEEDS):
        run = scene(kind, photons=photons, seed=seed, threads=1)
        voxels.append(
            comparing.z_scores(
                run.fluence, reference.fluence, run.fluence_error, reference.fluence_error, 0
            ).ravel()
        )
        absorbed.append(
            comparing.z_scores(
                run.absorbed, reference.absorbed, run.absorbed_error, reference.absorbed_error, 0
            ).ravel()
        )
        pixels.append(
            comparing.z_scores(
                run.image(), reference.image(), run.image_error(), reference.image_error(), 0
            ).ravel()
        )
        off["voxel"].append((run.fluence - reference.fluence).ravel())
        off["absorbed"].append((run.absorbed - reference.absorbed).ravel())
        off["pixel"].append((run.image() - reference.image()).ravel())
    off = {name: np.array(values, float) for name, values in off.items()}
    return {
        "voxel": (np.array(voxels), comparing.dof(run), off["voxel"]),
        "absorbed": (np.array(absorbed), comparing.dof(run), off["absorbed"]),
        "pixel": (np.array(pixels), comparing.dof(run, "pixel"), off["pixel"]),
    }


@pytest.mark.parametrize("kind", ["directional", "environment"])
@pytest.mark.parametrize("of", ["voxel", "absorbed", "pixel"])
def test_z_scores_follow_students_t(of, kind):
    z, dof, _ = replicas(kind, 2000)[of]
    assert dof >= 7
    # Each voxel's 200 z-scores are independent of each other: a Kolmogorov-Smirnov test for each.
    p = np.array([stats.kstest(column, stats.t(dof).cdf).pvalue for column in z.T])
    assert p.min() > comparing.ALPHA / len(p), (
        f"smallest p {p.min():.1e} of {len(p)}; mean z {z.mean():.3f}, var {z.var():.3f}"
    )


@pytest.mark.parametrize("of", ["voxel", "absorbed", "pixel"])
@pytest.mark.parametrize(
    ("kind", "photons", "skewness"),
    [("directional", 2000, 0.2), ("environment", 2000, 0.1), ("environment", 20_000, 0.01)],
)
def test_error_bars_have_the_right_size(kind, photons, skewness, of):
    """Each seed's mean z^2 over voxels is one sample, for its voxels share photons.

    Of normal batches it is dof / (dof - 2) on average. Sums of few photons are skew, which makes it
    larger, by as much less as there are more photons: 2000 of the sky by 6 to 10 % (so does an
    analog walk), and of the sun, which are tallied from their second flight on, by 17 %; that is 3
    to 8 % of an error bar. 3 % are for the rounding of what 200 seeds share, the truth.
    """
    z, _, off = replicas(kind, photons)[of]
    # What light rays find of the sun hardly adds to the noise: their 7 degrees of freedom do not
    # count.
    dof = 15 if of == "pixel" else scene(kind, photons=photons, threads=1).stats.batches - 1
    sample = (z**2).mean(1)
    expected = dof / (dof - 2)
    noise = comparing.limit(1, SEEDS - 1) * stats.sem(sample) + 0.03
    print(f"mean z^2 {sample.mean():.3f} +- {stats.sem(sample):.3f}, {expected:.3f}")
    assert -noise < sample.mean() - expected < noise + skewness
    assert noise < 0.35 * expected
    # No bias: of what is off itself, for skewness couples the mean of z with its error. The
    # reference is off by as much less as it has more photons.
    drift = (off / off.std(0)).mean(1)
    error = stats.sem(drift) * np.sqrt(1 + SEEDS * photons / REFERENCE)
    assert abs(drift.mean()) < comparing.limit(1, SEEDS - 1) * error


def same(a, b):
    arrays = ("fluence", "fluence_error", "radiance", "radiance_error", "absorbed")
    equal = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in arrays)
    equal &= np.array_equal(a.image(), b.image()) and np.array_equal(
        a.image_error(), b.image_error()
    )
    names = ("launched", "missed", "unscattered", "absorbed", "truncated", "roulette")
    equal &= all(np.array_equal(getattr(a.energy, name), getattr(b.energy, name)) for name in names)
    return (
        equal
        and a.energy.escaped.keys() == b.energy.escaped.keys()
        and all(
            np.array_equal(a.energy.escaped[face], b.energy.escaped[face])
            for face in a.energy.escaped
        )
    )


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "directional", "tracker": "woodcock"},
        {"kind": "directional", "tracker": "march", "interpolation": "nearest"},
        {"kind": "environment", "phase": mcrt.HenyeyGreenstein, "extinction": (0.5, 2.0, 4.0)},
    ],
    ids=["woodcock", "march", "chromatic"],
)
def test_a_seed_gives_the_same_bits_on_any_number_of_threads(options):
    options = dict(options)
    if "phase" in options:
        options["phase"] = options["phase"](0.7)
    runs = [
        scene(photons=50_000, seed=7, threads=threads, **options) for threads in (1, 2, 3, None)
    ]
    assert all(same(runs[0], run) for run in runs[1:])
    assert np.array_equal(runs[0].fluence, scene(photons=5e4, seed=7, threads=1, **options).fluence)


def test_seeds_give_different_photons():
    a, b = (scene("directional", photons=2000, seed=seed) for seed in (7, 8))
    assert not np.array_equal(a.fluence, b.fluence)
    # Neighbouring seeds are independent: no correlation of their z-scores.
    z, _, _ = replicas("directional", 2000)["voxel"]
    z = z - z.mean(0)  # which correlates them by -1 / SEEDS
    pairs = (z[:-1] * z[1:]).mean(1)
    assert abs(pairs.mean() + 1 / SEEDS) < comparing.limit(1, SEEDS - 2) * stats.sem(pairs)


def test_merged_runs_weigh_by_their_photons():
    a, b = (
        scene("environment", photons=20_000, seed=1),
        scene("environment", photons=60_000, seed=2),
    )
    n, m = float(a.stats["photons"]), float(b.stats["photons"])
    merged = a + b
    assert float(merged.stats["photons"]) == n + m
    for name in ("fluence", "radiance"):
        mean = (n * getattr(a, name).astype(float) + m * getattr(b, name)) / (n + m)
        np.testing.assert_allclose(getattr(merged, name), mean, rtol=1e-6)
        error = np.hypot(
            n * getattr(a, name + "_error").astype(float), m * getattr(b, name + "_error")
        ) / (n + m)
        np.testing.assert_allclose(getattr(merged, name + "_error"), error, rtol=1e-6)
    np.testing.assert_allclose(merged.image(), (n * a.image() + m * b.image()) / (n + m), rtol=1e-6)
    for name in ("absorbed", "unscattered", "missed", "truncated"):
        mean = (n * getattr(a.energy, name) + m * getattr(b.energy, name)) / (n + m)
        assert getattr(merged.energy, name) == pytest.approx(mean, rel=1e-6, abs=1e-9)
    comparing.assert_balance(merged.energy)
    assert merged.energy.launched == a.energy.launched


def test_merged_runs_agree_with_one_long_run():
    merged = scene("directional", photons=1e5, seed=3) + scene("directional", photons=3e5, seed=4)
    reference = scene("directional", photons=2e6, seed=10**6)
    voxel, pixel = comparing.dof(merged), comparing.dof(merged, "pixel")
    comparing.assert_z(
        merged.fluence, reference.fluence, merged.fluence_error, reference.fluence_error, dof=voxel
    )
    comparing.assert_z(
        merged.image(), reference.image(), merged.image_error(), reference.image_error(), dof=pixel
    )
    single = scene("directional", photons=4e5, seed=5)
    ratio = np.sqrt(
        np.mean(merged.fluence_error.astype(float) ** 2)
        / np.mean(single.fluence_error.astype(float) ** 2)
    )
    # From seed to seed it scatters by 2 %.
    assert 0.9 < ratio < 1.1


def test_errors_fall_as_one_over_the_root_of_the_photons():
    errors = [
        np.sqrt(np.mean(scene("environment", photons=n, seed=6).fluence_error.astype(float) ** 2))
        for n in (2e4, 3.2e5)
    ]
    # From seed to seed it scatters by 1.5 %.
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.07)
