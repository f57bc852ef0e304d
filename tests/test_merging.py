"""Merged runs are one run: their means, their errors, and the degrees of freedom of these.

Where the arithmetic is what is tested, runs are drawn from the normal distribution that batches of
many photons follow. False alarms: 1e-5 per assertion, about 20 assertions.
"""

import comparing
import mcrt
import numpy as np
import pytest
from conftest import cached, run
from scipy import stats

pytestmark = pytest.mark.cpu_only("adds arrays, whoever made them")

ARRAYS = ("fluence", "fluence_error", "radiance", "radiance_error", "absorbed", "absorbed_error")
DRAWS = (20, 1000)  # "voxels", each an independent estimate of 0


@cached
def runs():
    """Three runs of different numbers of photons, batches and threads."""
    return [
        run(seed=seed, photons=photons, threads=threads, progress=False)
        for seed, photons, threads in ((5, 4000, 1), (1, 20_000, 2), (3, 900, None))
    ]


def everything(result):
    """All that a result holds, as one flat dictionary."""
    flat = {name: getattr(result, name) for name in ARRAYS}
    flat |= {"image": result.image(), "image_error": result.image_error()}
    flat |= {f"energy {name}": value for name, value in result.energy.items()}
    flat |= {f"stats {name}": value for name, value in result.stats.items()}
    return flat | {"plan": str(result.plan), "warnings": result.warnings, "seeds": result._seeds}


def same_bits(a, b):
    a, b = everything(a), everything(b)
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def test_the_order_of_a_sum_does_not_change_a_bit():
    a, b, c = runs()
    assert same_bits(a + b, b + a)
    assert same_bits((a + b) + c, c + (b + a))
    assert (a + b)._settings == (b + a)._settings


def test_the_grouping_of_a_sum_changes_rounding_only():
    a, b, c = runs()
    left, right, total = (a + b) + c, a + (b + c), sum([a, b, c])
    for name in (*ARRAYS, "image"):
        values = [np.asarray(everything(r)[name]) for r in (left, right, total)]
        np.testing.assert_allclose(values[0], values[1], rtol=1e-6)
        np.testing.assert_array_equal(values[0], values[2])
    nu = [r.stats.degrees_of_freedom for r in (left, right, total)]
    np.testing.assert_allclose(nu, nu[0], rtol=1e-12)
    for name in ("photons", "collisions", "batches", "degrees_of_freedom_pixel", "stopped_by"):
        assert len({r.stats[name] for r in (left, right, total)}) == 1
    assert left._seeds == right._seeds == (1, 3, 5)
    assert str(left.plan) == str(right.plan)


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite():
    n, nu = np.array([[r.stats.photons, r.stats.degrees_of_freedom] for r in runs()]).T
    merged = sum(runs())
    assert merged.stats.degrees_of_freedom == pytest.approx(n.sum() ** 2 / (n**2 / nu).sum())
    assert merged.stats.degrees_of_freedom_pixel == 15
    one, other = (run(seed=seed, photons=4000).stats for seed in (1, 2))
    equal = run(seed=1, photons=4000) + run(seed=2, photons=4000)
    assert one.degrees_of_freedom == other.degrees_of_freedom > 0
    assert equal.stats.degrees_of_freedom == pytest.approx(2 * one.degrees_of_freedom)


@pytest.mark.cpu_only("shows arrays, whoever made them")
def test_the_plan_of_a_merge_tells_its_photons_and_seeds():
    merged = sum(runs())
    assert merged.plan.photons == merged.stats.photons == sum(r.stats.photons for r in runs())
    assert merged.plan.batches == merged.stats.batches
    rows = [row for row in merged.plan.decisions if row[0] == "merged"]
    assert rows == [("merged", "3 independent runs", rows[0][2])]
    assert "seeds 1, 3, 5" in rows[0][2]
    assert merged.plan.method == "photon"


