"""Shared set-up: the backends, libraries that need an environment, small runs that many tests read.

Every test runs on the CPU and on the GPU, which any adapter will do for, also one that a processor
plays. The mark `cpu_only` says why one does not. A processor that plays the GPU runs `sentinels`
alone; a real GPU runs all, and so does any adapter if MCRT_ALL_ON_GPU is set, as `make validate`
does.
"""

import functools
import glob
import os
import signal
import threading
import time

import numpy as np
import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
_LLVM = sorted(glob.glob("/usr/lib/*/libLLVM*19*") + glob.glob("/usr/lib/llvm-19/lib/libLLVM*.so*"))
if _LLVM:  # Dr.Jit aborts with LLVM 15 and 16, which it may find first
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", _LLVM[0])

import mcrt  # noqa: E402
from sentinels import SENTINELS  # noqa: E402

SHAPE, SPACING, ORIGIN = (4, 5, 6), (1.5, 1.0, 0.5), (10.0, -20.0, 30.0)
EYE = (25.0, -5.0, 40.0)
CENTRE = (11.5, -17.5, 33.0)


def density(seed=0):
    """A small heterogeneous volume of three unequal extents, with empty voxels."""
    values = np.random.default_rng(seed).random(SHAPE, dtype=np.float32)
    values[values < 0.2] = 0.0
    return values


def gappy(shape, seed):
    """Random voxels of mean 0.7, three in ten of them void."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < 0.3, 0, rng.gamma(1.0, 1.0, shape)).astype(np.float32)


def camera(eye=EYE, resolution=(14, 10)):
    return mcrt.PerspectiveCamera(eye, CENTRE, fov=25.0, resolution=resolution)


def run(volume=None, **arguments):
    """`simulate` on the small volume, with few photons."""
    defaults = {
        "spacing": SPACING,
        "origin": ORIGIN,
        "extinction": 0.8,
        "light": mcrt.PointLight((30.0, -40.0, 50.0), 1e3),
        "camera": camera(),
        "photons": 4000,
        "max_scatterings": 5,
        "method": "photon",
        "progress": False,
    }
    return mcrt.simulate(density() if volume is None else volume, **(defaults | arguments))


@pytest.fixture(scope="session")
def grey(backend):
    return run()


@pytest.fixture(scope="session")
def rgb(backend):
    return run(albedo=(0.9, 0.6, 0.3))


def processor_seconds():
    """What this process has taken of each processor: a load beside it lengthens no difference."""
    return time.process_time() / mcrt._mcrt.info()["threads"]


def interrupted(start, after):
    """`processor_seconds` from Ctrl-C, pressed so many seconds `after` the start, to its exception.

    What does not hear it at all runs into the suite's timeout.
    """
    sent = []

    def press():
        sent[:] = processor_seconds(), time.perf_counter()
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, press)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            start()
    finally:
        timer.cancel()
    # A GPU's work is none of the processor's; it hears between dispatches, of a tenth of a second.
    assert time.perf_counter() - sent[1] < 20.0
    return processor_seconds() - sent[0]


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_is_heard():
    """Also where the parent ignores it, as a shell does for what it runs in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


# ---------------------------------------------------------------------------------------- backends

NO_ADAPTER = "no GPU adapter was found; mesa-vulkan-drivers holds one that any processor plays"


def require(there, otherwise):
    """Skips the test if something is not there, or fails it if MCRT_REQUIRE_GPU is set."""
    if not there:
        (pytest.fail if os.environ.get("MCRT_REQUIRE_GPU") else pytest.skip)(otherwise)


@pytest.fixture(scope="session")
def adapter():
    """What backend="gpu" takes."""
    found = mcrt._mcrt.info()["adapters"]
    require(found, NO_ADAPTER)
    return found[0]


@pytest.fixture(scope="session", params=["cpu", "gpu"], autouse=True)
def backend(request):
    """What "auto" means meanwhile."""
    if request.param == "gpu":
        request.getfixturevalue("adapter")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MCRT_BACKEND", request.param)
        yield request.param


def is_gpu(item):
    return hasattr(item, "callspec") and item.callspec.params.get("backend") == "gpu"


def no_sentinels(items):
    """Those that `sentinels` does not name, and of a test whose cases it does not name those that
    hold no value of a parameter that is new."""
    known = {}
    for item in items:
        test = f"{item.path.name}::{item.originalname}"
        if f"{item.path.name}::{item.name.replace('[gpu-', '[')}" in SENTINELS:
            continue
        values = {(name, id(value)) for name, value in item.callspec.params.items()}
        if test not in SENTINELS or values <= known.setdefault(test, set()):
            yield item
        else:
            known[test] |= values


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """The GPU's tests last, without those of the CPU alone; of a test's cases some."""
    on_gpu = [item for item in items if is_gpu(item)]
    left_out = {item for item in on_gpu if item.get_closest_marker("cpu_only")}
    adapters = mcrt._mcrt.info()["adapters"]
    played = not adapters or adapters[0]["kind"] == "software"
    if played and not os.environ.get("MCRT_ALL_ON_GPU"):
        left_out |= {*no_sentinels([item for item in on_gpu if item not in left_out])}
    config.hook.pytest_deselected(items=[item for item in items if item in left_out])
    items[:] = sorted((item for item in items if item not in left_out), key=is_gpu)


def pytest_terminal_summary(terminalreporter):
    skipped = [r for r in terminalreporter.getreports("skipped") if NO_ADAPTER in str(r.longrepr)]
    if skipped:
        text = f"{len(skipped)} TESTS OF THE GPU WERE SKIPPED: {NO_ADAPTER}"
        terminalreporter.write_line(text, red=True, bold=True)


def cached(function):
    """`functools.cache`, by backend."""

    @functools.cache
    def found(backend, *arguments, **named):
        return function(*arguments, **named)

    @functools.wraps(function)
    def call(*arguments, **named):
        return found(os.environ["MCRT_BACKEND"], *arguments, **named)

    return call
