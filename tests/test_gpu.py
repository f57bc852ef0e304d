"""The two backends against each other, and the GPU against trouble.

False alarms: 1e-5 per assertion of test_voxels_of_both_* and test_pixels_of_both_*, of which there
are about 20; the others depend on no chance but how rounding falls on this adapter.
"""

import functools
import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import mcrt
import numpy as np
import pytest
import random_scenes
import truth
from conftest import CENTRE, EYE, ORIGIN, SHAPE, SPACING, camera, density
from mcrt import _mcrt
from scipy import stats

pytestmark = pytest.mark.cpu_only("each test names its backends itself")

CPU, GPU = "cpu", "gpu"
SIZE = np.multiply(SHAPE, SPACING)[::-1]
LAMP = mcrt.PointLight((30, -40, 50), 1e3)
SUN = mcrt.DirectionalLight((0.3, -0.2, -1.0), 1.0)
INSIDE = mcrt.PointLight(CENTRE, 1.0)
BEAM = mcrt.PencilBeam((0.0, -17.3, 32.6), (1.0, 0.02, 0.03), 1.0)
TEXELS = np.where(np.arange(72).reshape(4, 6, 3) % 7 == 3, 20, np.arange(72).reshape(4, 6, 3) % 5)
MAP, COLOURS = mcrt.EnvironmentLight(TEXELS[..., 0]), mcrt.EnvironmentLight(TEXELS)
TABLE = mcrt.TabulatedPhase((-1.0, 0.0, 0.8, 1.0), (1.0, 0.2, 1.0, 6.0))
HG = mcrt.HenyeyGreenstein
CHROMATIC = (0.4, 0.8, 1.6)
GLOW = np.random.default_rng(5).random((*SHAPE, 3)).astype(np.float32)


@pytest.fixture(scope="module", autouse=True)
def adapter():
    """What backend="gpu" takes."""
    found = _mcrt.info()["adapters"]
    if not found and os.environ.get("MCRT_REQUIRE_GPU"):
        pytest.fail("MCRT_REQUIRE_GPU is set, and there is no GPU adapter")
    if not found:
        pytest.skip("there is no GPU adapter: make vulkan installs one that the processor plays")
    return found[0]


def run(volume=None, **arguments):
    """`simulate` on the small volume."""
    base = {
        "light": LAMP,
        "camera": camera(),
        "method": "photon",
        "progress": False,
        "backend": GPU,
    }
    if not isinstance(volume, mcrt.Medium):
        base |= {"spacing": SPACING, "origin": ORIGIN, "extinction": 0.8}
    return mcrt.simulate(density() if volume is None else volume, **(base | arguments))


def bits(result):
    """A digest of all that a result holds."""
    arrays = random_scenes.arrays(result)
    assert all(np.isfinite(array).all() for array in arrays.values())
    digest = hashlib.sha256(repr(float(result.stats.photons)).encode())
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


# -------------------------------------------------------------------------- the same random numbers


def random_albedo():
    return np.clip(np.random.default_rng(3).random(SHAPE) * 1.4 - 0.2, 0, 1)


