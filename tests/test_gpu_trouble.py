"""The GPU against trouble: a lost device, Ctrl-C, no driver, too large a volume, many runs.

Nothing here depends on chance but how rounding falls on this adapter.
"""

import functools
import pickle
import sys
import threading
import time

import mcrt
import numpy as np
import pytest
import random_scenes
from conftest import interrupted, processor_seconds
from gpu_cases import CPU, GPU, SUN, assert_same_fates, bits, python, run
from mcrt import _mcrt

pytestmark = [
    pytest.mark.cpu_only("each test names its backends itself"),
    pytest.mark.usefixtures("adapter"),
]


# --------------------------------------------------------------------------------------- a lost GPU

NOISE = (np.random.default_rng(1).random((12, 12, 12)) > 0.3).astype(np.float32)
# Where a target says how long a run takes, the first estimate of that stands for a tenth of it.
EARLY = {"photons": 0.2, "target": 0.03, "paths": 0.2, "path target": 0.03}
LONG = {
    "photons": {"photons": 2.4e5},
    "target": {"target_error": 0.02, "light": SUN},
    "paths": {"method": "path", "spp": 1200},
    "path target": {"method": "path", "target_error": 0.035},
}


def cloud(**options):
    eye = mcrt.PerspectiveCamera((30, -25, 20), (6, 6, 6), fov=28, resolution=(16, 16))
    base = {"spacing": 1.0, "origin": (0, 0, 0), "extinction": 0.6, "albedo": 0.97, "camera": eye}
    return run(NOISE, **base | options)


@functools.cache
def speed():
    """1 where two processors play the GPU, or by how much longer a faster GPU's runs must be."""
    cloud(photons=1e5)
    start = time.perf_counter()
    cloud(photons=1e5)
    quick = 0.2 / (time.perf_counter() - start)
    return 1 if quick < 1.5 else round(2.5 * quick)  # so short a run is mostly overhead


def long_run(name, **options):
    """A run of half a second or more: of about ten dispatches."""
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
        self.break_it = lambda: _mcrt.lose_device(GPU)

    def __call__(self, fraction, info):
        if fraction >= self.fraction and not self.lost:
            self.lost = True
            self.break_it()


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
    # 5 %: the least that is kept are 32 rays for each pixel, with an error of the mean of 1.2 %.
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


@pytest.mark.parametrize("delay", [0.01, 0.05, 0.2, 0.4, 0.8])
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
    # Otherwise the CPU may have done what was left after the last photon: it rounds differently.
    if cut_short:
        assert bits(result) == expected


FAILURES = {
    "no memory": mcrt.VolumeTooLargeError,
    "a call that is not valid": mcrt.McrtError,
    "a bad argument": mcrt.SceneError,
}


def failed(start, kind):
    with pytest.raises(mcrt.McrtError) as caught:
        start()
    assert type(caught.value) is FAILURES[kind]
    return caught.value


class Breaker(Loser):
    """A progress function that makes the device fail once, when that much is done."""

    def __init__(self, fraction, kind):
        super().__init__(fraction)
        self.break_it = lambda: _mcrt.fail_device(GPU, kind == "no memory")


# Each way to end a run, and each failure twice: what is kept does not depend on what failed.
@pytest.mark.parametrize(("name", "kind"), [*zip(LONG, 2 * list(FAILURES)[:2], strict=True)])
def test_a_run_whose_device_fails_keeps_what_it_has_and_goes_on_to_the_same_bits(name, kind):
    expected = bits(whole(name))
    error = failed(lambda: long_run(name, progress=Breaker(EARLY[name], kind)), kind)
    assert error.partial.stats.stopped_by == "error"
    assert 0 < error.partial.stats.photons < whole(name).stats.photons
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy)) == (type(error), str(error))
    assert bits(copy.partial) == bits(error.partial)
    walks = []
    assert bits(error.resume(progress=lambda _, info: walks.append(info["photons"]))) == expected
    assert min(filter(None, walks)) > error.partial.stats.photons  # nothing is done twice


def test_an_error_without_a_run_has_nothing_to_go_on_with():
    error = failed(lambda: run(extinction=-1), "a bad argument")
    assert error.partial is None
    with pytest.raises(mcrt.McrtError, match="no run to go on with"):
        error.resume()


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
    assert interrupted(lambda: run(**ENDLESS[name]), after=1.0) < 2.0
    again = {"method": "path", "spp": 9} if "paths" in name else {"photons": 2000}
    assert_same_fates(*(run(**again, backend=backend) for backend in (CPU, GPU)))


@pytest.mark.parametrize("name", ["photons", "paths"])
def test_a_time_limit_ends_a_run_with_a_result(name):
    seen = []
    start = processor_seconds()
    result = run(**ENDLESS[name], time_limit=0.5, progress=lambda *report: seen.append(report))
    assert processor_seconds() - start < 5.0  # 1 if kernels are compiled first
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
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux's loader and /proc")
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
                phase=mcrt.HenyeyGreenstein(0.5),
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


# ---------------------------------------------------------------------------------------- many runs


def resident():
    """Megabytes of memory that the process holds."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


MANY = {
    "photons": {"photons": 2000},
    "harmonics": {"photons": 2000, "phase": mcrt.HenyeyGreenstein(0.5), "angular": "sh"},
    "paths": {"method": "path", "spp": 9},
    "single": {"method": "single"},
}


@LINUX
@pytest.mark.parametrize("name", MANY)
def test_memory_stays_what_it_was_over_many_runs(name):
    # Mesa leaves what it compiles behind: 14 MB if all that photons need is compiled anew, of the
    # order of one for a kernel. Less than 0.1 is what allocators do.
    for _ in range(3):
        run(**MANY[name]).image()
    before = resident()
    for _ in range(10):
        run(**MANY[name]).image()
    per_run = (resident() - before) / 10
    print(f"{per_run:.2f} MB a run")
    assert per_run < 0.4
