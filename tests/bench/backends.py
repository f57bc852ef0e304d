"""Both backends in one table: the CPU in lanes and one by one, and the adapter of `backend="gpu"`.

Rates are photons (paths) over the seconds of their stage, compilation left out by a run before.
"""

import functools
import os
from unittest.mock import patch

import cloud
import cube60
import mcrt
from table import heading, number, row, stages, timed

SIDES = {
    "CPU, lanes": {"backend": "cpu"},
    "CPU, one by one": {"backend": "cpu", "simd": "scalar"},
    "GPU": {"backend": "gpu"},
}
REPEATS = 3


def simulate(volume=None, simd=None, **options):
    with patch.dict(os.environ, {"MCRT_SIMD": simd} if simd else {}):
        return mcrt.simulate(volume, **options)


def head(**options):
    """A homogeneous ball of tissue that paths see, HG .8."""
    medium = mcrt.Medium.sphere(1.0, extinction=5.0, albedo=0.95, phase=mcrt.HenyeyGreenstein(0.8))
    view = mcrt.PerspectiveCamera((5, 0, 0), (0, 0, 0), fov=25, resolution=(128, 128))
    light = mcrt.DirectionalLight((-1, 0.4, -0.3), 1.0)
    arguments = {"volume": medium, "light": light, "camera": view, "method": "path"}
    return arguments | {"progress": False} | options


def foggy(**options):
    """The cloud as `cloud.py` has it."""
    return {"volume": cloud.volume()} | cloud.scene(cloud.camera(64), **options)


CASES = {
    "cube60": (functools.partial(cube60.scene, seed=1), "photons", 1e6),
    "cloud 128^3, 5 orders": (functools.partial(foggy, seed=1), "photons", 1e6),
    "ball, HG .8, paths": (functools.partial(head, seed=1), "paths", 32),
}


def rate(make, stage, amount, side):
    """Photons or paths per second of the stage, the best of some runs."""
    given = {"photons" if stage == "photons" else "spp": amount}
    small = {name: value // 10 for name, value in given.items()}
    simulate(**make(**small, **side))
    best = 0.0
    for _ in range(REPEATS):
        result = simulate(**make(**given, **side))
        best = max(best, result.stats.photons / stages(result)[stage])
    return best, result


def run(large=False):
    try:
        adapter = mcrt.plan(**cube60.scene(photons=10, backend="gpu")).decisions[0]
    except mcrt.NoAdapterError as error:
        row("GPU", "MISSING", "", f"NOT COMPARED: {error}")
        return
    heading(f"both backends ({adapter[1]})")
    for name, (make, stage, amount) in CASES.items():
        found = {side: rate(make, stage, amount, options) for side, options in SIDES.items()}
        for side, (value, _) in found.items():
            row(f"{name}: {side}", number(value / 1e6), f"M {stage}/s")
        ratio = found["GPU"][0] / found["CPU, one by one"][0]
        row("  GPU over CPU, one by one", number(ratio), "x")
    view = cloud.camera(600)
    for side, options in SIDES.items():
        if "simd" not in options:
            result = simulate(**foggy(photons=1e5, **options))
            result.image(cloud.camera(64, 20.01))
            row(f"gather 600 x 600: {side}", f"{timed(result.image, view)[1]:.3f}", "s")