PHOTONS = {
    "linear": {},
    "nearest": {"interpolation": "nearest", "phase": mcrt.Rayleigh()},
    "constant": {"volume": np.ones(SHAPE), "phase": HG(0.6)},
    "constant, march": {"volume": np.ones(SHAPE), "tracker": "march"},
    "sparse": {"volume": np.where(density(1) > 0.9, 5.0, 0.0), "extinction": 3.0},
    "march": {"tracker": "march"},
    "march, nearest": {"tracker": "march", "interpolation": "nearest", "phase": TABLE},
    "backward": {"phase": HG(-0.7)},
    "tabulated": {"phase": TABLE},
    "rgb": {"albedo": (0.99, 0.6, 0.2), "light": mcrt.DirectionalLight((1, 0, 0), (1, 2, 3))},
    "albedo of voxels": {"albedo": random_albedo(), "light": SUN},
    "chromatic": {"extinction": CHROMATIC, "tracker": "woodcock"},
    "chromatic, march": {"extinction": CHROMATIC, "tracker": "march", "phase": HG(0.5)},
    "two scatterings": {"max_scatterings": 2, "light": SUN},
    "sun": {"light": SUN, "extinction": 3.0},
    "beam": {"light": BEAM},
    "lamp inside": {"light": INSIDE, "extinction": 0.4},
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


def assert_same_fates(cpu, gpu, flips=2e-3):
    """Equal but for rounding, and for the fates of a few photons that it decides."""
    assert (cpu.plan.backend, gpu.plan.backend) == (CPU, GPU)
    assert cpu.plan.method == gpu.plan.method
    assert cpu.plan.tracker == gpu.plan.tracker
    assert cpu.stats.photons == gpu.stats.photons > 0
    here, there = random_scenes.arrays(cpu), random_scenes.arrays(gpu)
    assert not random_scenes.trouble(cpu, gpu, here, there)
    assert gpu.stats.collisions == pytest.approx(cpu.stats.collisions, rel=flips)
    differ = {name: random_scenes.difference(here[name], there[name]) for name in here}
    print(
        f"collisions {gpu.stats.collisions / max(cpu.stats.collisions, 1) - 1:.1e}; worst", end=" "
    )
    print(*max(differ.items(), key=lambda item: item[1]))
    assert max(differ.values()) < flips, differ


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
    found = [random_scenes.compare(number) for number in range(25)]
    print(random_scenes.summary(found, 0.0))
    assert sum(bool(one.refused) for one in found) < 10
    assert random_scenes.well(found)


# ----------------------------------------------------------------------------- other random numbers

PAIRS = 100
KINDS = {
    "sun": {"light": SUN, "extinction": 2.0, "albedo": 0.95},
    "sky": {"light": mcrt.EnvironmentLight(1.0), "phase": HG(0.5), "interpolation": "nearest"},
}


@functools.cache
def pairs(kind):
    """Results of the CPU and of the GPU, of different seeds."""
    options = {"photons": 8000, "camera": camera(resolution=(6, 4))} | KINDS[kind]
    return [
        (run(**options, seed=2 * i, backend=CPU), run(**options, seed=2 * i + 1, backend=GPU))
        for i in range(PAIRS)
    ]


def z_scores(kind, name):
    """z (pairs, values) of voxels or pixels, and the degrees of freedom of one of its errors."""
    z, of = [], "pixel" if name == "image" else "voxel"
    for pair in pairs(kind):
        if name == "image":
            (a, b), (ea, eb) = ([r.image() for r in pair], [r.image_error() for r in pair])
        else:
            (a, b), (ea, eb) = ([getattr(r, name + part) for r in pair] for part in ("", "_error"))
        z.append(truth.z_scores(a, b, ea, eb, 0).ravel())
    z = np.array(z)
    return z[:, z.any(0)], truth.dof(pairs(kind)[0][0], of)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["fluence", "radiance", "image"])
def test_voxels_of_both_differ_by_students_t(name, kind):
    # Two errors of `dof` degrees of freedom, of equal size: 2 dof (Welch).
    z, dof = z_scores(kind, name)
    # Each voxel's z-scores are independent of each other: a Kolmogorov-Smirnov test for each.
    p = np.array([stats.kstest(column, stats.t(2 * dof).cdf).pvalue for column in z.T])
    print(f"smallest p {p.min():.2g} of {len(p)}, median {np.median(p):.2f}; var {z.var():.3f}")
    assert len(p) >= 18
    assert p.min() > truth.ALPHA / len(p)
    # Voxels of one pair share photons, pairs do not: mean z^2 is 2 dof / (2 dof - 2) on average.
    # 10 %: tallies of a few thousand photons are skew.
    sample, expected = (z**2).mean(1), dof / (dof - 1)
    bound = truth.limit(1, PAIRS - 1) * stats.sem(sample) + 0.1 * expected
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
    truth.assert_mean(difference / means.mean(), 0.0, what=name)
    assert stats.sem(difference) < 5e-3 * means.mean()


