"""The two backends against each other.

False alarms: 1e-5 per assertion of test_voxels_of_both_* and test_pixels_of_both_*, of which there
are about 20; the others depend on no chance but how rounding falls on this adapter.
"""

import functools

import comparing
import mcrt
import numpy as np
import pytest
import random_scenes
from conftest import CENTRE, EYE, ORIGIN, SHAPE, SPACING, camera, density
from gpu_cases import CPU, GPU, LAMP, SUN, assert_same_fates, bits, python, run
from scipy import stats

pytestmark = [
    pytest.mark.cpu_only("each test names its backends itself"),
    pytest.mark.usefixtures("adapter"),
]

SIZE = np.multiply(SHAPE, SPACING)[::-1]
INSIDE = mcrt.PointLight(CENTRE, 1.0)
BEAM = mcrt.PencilBeam((0.0, -17.3, 32.6), (1.0, 0.02, 0.03), 1.0)
TEXELS = np.where(np.arange(72).reshape(4, 6, 3) % 7 == 3, 20, np.arange(72).reshape(4, 6, 3) % 5)
MAP, COLOURS = mcrt.EnvironmentLight(TEXELS[..., 0]), mcrt.EnvironmentLight(TEXELS)
TABLE = mcrt.TabulatedPhase((-1.0, 0.0, 0.8, 1.0), (1.0, 0.2, 1.0, 6.0))
HG = mcrt.HenyeyGreenstein
CHROMATIC = (0.4, 0.8, 1.6)
GLOW = np.random.default_rng(5).random((*SHAPE, 3)).astype(np.float32)


# -------------------------------------------------------------------------- the same random numbers


def random_albedo():
    return np.clip(np.random.default_rng(3).random(SHAPE) * 1.4 - 0.2, 0, 1)


PHOTONS = {
    "linear": {"phase": TABLE},
    "nearest": {"interpolation": "nearest", "phase": mcrt.Rayleigh()},
    "constant": {"volume": np.ones(SHAPE), "phase": HG(0.6)},
    "constant, march": {"volume": np.ones(SHAPE), "tracker": "march"},
    "sparse": {"volume": np.where(density(1) > 0.9, 5.0, 0.0), "extinction": 3.0},
    "march": {"tracker": "march"},
    "march, nearest": {"tracker": "march", "interpolation": "nearest", "phase": TABLE},
    "rgb": {"albedo": (0.99, 0.6, 0.2), "light": mcrt.DirectionalLight((1, 0, 0), (1, 2, 3))},
    "albedo of voxels": {"albedo": random_albedo(), "light": SUN},
    "chromatic": {"extinction": CHROMATIC, "tracker": "woodcock"},
    "chromatic, march": {"extinction": CHROMATIC, "tracker": "march", "phase": HG(0.5)},
    "two scatterings": {"max_scatterings": 2, "light": SUN},
    "beam": {"light": BEAM},
    "lamp inside": {"light": INSIDE, "extinction": 0.4, "phase": HG(-0.7)},
    "far lamp": {"light": mcrt.PointLight((6e6, -9e6, 16e6), 1e14)},
    "sky": {"light": mcrt.EnvironmentLight(1.0)},
    "map": {"light": MAP},
    "map in colours": {"light": COLOURS},
    "many lights": {"light": [LAMP, SUN, INSIDE, BEAM, MAP]},
    "harmonics": {"phase": HG(0.4), "angular": 3},
    "harmonics in colours": {"phase": mcrt.Rayleigh(), "angular": "sh", "albedo": (0.9, 0.6, 0.2)},
    "glow": {"light": (), "emission": GLOW[..., 0]},
    "glow in colours": {"emission": GLOW, "extinction": CHROMATIC, "interpolation": "nearest"},
    "single": {"method": "single", "light": MAP},
    "image of no batches": {"errors": False, "outputs": ("image",)},
}
BOX = mcrt.Medium.box(SIZE, origin=ORIGIN, extinction=2.0, phase=HG(0.3))
BALL = mcrt.Medium.sphere(1.5, center=CENTRE, extinction=2.0, emission=(1, 2, 3))
PATHS = {
    "linear": {},
    "nearest": {"interpolation": "nearest", "phase": HG(0.6)},
    "constant": {"volume": np.ones(SHAPE), "light": SUN},
    "box": {"volume": BOX, "light": [SUN, INSIDE]},
    "ball": {"volume": BALL},
    "march": {"tracker": "march", "light": [SUN, COLOURS]},
    "rgb, tabulated": {"albedo": (0.99, 0.6, 0.2), "phase": TABLE},
    "albedo of voxels": {"albedo": random_albedo(), "phase": mcrt.Rayleigh()},
    "chromatic": {"extinction": CHROMATIC, "light": [SUN, MAP]},
    "lamp inside": {"light": INSIDE},
    "eye inside": {
        "camera": mcrt.PerspectiveCamera(CENTRE, (14, -19, 35), fov=80, resolution=(9, 9))
    },
    "parallel": {"camera": mcrt.OrthographicCamera(EYE, CENTRE, width=3, resolution=(14, 9))},
    "two scatterings": {"max_scatterings": 2},
    "glow": {"light": (), "emission": GLOW[..., 0]},
    "glow in colours": {"emission": GLOW, "extinction": CHROMATIC},
}


