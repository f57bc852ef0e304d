"""Photons in lanes: the same bits on every instruction set, and the answer of the scalar walk.

False alarms: 1e-5 per assertion (Bonferroni over voxels or pixels), about 40 assertions.
"""

import comparing
import mcrt
import numpy as np
import pytest
from path_cases import BEYOND, need

pytestmark = pytest.mark.cpu_only("lanes are the CPU's")

SHAPE = (9, 10, 11)
LIGHT = mcrt.PointLight((-6.0, -9.0, 16.0), 1e3)
VIEW = mcrt.PerspectiveCamera((30, -20, 12), (5.5, 5, 4.5), fov=26, resolution=(12, 10))


def random(seed=5):
    """Dense and empty voxels side by side."""
    rng = np.random.default_rng(seed)
    return (rng.random(SHAPE) * (rng.random(SHAPE) < 0.7)).astype(np.float32)


def sparse():
    """Voids, thin haze and a dense block: a majorant grid of several cells pays."""
    density = np.zeros((40, 36, 44), np.float32)
    density[20:, :20, 22:] = 0.02
    density[3:9, 4:9, 5:11] = 0.6
    density[30, 30, 30] = 40.0
    return density


def specks():
    """Single voxels in a void: half of the light that scatters in one does so beside it."""
    return (np.random.default_rng(8).random((24, 25, 26)) < 0.01).astype(np.float32)


SPARSE = {
    "volume": sparse(),
    "light": mcrt.PointLight((-40.0, -30.0, 60.0), 1e3),
    "camera": mcrt.PerspectiveCamera((130, -90, 50), (22, 18, 20), fov=26, resolution=(12, 10)),
}
SCENES = {
    "homogeneous": {"volume": np.ones(SHAPE, np.float32), "phase": mcrt.HenyeyGreenstein(0.6)},
    "thin": {"volume": np.full(SHAPE, 0.05, np.float32)},
    "linear": {"phase": mcrt.HenyeyGreenstein(-0.4), "max_scatterings": 4},
    "nearest": {"interpolation": "nearest", "phase": mcrt.Rayleigh()},
    "rgb": {"albedo": (0.95, 0.6, 0.2)},
    "albedo": {"albedo": random(6), "phase": mcrt.HenyeyGreenstein(0.3)},
    "beam": {"light": mcrt.PencilBeam((5.2, 4.1, -3), (0.1, 0.2, 1), 10.0)},
    "environment": {"light": mcrt.EnvironmentLight(2.0), "phase": mcrt.HenyeyGreenstein(0.5)},
    "inside": {"light": mcrt.PointLight((5.1, 5.3, 4.2), 10.0)},
    "table": {"phase": mcrt.TabulatedPhase([-1, 0, 0.8, 1], [1, 0.2, 1, 6])},
    "harmonics": {"phase": mcrt.HenyeyGreenstein(0.5), "angular": "sh"},
    "cells": SPARSE,
    "dark": {"volume": np.ones(SHAPE, np.float32), "albedo": 0.4, "extinction": 3.0},
    "specks": SPARSE | {"volume": specks(), "extinction": 4.0},
    "thin specks": SPARSE | {"volume": specks(), "extinction": 0.05},
}


def run(monkeypatch, simd, name, photons=10_000, seed=1, **options):
    monkeypatch.setenv("MCRT_SIMD", simd)
    scene = {
        "volume": random(),
        "spacing": (1.0, 0.9, 1.1),
        "extinction": 0.8,
        "light": LIGHT,
        "camera": VIEW,
        "method": "photon",
    }
    scene |= SCENES[name] | options
    return mcrt.simulate(scene.pop("volume"), photons=photons, seed=seed, **scene)


@pytest.mark.parametrize("simd", BEYOND)
@pytest.mark.parametrize("name", SCENES)
def test_every_instruction_set_gives_the_same_bits(name, simd, monkeypatch):
    need(simd)
    one, other = (run(monkeypatch, which, name, threads=1) for which in ("baseline", simd))
    for what in ("fluence", "radiance", "radiance_error"):
        np.testing.assert_array_equal(getattr(one, what), getattr(other, what))
    np.testing.assert_array_equal(one.image(), other.image())
    assert str(one.energy) == str(other.energy)


@pytest.mark.parametrize("name", SCENES)
def test_lanes_agree_with_the_scalar_walk(name, monkeypatch):
    a = run(monkeypatch, "scalar", name, 100_000, seed=2)
    b = run(monkeypatch, "", name, 200_000, seed=3)
    dof = min(comparing.dof(a), comparing.dof(b))
    for what in ("fluence", "radiance"):
        values = [getattr(x, what) for x in (a, b)]
        errors = [getattr(x, what + "_error") for x in (a, b)]
        comparing.assert_z(values[0], values[1], *errors, dof=dof, relative=1e-3, what=what)
    for share in ("absorbed", "unscattered", "missed"):
        p, q = (np.atleast_1d(getattr(x.energy, share)) for x in (a, b))
        errors = [comparing.fraction_error((p + q) / 2, x.stats["photons"]) for x in (a, b)]
        comparing.assert_z(p, q, *errors, relative=1e-4, what=share)
    for face, p in a.energy.escaped.items():
        p, q = np.atleast_1d(p), np.atleast_1d(b.energy.escaped[face])
        errors = [comparing.fraction_error((p + q) / 2, x.stats["photons"]) for x in (a, b)]
        comparing.assert_z(p, q, *errors, relative=1e-4, what=face)
    comparing.assert_balance(b.energy)


@pytest.mark.parametrize("name", ["nearest", "cells", "rgb", "specks", "thin specks"])
def test_images_alone_agree_too(name, monkeypatch):
    """Voids are not scored for images: what is near enough to some density is."""
    runs = [
        run(monkeypatch, simd, name, 100_000, seed, outputs=("image",), max_scatterings=3)
        for seed, simd in enumerate(("scalar", ""), 4)
    ]
    images, errors = [r.image() for r in runs], [r.image_error() for r in runs]
    comparing.assert_z(
        *images, *errors, dof=comparing.dof(runs[0], "pixel"), relative=2e-3, what=name
    )
    # The mean over the image, over independent pairs of runs.
    ratios = []
    for seed in range(10, 34):
        pair = [
            run(monkeypatch, simd, name, 40_000, seed + shift, outputs=("image",))
            for simd, shift in (("scalar", 0), ("", 100))
        ]
        ratios.append(pair[0].image(order="2+").sum() / pair[1].image(order="2+").sum())
    comparing.assert_mean(ratios, 1.0, what=name)


@pytest.mark.parametrize("name", ["dark", "rgb"])
def test_roulette_is_fair(name, monkeypatch):
    """Lost less won: its mean over independent runs is zero."""
    net = [run(monkeypatch, "", name, 25_000, seed).energy.roulette for seed in range(30, 54)]
    assert np.all(np.ptp(net, axis=0) > 0)
    for channel in np.reshape(net, (len(net), -1)).T:
        comparing.assert_mean(channel, 0.0, what=name)


def test_the_plan_says_how_photons_walk(monkeypatch):
    def walk(**options):
        return {d[0]: d[1] for d in mcrt.plan(random(), **options).decisions}["walk"]

    assert walk() == "in lanes"
    assert walk(tracker="march") == "one by one"
    assert walk(extinction=(1.0, 2.0, 3.0)) == "one by one"
    monkeypatch.setenv("MCRT_SIMD", "scalar")
    assert walk() == "one by one"
    monkeypatch.setenv("MCRT_SIMD", "mmx")
    with pytest.raises(mcrt.SceneError, match="MCRT_SIMD"):
        walk()