@pytest.mark.parametrize(
    "options", [{"phase": HG(0.6)}, {"light": [SUN, MAP], "albedo": (0.9, 0.6, 0.3)}]
)
def test_pixels_of_both_differ_by_a_normal_z(options):
    options = {"method": "path", "spp": 2000, "camera": camera(resolution=(48, 32))} | options
    a, b = (run(**options, seed=seed, backend=one) for seed, one in enumerate((CPU, GPU)))
    assert truth.dof(a, "pixel") > 100
    scores = truth.z_scores(a.image(), b.image(), a.image_error(), b.image_error(), 0)
    # Each pixel has its own paths; the channels of one share them.
    for z in np.moveaxis(scores.reshape(48 * 32, -1), -1, 0):
        z = z[z != 0]  # beside the volume there is nothing
        p = stats.kstest(z, "norm").pvalue
        print(f"{len(z)} pixels: p {p:.2g}, mean {z.mean():.3f}, std {z.std():.3f}")
        assert len(z) > 500
        assert p > truth.ALPHA
        chi_square = stats.chi2(len(z))
        assert chi_square.ppf(truth.ALPHA / 2) < (z**2).sum() < chi_square.isf(truth.ALPHA / 2)


# ------------------------------------------------------------------------------------ the same bits

REPEATED = {
    "photon": {
        "light": [LAMP, MAP],
        "photons": 50_000,
        "phase": HG(0.5),
        "albedo": (0.9, 0.6, 0.3),
    },
    "harmonics": {"photons": 20_000, "phase": HG(0.5), "angular": 2},
    "path": {"light": [LAMP, MAP], "spp": 200, "method": "path", "extinction": CHROMATIC},
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


def python(code, **environment):
    """What another process prints."""
    paths = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    clean = {k: v for k, v in os.environ.items() if k != "MCRT_BACKEND"}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=clean | {"PYTHONPATH": paths} | environment,
        capture_output=True,
        text=True,
        check=True,
    )


# --------------------------------------------------------------------------------------- a lost GPU

NOISE = (np.random.default_rng(1).random((12, 12, 12)) > 0.3).astype(np.float32)
# Where a target says how long a run takes, the first estimate of that stands for a tenth of it.
EARLY = {"photons": 0.2, "target": 0.03, "paths": 0.2, "path target": 0.03}
LONG = {
    "photons": {"photons": 6e5},
    "target": {"target_error": 0.012, "light": SUN},
    "paths": {"method": "path", "spp": 2500},
    "path target": {"method": "path", "target_error": 0.02},
}


def cloud(**options):
    eye = mcrt.PerspectiveCamera((30, -25, 20), (6, 6, 6), fov=28, resolution=(24, 24))
    base = {"spacing": 1.0, "origin": (0, 0, 0), "extinction": 0.6, "albedo": 0.97, "camera": eye}
    return run(NOISE, **base | options)


@functools.cache
def speed():
    """How many times as fast as two processors the GPU is, or 1."""
    cloud(photons=1e5)
    start = time.perf_counter()
    cloud(photons=1e5)
    return max(1, round(0.2 / (time.perf_counter() - start)))


def long_run(name, **options):
    """A run of one or two seconds."""
    given = dict(LONG[name])
    for effort, power in (("photons", 1), ("spp", 1), ("target_error", -0.5)):
        if effort in given:
            given[effort] *= speed() ** power
    return cloud(**given | options)


@functools.cache
def whole(name):
    return long_run(name)


class Loser:
    """A progress function that gives the device up once, when that much is done."""

    def __init__(self, fraction):
        self.fraction, self.lost = fraction, False

    def __call__(self, fraction, info):
        if fraction >= self.fraction and not self.lost:
            self.lost = True
            _mcrt.lose_device(GPU)


def lost(start):
    """The error of what `start` starts."""
    with pytest.raises(mcrt.DeviceLostError, match="lost") as caught:
        start()
    return caught.value


@pytest.mark.parametrize("name", LONG)
def test_a_lost_run_keeps_what_it_has_and_goes_on_to_the_same_bits(name):
    expected = bits(whole(name))
    error = lost(lambda: long_run(name, progress=Loser(EARLY[name])))
    partial = error.partial
    assert isinstance(partial, mcrt.Result)
    assert partial.stats.stopped_by == "device lost"
    assert 0 < partial.stats.photons < whole(name).stats.photons
    part, all_of_it = (random_scenes.arrays(result) for result in (partial, whole(name)))
    assert part.keys() == all_of_it.keys()
    for array in part:
        assert np.isfinite(part[array]).all(), array
    assert part["image_error"].any()
    ratio = part["image"].mean(dtype=float) / all_of_it["image"].mean(dtype=float)
    assert ratio == pytest.approx(1.0, abs=0.05)
    walks = []
    assert bits(error.resume(progress=lambda _, info: walks.append(info["photons"]))) == expected
    assert min(filter(None, walks)) > partial.stats.photons  # nothing is done twice
    assert bits(error.resume(progress=False)) == expected  # it may be asked again