@pytest.mark.parametrize("name", PHOTONS)
def test_photons_of_a_seed_share_their_fates(name):
    options = {"photons": 20_000, "seed": 7} | PHOTONS[name]
    if options.get("method") == "single":
        del options["photons"]
    assert_same_fates(*(run(**options, backend=backend) for backend in (CPU, GPU)))


@pytest.mark.parametrize("name", PATHS)
def test_paths_of_a_seed_share_their_fates(name):
    options = {"method": "path", "spp": 64, "seed": 7} | PATHS[name]
    assert_same_fates(*(run(**options, backend=backend) for backend in (CPU, GPU)))


def test_a_target_is_met_after_the_same_photons():
    runs = [run(target_error=0.03, backend=backend) for backend in (CPU, GPU)]
    assert runs[0].stats.stopped_by == runs[1].stats.stopped_by == "target_error"
    assert_same_fates(*runs)


def test_random_scenes_do_not_tell_the_backends_apart():
    found = [random_scenes.compare(number) for number in range(13)]  # 1000 in `make validate`
    print(random_scenes.summary(found, 0.0))
    assert sum(bool(one.refused) for one in found) < 5
    assert random_scenes.well(found)


# ----------------------------------------------------------------------------- other random numbers

PAIRS = 50
KINDS = {
    "sun": {"light": SUN, "extinction": 2.0, "albedo": 0.95},
    "sky": {"light": mcrt.EnvironmentLight(1.0), "phase": HG(0.5), "interpolation": "nearest"},
}


@functools.cache
def pairs(kind):
    """Results of the CPU and of the GPU, of different seeds."""
    options = {"photons": 16_000, "camera": camera(resolution=(6, 4))} | KINDS[kind]
    sides = []
    for first, backend in enumerate((CPU, GPU)):
        seeds = range(first, 2 * PAIRS, 2)
        sides.append([run(**options, seed=seed, backend=backend) for seed in seeds])
    return list(zip(*sides, strict=True))


def z_scores(kind, name):
    """z (pairs, values) of voxels or pixels, and the degrees of freedom of one of its errors."""
    z, of = [], "pixel" if name == "image" else "voxel"
    for pair in pairs(kind):
        if name == "image":
            (a, b), (ea, eb) = ([r.image() for r in pair], [r.image_error() for r in pair])
        else:
            (a, b), (ea, eb) = ([getattr(r, name + part) for r in pair] for part in ("", "_error"))
        z.append(comparing.z_scores(a, b, ea, eb, 0).ravel())
    z = np.array(z)
    return z[:, z.any(0)], comparing.dof(pairs(kind)[0][0], of)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["fluence", "radiance", "absorbed", "image"])
