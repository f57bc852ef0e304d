"""What each special case of the code gains: the same scene once with it, once without.

Seconds are those of the whole call, the shortest of 3, the two taken in turn.
"""

import os
from unittest.mock import patch

import cube60
import mcrt
import numpy as np
from table import heading, number, row, timed

SIDE = 64
PHOTONS = 1e6
INSTRUCTION_SETS = ("scalar", "baseline", "avx2", "avx512")


def scene(volume, depth=6.0, **options):
    """A volume of the optical depth, lit by a point, of which an image is asked for."""
    arguments = {
        "volume": volume,
        "extinction": depth / SIDE,
        "light": mcrt.PointLight((100, -75, 150), 1e5),
        "camera": mcrt.PerspectiveCamera(
            (200, -150, 75), (32, 32, 32), fov=20, resolution=(64, 64)
        ),
        "method": "photon",
        "photons": PHOTONS,
        "outputs": ("image",),
        "progress": False,
    }
    return arguments | options


def unequal(finer):
    """The same box, whatever voxels it is cut into, of which the fluence is asked for."""
    return {
        "volume": np.ones((16 * finer, 24 * finer, 20 * finer), np.float32),
        "spacing": 1.0 / finer,
        "extinction": (0.3, 0.4, 0.5),
        "light": mcrt.EnvironmentLight(1.0),
        "method": "photon",
        "photons": 20 * PHOTONS,
        "outputs": ("fluence",),
        "progress": False,
    }


def pair(name, special, general):
    """A row: how many times longer the general case takes."""
    runs = [[timed(mcrt.simulate, **case)[1] for case in (special, general)] for _ in range(3)]
    short, long = np.min(runs, axis=0)
    row(name, f"{long / short:.2f}", "x", f"{short:.3f} s against {long:.3f} s")


def run(large=False):
    heading("special cases: time without over time with")
    box, cloud = np.ones((SIDE,) * 3, np.float32), mcrt.datasets.cloud(SIDE)
    pair(
        "homogeneous: analytic flights, against Woodcock's",
        scene(box, tracker="analytic"),
        scene(box, tracker="woodcock"),
    )
    chosen = mcrt.plan(**scene(cloud)).tracker
    other = "march" if chosen == "woodcock" else "woodcock"
    pair(
        f"cloud: {chosen} (auto's), against {other}",
        scene(cloud, photons=2e5),
        scene(cloud, photons=2e5, tracker=other),
    )
    pair(
        "isotropic, against HenyeyGreenstein(1e-9)",
        scene(cloud),
        scene(cloud, phase=mcrt.HenyeyGreenstein(1e-9)),
    )
    pair("grey, against RGB of equal albedo", scene(cloud), scene(cloud, albedo=(0.9, 0.9, 0.9)))
    nearly = tuple(6.0 / SIDE * np.array([1.0, 1.0001, 0.9999]))
    pair(
        "RGB of equal extinction, against almost equal",
        scene(cloud, albedo=(0.9, 0.9, 0.9)),
        scene(cloud, albedo=(0.9, 0.9, 0.9), extinction=nearly),
    )
    pair(
        "homogeneous RGB of unequal extinction, against 4 times as many voxels an axis (up to 1.5)",
        unequal(1),
        unequal(4),
    )
    pair("nearest, against linear", scene(cloud, interpolation="nearest"), scene(cloud))
    outputs = ("fluence", "radiance", "image")
    pair("image alone, against all outputs", scene(cloud), scene(cloud, outputs=outputs))
    pair("without errors, against with", scene(cloud, errors=False), scene(cloud))
    pair(
        "order 1 without photons, against order 2 with",
        scene(cloud, max_scatterings=1),
        scene(cloud, max_scatterings=2),
    )
    pair("no scattering, against hardly any", scene(cloud, albedo=0.0), scene(cloud, albedo=1e-4))
    thin = {"photons": None, "target_error": 0.02, "depth": 0.005}
    method = mcrt.plan(**scene(cloud, **thin, method="auto")).method
    pair(
        f"thin cloud to 2 %: {method} (auto's), against photon",
        scene(cloud, **thin, method="auto"),
        scene(cloud, **thin),
    )
    heading(f"instruction sets: photons alone (unset: {mcrt._mcrt.info()['simd']})")
    lanes("cube60", cube60.scene(photons=PHOTONS))
    lanes(f"cloud {SIDE}^3", scene(cloud, errors=False))


def lanes(name, case):
    """A row for each instruction set of this processor."""
    rates = {}
    for simd in INSTRUCTION_SETS:
        try:
            with patch.dict(os.environ, {"MCRT_SIMD": simd}):
                rates[simd] = max(rate(mcrt.simulate(**case)) for _ in range(2))
        except mcrt.McrtError as error:
            row(f"{name}, {simd}", "-", "", str(error))
            continue
        note = f"{rates[simd] / rates['scalar']:.2f} x scalar"
        row(f"{name}, {simd}", number(rates[simd] / 1e6), "M photons/s", note)


def rate(result):
    return result.stats.photons / result.stats.seconds["photons"]