@pytest.mark.parametrize("name", ["photons", "paths"])
def test_a_run_can_be_lost_twice(name):
    first = lost(lambda: long_run(name, progress=Loser(EARLY[name])))
    second = lost(lambda: first.resume(progress=Loser(0.6)))
    assert second.partial.stats.photons > first.partial.stats.photons
    assert bits(second.resume(progress=False)) == bits(whole(name))


@pytest.mark.parametrize("name", LONG)
def test_a_run_that_was_lost_at_once_starts_again(name):
    expected = bits(whole(name))
    _mcrt.lose_device(GPU)  # opened anew, it has to compile its kernels: that takes a while
    error = lost(lambda: long_run(name, progress=Loser(0.0)))
    assert error.partial is None
    assert bits(error.resume(progress=False)) == expected


@pytest.mark.parametrize("delay", [0.01, 0.05, 0.1, 0.2, 0.4, 0.8])
def test_a_loss_at_any_time_costs_nothing_but_time(delay):
    expected = bits(whole("photons"))
    timer = threading.Timer(delay, _mcrt.lose_device, [GPU])
    timer.start()
    cut_short = False
    try:
        result = long_run("photons")
    except mcrt.DeviceLostError as error:
        cut_short = True
        timer.join()
        result = error.resume(progress=False)
    timer.join()
    there, here = random_scenes.arrays(result), random_scenes.arrays(whole("photons"))
    assert all(random_scenes.difference(here[name], there[name]) < 1e-5 for name in here)
    if (
        cut_short
    ):  # else the CPU may have done what was left after the last photon: it rounds otherwise
        assert bits(result) == expected


def test_images_are_gathered_after_the_device_was_lost():
    other = mcrt.OrthographicCamera((40, 0, 0), (6, 6, 6), width=20, resolution=(9, 9))
    result, same = (cloud(photons=5e4) for _ in range(2))
    _mcrt.lose_device(GPU)
    np.testing.assert_array_equal(result.image(other), same.image(other))
    np.testing.assert_array_equal(result.image_error(other), same.image_error(other))


# ------------------------------------------------------------------------------------ to be stopped

ENDLESS = {
    "photons": {"photons": 1e12},
    "dense": {"photons": 1e12, "albedo": 1.0, "extinction": 300.0},
    "paths": {"method": "path", "spp": 1e9},
    "dense paths": {"method": "path", "spp": 1e9, "albedo": 1.0, "extinction": 300.0},
}


@pytest.mark.parametrize("name", ENDLESS)
def test_ctrl_c_interrupts_within_two_seconds(name):
    sent = []

    def interrupt():
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(1.0, interrupt)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            run(**ENDLESS[name])
    finally:
        timer.cancel()
    assert time.perf_counter() - sent[0] < 2.0
    again = {"method": "path", "spp": 9} if "paths" in name else {"photons": 2000}
    assert_same_fates(*(run(**again, backend=backend) for backend in (CPU, GPU)))


@pytest.mark.parametrize("name", ["photons", "paths"])
def test_a_time_limit_ends_a_run_with_a_result(name):
    seen = []
    start = time.perf_counter()
    result = run(**ENDLESS[name], time_limit=0.5, progress=lambda *report: seen.append(report))
    assert time.perf_counter() - start < 5.0
    assert result.stats.stopped_by == "time_limit"
    assert np.isfinite(result.image()).all()
    assert np.isfinite(result.image_error()).all()
    fractions = [fraction for fraction, _ in seen]
    assert len(seen) > 3
    assert fractions == sorted(fractions)
    assert all(0.0 <= fraction <= 1.0 for fraction in fractions)
    assert seen[-1][1]["photons"] > 0


@pytest.mark.parametrize("name", ["photons", "paths"])
def test_progress_can_stop_a_run(name):
    result = run(**ENDLESS[name], progress=lambda fraction, info: info["seconds"] < 0.3)
    assert result.stats.stopped_by == "progress"
    assert np.isfinite(result.image_error()).all()


# ------------------------------------------------------------------------------------ what there is