def test_voxels_of_both_differ_by_students_t(name, kind):
    # Two errors of `dof` degrees of freedom, of equal size: 2 dof (Welch).
    z, dof = z_scores(kind, name)
    # Each voxel's z-scores are independent of each other: a Kolmogorov-Smirnov test for each.
    p = np.array([stats.kstest(column, stats.t(2 * dof).cdf).pvalue for column in z.T])
    print(f"smallest p {p.min():.2g} of {len(p)}, median {np.median(p):.2f}; var {z.var():.3f}")
    assert len(p) >= 18
    assert p.min() > comparing.ALPHA / len(p)
    # Voxels of one pair share photons, pairs do not: mean z^2 is 2 dof / (2 dof - 2) on average.
    # 10 %: tallies of few photons are skew.
    sample, expected = (z**2).mean(1), dof / (dof - 1)
    bound = comparing.limit(1, PAIRS - 1) * stats.sem(sample) + 0.1 * expected
    assert abs(sample.mean() - expected) < bound < 0.5 * expected


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", ["fluence", "radiance", "image", "absorbed", "escaped", "unscattered"]
)
def test_voxels_of_both_have_the_same_mean(name, kind):
    def mean(result):
        if name in ("fluence", "radiance"):
            return getattr(result, name).mean(dtype=float)
        if name == "image":
            return result.image().mean(dtype=float)
        share = getattr(result.energy, name)
        return sum(share.values()) if name == "escaped" else share

    means = np.array([[mean(result) for result in pair] for pair in pairs(kind)])
    difference = means[:, 0] - means[:, 1]
    print(f"{difference.mean() / means.mean():.1e} +- {stats.sem(difference) / means.mean():.1e}")
    comparing.assert_mean(difference / means.mean(), 0.0, what=name)
    assert stats.sem(difference) < 5e-3 * means.mean()


@pytest.mark.parametrize(
    "options", [{"phase": HG(0.6)}, {"light": [SUN, MAP], "albedo": (0.9, 0.6, 0.3)}]
)
def test_pixels_of_both_differ_by_a_normal_z(options):
    options = {"method": "path", "spp": 700, "camera": camera(resolution=(48, 32))} | options
    a, b = (run(**options, seed=seed, backend=one) for seed, one in enumerate((CPU, GPU)))
    assert comparing.dof(a, "pixel") > 100
    scores = comparing.z_scores(a.image(), b.image(), a.image_error(), b.image_error(), 0)
    # Each pixel has its own paths; the channels of one share them.
    for z in np.moveaxis(scores.reshape(48 * 32, -1), -1, 0):
        z = z[z != 0]  # beside the volume there is nothing
        p = stats.kstest(z, "norm").pvalue
        print(f"{len(z)} pixels: p {p:.2g}, mean {z.mean():.3f}, std {z.std():.3f}")
        assert len(z) > 500
        assert p > comparing.ALPHA
        assert abs(z.mean()) < comparing.limit() / np.sqrt(len(z))
        chi_square = stats.chi2(len(z))
        assert (
            chi_square.ppf(comparing.ALPHA / 2) < (z**2).sum() < chi_square.isf(comparing.ALPHA / 2)
        )


# ------------------------------------------------------------------------------------ the same bits

REPEATED = {
    "photon": {
        "light": [LAMP, MAP],
        "photons": 20_000,
        "phase": HG(0.5),
        "albedo": (0.9, 0.6, 0.3),
    },
    "harmonics": {"photons": 10_000, "phase": HG(0.5), "angular": 2},
    "path": {"light": [LAMP, MAP], "spp": 64, "method": "path", "extinction": CHROMATIC},
}


@pytest.mark.parametrize("name", REPEATED)
def test_a_seed_gives_the_same_bits_in_every_run_and_process(name):
    digests = {bits(run(**REPEATED[name], seed=3)) for _ in range(2)}
    code = f"import test_gpu as t; print(t.bits(t.run(**t.REPEATED[{name!r}], seed=3)))"
    digests.add(python(code).stdout.split()[-1])
    assert len(digests) == 1
    assert bits(run(**REPEATED[name], seed=4)) not in digests


@pytest.mark.parametrize("name", REPEATED)
def test_the_number_of_threads_does_not_matter(name):
    assert len({bits(run(**REPEATED[name], threads=threads)) for threads in (1, 2, None)}) == 1