def drawn(seed, photons, batches, subvolumes=16):
    """A result whose voxels are estimates of 0 by normally distributed batches of photons."""
    like = runs()[0]
    rng = np.random.default_rng(seed)
    each = rng.normal(size=(*DRAWS, batches)) * np.sqrt(batches / photons)
    parts = rng.normal(size=(*DRAWS, subvolumes)) * np.sqrt(subvolumes / photons)
    data = {
        **like._whole(),
        "fluence": each.mean(-1).astype(np.float32),
        "fluence_error": (each.std(-1, ddof=1) / np.sqrt(batches)).astype(np.float32),
        "source": parts.mean(-1).astype(np.float32),
        "source0": None,
        "subvolumes": parts.astype(np.float32),
        "stats": {
            **like._data["stats"],
            "photons": photons,
            "batches": batches,
            "degrees_of_freedom": batches - 1,
            "degrees_of_freedom_pixel": subvolumes - 1,
        },
    }
    return mcrt.Result(like._scene, {**like._settings, "seed": seed}, data)


MERGED = {
    "equal": [(10_000, 4)] * 2,
    "many": [(10_000, 3)] * 8,
    "long and short": [(1_000_000, 30), (1000, 3)],
    "short and long": [(1000, 3), (1_000_000, 30)],
    "long and uncertain": [(30_000, 3), (40_000, 40)],
}


@pytest.mark.cpu_only("adds arrays, whoever made them")
@pytest.mark.parametrize("kind", MERGED)
def test_z_of_merged_voxels_follows_students_t(kind):
    merged = sum(drawn(seed, *given) for seed, given in enumerate(MERGED[kind]))
    z = merged._data["fluence"] / merged._data["fluence_error"]
    nu = merged._data["stats"]["degrees_of_freedom"]
    p = stats.kstest(z.ravel(), stats.t(nu).cdf).pvalue
    assert p > comparing.ALPHA, f"p {p:.1e} with {nu} degrees of freedom"


@pytest.mark.cpu_only("adds arrays, whoever made them")
@pytest.mark.parametrize("subvolumes", [(16, 16), (16, 3), (5, 16), (8, 7), (16, 2)])
def test_z_of_merged_pixels_follows_students_t(subvolumes):
    photons = (3000, 10_000)
    merged = sum(
        drawn(seed, n, 30, k) for seed, (n, k) in enumerate(zip(photons, subvolumes, strict=True))
    )
    parts = merged._data["subvolumes"].astype(float)
    k = parts.shape[-1]
    assert k == min(subvolumes)
    assert merged._data["stats"]["degrees_of_freedom_pixel"] == k - 1
    np.testing.assert_allclose(parts.mean(-1), merged._data["source"], atol=1e-7)
    z = merged._data["source"] / (parts.std(-1, ddof=1) / np.sqrt(k))
    p = stats.kstest(z.ravel(), stats.t(k - 1).cdf).pvalue
    assert p > comparing.ALPHA, f"p {p:.1e}"


@pytest.mark.parametrize("photons", [1, 3, 20])
def test_a_run_cut_short_merges_with_a_long_one(photons):
    long, short = run(), run(seed=1, photons=photons)
    merged = short + long
    n, m = long.stats.photons, short.stats.photons
    mean = (n * long.image().astype(float) + m * short.image()) / (n + m)
    np.testing.assert_allclose(merged.image(), mean, rtol=1e-6, atol=1e-9)
    error = merged.image_error()
    unknown = short.stats.batches < 2  # its error is not known, nor that of the sum
    assert np.isinf(merged.fluence_error).any() == unknown
    assert np.isinf(error).all() if unknown else np.isfinite(error).all()
    assert merged.stats.degrees_of_freedom_pixel == min(15, max(short.stats.batches - 1, 0))
    assert (merged.stats.degrees_of_freedom == 0) == unknown