NO_DRIVER = {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="drivers are hidden by Vulkan's loader")
TRY = """
import mcrt, numpy as np
try:
    print(mcrt.simulate(np.ones((2, 2, 2)), photons=100, backend={!r}, progress=False).plan.backend)
except mcrt.NoAdapterError as error:
    print("NoAdapterError", error)
"""


@LINUX
def test_without_an_adapter_it_says_so_and_auto_takes_the_cpu():
    text = python(TRY.format("gpu"), **NO_DRIVER).stdout
    assert text.startswith("NoAdapterError no GPU adapter was found; install a driver")
    assert 'backend="cpu"' in text
    assert python(TRY.format("gpu:high"), **NO_DRIVER).stdout.startswith("NoAdapterError")
    assert python(TRY.format("auto"), **NO_DRIVER).stdout.strip() == "cpu"
    forced = python(TRY.format("auto"), **NO_DRIVER, MCRT_BACKEND="gpu")
    assert forced.stdout.startswith("NoAdapterError")


def test_an_unknown_name_is_answered_by_those_there_are(adapter):
    with pytest.raises(mcrt.NoAdapterError, match="no GPU adapter is named") as caught:
        run(backend="gpu:Voodoo 2", photons=100)
    assert "Voodoo 2" in str(caught.value)
    assert adapter["name"] in str(caught.value)


def test_a_part_of_the_name_is_enough(adapter):
    for wish in (adapter["name"].split()[0].upper(), "low", "high", ""):
        assert run(backend=f"gpu:{wish}", photons=100).plan.backend == GPU


@pytest.mark.parametrize(
    "value", ["tpu", "cpu:0", "GPU", "auto:high", " gpu", 3, None, b"gpu", ["gpu"]]
)
def test_a_backend_that_does_not_exist_is_an_error(value):
    with pytest.raises(mcrt.SceneError, match="backend"):
        run(backend=value, photons=100)


@LINUX
def test_the_gpu_is_left_alone_until_it_is_asked_for():
    report = """
import re
driver = re.compile(r"[^/]*(?:vulkan|lvp|nvidia|radeon|LLVM)[^/]*$")
def mapped():
    with open("/proc/self/maps") as maps:
        return sorted({found[0] for line in maps if (found := driver.search(line.strip()))})
"""
    first = "import mcrt, numpy as np\nprint('import', mapped())\n"
    use = "mcrt.simulate(np.ones((2, 2, 2)), photons=100, backend={!r}, progress=False).image()\n"
    tell = "print('run', mapped())"
    lines = python(report + first + use.format("cpu") + tell).stdout.splitlines()
    assert lines == ["import []", "run []"]
    assert "vulkan" in python(report + first + use.format("gpu") + tell).stdout.splitlines()[-1]


# ---------------------------------------------------------------------------------------- too large


@pytest.mark.parametrize("method", ["photon", "path", "single"])
def test_a_volume_beyond_the_extent_is_refused_before_anything_runs(adapter, method):
    most = adapter["extent"] - 2
    wide = np.zeros((1, 1, most + 1), np.float32)
    for call in (mcrt.simulate, mcrt.plan):
        with pytest.raises(mcrt.VolumeTooLargeError) as caught:
            call(wide, backend=GPU, method=method, progress=unexpected)
        text = str(caught.value)
        for part in (f"(1, 1, {most + 1})", adapter["name"], f"up to {most} ", 'backend="cpu"'):
            assert part in text
    assert mcrt.plan(wide, backend=CPU, method=method).backend == CPU
    options = {"photons": 50} if method == "photon" else {}
    run(wide[..., 1:], backend=GPU, method=method, **options)


def test_harmonics_beyond_what_the_adapter_binds_are_refused_before_anything_runs(adapter):
    most = min(adapter["binding"], adapter["buffer"]) // 16 * 16 // 4 * 4
    side = int(np.ceil(np.cbrt(min(most, 2**32) / 81)))
    for call in (mcrt.simulate, mcrt.plan):
        with pytest.raises(mcrt.VolumeTooLargeError) as caught:
            call(
                np.ones((side, side, side), np.float32),
                phase=HG(0.5),
                angular=8,
                errors=False,
                force=True,
                backend=GPU,
                progress=unexpected,
            )
        for part in ("tallies", str(min(most, 2**32 - 1)), adapter["name"], 'backend="cpu"'):
            assert part in str(caught.value)


def unexpected(fraction, info):
    raise AssertionError("it runs")