@pytest.mark.cpu_only("adds arrays, whoever made them")
def test_a_run_without_photons_says_nothing():
    long = runs()[0]
    nothing = drawn(7, 1000, 2)
    shape = long.fluence.shape
    nothing._data |= {name: np.full(shape, np.inf, np.float32) for name in ARRAYS[:4]}
    nothing._data |= {"source": None, "subvolumes": None}
    nothing._data["stats"] |= {"photons": 0, "batches": 0, "degrees_of_freedom": 0}
    for merged in (long + nothing, nothing + long):
        np.testing.assert_array_equal(merged.fluence, long.fluence)
        np.testing.assert_array_equal(merged.fluence_error, long.fluence_error)
        np.testing.assert_array_equal(merged.image_error(), long.image_error())
        for name in ("degrees_of_freedom", "degrees_of_freedom_pixel", "photons"):
            assert merged.stats[name] == long.stats[name]


@pytest.mark.cpu_only("adds arrays, whoever made them")
def test_a_run_whose_photons_met_nothing_counts_as_darkness():
    thin = {"extinction": 1e-4, "light": mcrt.DirectionalLight((0, 0, -1), 1.0)}
    some, none = run(**thin, photons=10**6), run(**thin, seed=1, photons=2)
    merged = some + none
    expected = some.stats.photons / merged.stats.photons * some.fluence.astype(float)
    expected += none.stats.photons / merged.stats.photons * none.fluence
    np.testing.assert_allclose(merged.fluence, expected, rtol=1e-6)
    assert np.isfinite(merged.image()).all()


def test_runs_without_photons_share_alike():
    runs = [run(method="single", photons=None, seed=seed) for seed in (0, 1, 2)]
    merged = (runs[1] + runs[0]) + runs[2]
    for name in ("fluence", "fluence_error"):
        values = np.array([getattr(r, name) for r in runs], float)
        expected = values.mean(0) if name == "fluence" else np.sqrt((values**2).sum(0)) / 3
        np.testing.assert_allclose(getattr(merged, name), expected, rtol=3e-7)
    np.testing.assert_array_equal(merged.image(), runs[0].image())
    assert merged.stats.photons == 0
    assert merged.stats.degrees_of_freedom == 3 * runs[0].stats.degrees_of_freedom


def test_power_launched_is_that_of_one_run():
    for photons in (700, 4001, 12_345):
        assert (run() + run(seed=1, photons=photons)).energy.launched == run().energy.launched


@pytest.mark.cpu_only("adds arrays, whoever made them")
def test_what_differs_in_more_than_how_it_ran_is_refused():
    a = run(phase=mcrt.HenyeyGreenstein(0.5), angular=2)
    with pytest.raises(mcrt.SceneError, match="different angular cannot be merged"):
        a + run(phase=mcrt.HenyeyGreenstein(0.5), angular=3, seed=1)
    for name, value in {
        "spacing": (1.5, 1.0, 0.6),
        "origin": (10.0, -20.0, 31.0),
        "albedo": 0.8,
        "interpolation": "nearest",
        "light": [],
        "emission": 1.0,
        "phase": mcrt.Rayleigh(),
    }.items():
        with pytest.raises(mcrt.SceneError, match="different scenes cannot be merged"):
            run() + run(**{name: value}, seed=1)
    merged = run(tracker="march") + run(tracker="woodcock", seed=1, threads=1, photons=9000)
    assert merged.plan.tracker == "march, woodcock"


def test_pixels_of_merged_paths_have_the_degrees_of_freedom_of_both():
    a, b = (run(method="path", photons=None, spp=spp, seed=spp) for spp in (8, 800))
    merged = a + b
    rays = [r.stats.degrees_of_freedom_pixel + 1 for r in (a, b)]
    expected = 808**2 / (8**2 / (rays[0] - 1) + 800**2 / (rays[1] - 1))
    assert merged.stats.degrees_of_freedom_pixel == pytest.approx(expected)
    assert same_image_bits(merged, b + a)


def same_image_bits(a, b):
    return np.array_equal(a.image(), b.image()) and np.array_equal(a.image_error(), b.image_error())
