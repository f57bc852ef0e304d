"""Trackers against each other, against exact free-path distributions, and under the symmetries of
the equation.

False alarms: 1e-5 per assertion (Bonferroni over voxels), about 60 assertions.
"""

import itertools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached
from scipy import special, stats

SHAPE, SPACING = (5, 6, 7), (1.0, 0.5, 0.7)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # 4.9, 3, 5
LIGHT = (-2.0, 7.0, 9.0)
VIEW = truth.View((12, -6, 3), (2.4, 1.5, 2.6), (8, 6), fov=20)


def cloud(kind="random"):
    rng = np.random.default_rng(61)
    density = np.where(rng.random(SHAPE) < 0.3, 0, rng.gamma(1.0, 1.0, SHAPE))
    if (
        kind == "spike"
    ):  # a voxel of optical depth 1e4: majorant / mean as high as one voxel can make it
        density = np.full(SHAPE, 0.02)
        density[2, 3, 3] = 1e4
    if kind == "smooth":
        z, y, x = (np.linspace(-1, 1, n) for n in SHAPE)
        density = (
            1.5 + np.cos(3 * x + 1) * np.cos(2 * y)[:, None] * np.sin(2 * z + 1)[:, None, None]
        )
    return density.astype(np.float32)


def run(density, photons=2e5, **options):
    scene = {
        "spacing": SPACING,
        "extinction": 1.0,
        "albedo": 0.9,
        "phase": mcrt.HenyeyGreenstein(0.5),
    }
    scene |= {
        "light": mcrt.PointLight(LIGHT, 100.0),
        "interpolation": "nearest",
        "method": "photon",
    }
    return mcrt.simulate(density, photons=photons, **scene | options)


def welch(errors, dofs):
    """The least degrees of freedom of a difference's errors, by Welch and Satterthwaite."""
    squares = [np.asarray(error, float) ** 2 for error in errors]
    known = sum(squares) > 0
    one, two = (square[known] for square in squares)
    if not known.any():
        return min(dofs)
    return ((one + two) ** 2 / (one**2 / dofs[0] + two**2 / dofs[1])).min()


def assert_same(a, b, what=("fluence",), flip=lambda x: x, relative=1e-4):
    """Two independent runs agree, voxel by voxel and in their energies."""
    each = comparing.dof(a), comparing.dof(b)
    for name in what:
        value, error = getattr(a, name), getattr(a, name + "_error")
        other, other_error = flip(getattr(b, name)), flip(getattr(b, name + "_error"))
        dof = welch((error, other_error), each)
        comparing.assert_z(value, other, error, other_error, dof=dof, relative=relative, what=name)
    for name in ("unscattered", "absorbed"):
        p, q = (np.asarray(r.energy[name], float) for r in (a, b))
        errors = [np.asarray(r.energy[name + "_error"], float) for r in (a, b)]
        dof = welch(errors, (7, 7))  # of 8 lattices of rays at least
        comparing.assert_z(p, q, *errors, dof=dof, relative=relative, what=name)
    assert np.all(a.energy.truncated == 0)
    assert np.all(b.energy.truncated == 0)
    # From seed to seed it scatters by 2e-5: photons are stratified over a cone about the box.
    np.testing.assert_allclose(a.energy.missed, b.energy.missed, rtol=0, atol=1.5e-4)


@cached
def reference(kind, interpolation, extinction):
    tracker = "woodcock"
    return run(
        cloud(kind),
        4e5,
        interpolation=interpolation,
        extinction=extinction,
        tracker=tracker,
        seed=62,
    )


@pytest.mark.parametrize(
    ("kind", "interpolation", "extinction", "relative"),
    [
        ("random", "nearest", 2.0, 1e-4),
        ("random", "nearest", (0.5, 2.0, 5.0), 1e-4),
        ("smooth", "linear", 2.0, 1e-3),  # march is exact for constant voxels only
        ("spike", "nearest", 1.0, 1e-4),
    ],
    ids=["grey", "chromatic", "linear", "spike"],
)
def test_march_and_woodcock_agree(kind, interpolation, extinction, relative):
    a = reference(kind, interpolation, extinction)
    b = run(
        cloud(kind),
        4e5,
        interpolation=interpolation,
        extinction=extinction,
        tracker="march",
        seed=63,
    )
    assert (a.plan.tracker, b.plan.tracker) == ("woodcock", "march")
    assert_same(a, b, ("fluence", "radiance"), relative=relative)
    # The spike is one voxel among 210, whichever way it is crossed.
    assert np.median(np.asarray(a.fluence_error) / a.fluence) < 0.04


def test_analytic_agrees_with_both_in_a_homogeneous_medium():
    runs = [
        run(np.ones(SHAPE, np.float32), 4e5, tracker=t, seed=s)
        for s, t in enumerate(("analytic", "woodcock", "march"))
    ]
    for a, b in itertools.combinations(runs, 2):
        assert_same(a, b, ("fluence", "radiance"))


def test_chromatic_channels_are_those_of_three_grey_runs():
    extinction = (0.5, 2.0, 5.0)
    rgb = reference("random", "nearest", extinction)
    for c, sigma in enumerate(extinction):
        grey = run(cloud(), 2e5, extinction=sigma, seed=64 + c)
        errors = rgb.fluence_error[..., c], grey.fluence_error
        dof = welch(errors, (comparing.dof(rgb), comparing.dof(grey)))
        comparing.assert_z(rgb.fluence[..., c], grey.fluence, *errors, dof=dof)


# ---- free paths: with all scattering forward, at most n scatterings leave exp(-tau) sum_{k <= n}
# tau^k / k!

FORWARD = 1 - 1e-6  # HG g: one photon in a million turns away by a radian


def at_most(n):
    return lambda tau: stats.poisson.cdf(n, tau)


@pytest.mark.parametrize("n", [0, 1, 5])
@pytest.mark.parametrize("tracker", ["woodcock", "march"])
def test_collisions_in_layers_are_poisson_distributed(tracker, n):
    # 16 layers from void to tau 3; total 12.
    rng = np.random.default_rng(65)
    layers = np.where(rng.random(16) < 0.25, 0, rng.gamma(1.0, 1.0, 16))
    layers *= 12 / layers.sum()
    density = layers.reshape(16, 1, 1).astype(np.float32)
    photons = 3e5
    result = run(
        density,
        photons,
        spacing=(1.0, 1e4, 1e4),
        light=mcrt.PencilBeam((5e3, 5e3, -1), (0, 0, 1), 1e8),
        phase=mcrt.HenyeyGreenstein(FORWARD),
        albedo=1.0,
        max_scatterings=n,
        tracker=tracker,
        outputs=["fluence"],
        seed=66,
    )
    true = 1e8 * truth.ray_fluence(
        density.astype(float), (1.0, 1e4, 1e4), (5e3, 5e3, -1), (0, 0, 1), at_most(n), nodes=40
    )
    reached = true * photons > 1e3
    comparing.assert_z(
        result.fluence[reached],
        true[reached],
        result.fluence_error[reached],
        dof=comparing.dof(result),
    )
    # 1e3 photons scatter by 3 %.
    assert np.all(result.fluence[~reached] < 1.2 * 1e3 / photons)
    through = stats.poisson.cdf(n, 12)
    comparing.assert_z(
        result.energy.truncated,
        1 - through,
        comparing.fraction_error(through, photons),
        relative=1e-5,
    )
    # 1.8 photons on average: 10 more in less than one of a million runs.
    assert result.energy.unscattered == pytest.approx(np.exp(-12), abs=10 / photons)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize(
    "tracker",
    [
        "woodcock",
        pytest.param("woodcock one by one", marks=pytest.mark.cpu_only("lanes are the CPU's")),
        "march",
    ],
)
def test_collisions_along_a_skew_line_are_poisson_distributed(tracker, interpolation, monkeypatch):
    tracker, *one_by_one = tracker.split(maxsplit=1)
    if one_by_one:
        monkeypatch.setenv("MCRT_SIMD", "scalar")
    linear = interpolation == "linear"
    density = cloud("smooth" if linear and tracker == "march" else "random")
    start, direction = (-1.0, 0.35, 0.45), (1.0, 0.37, 0.63)
    photons = 3e5
    result = run(
        density,
        photons,
        extinction=0.8,
        interpolation=interpolation,
        light=mcrt.PencilBeam(start, direction, 1.0),
        phase=mcrt.HenyeyGreenstein(FORWARD),
        albedo=1.0,
        max_scatterings=2,
        tracker=tracker,
        outputs=["fluence"],
        seed=67,
    )
    true = truth.ray_fluence(
        0.8 * density.astype(float), SPACING, start, direction, at_most(2), linear
    )
    long = true > 0.05 * true.max()  # the beam's voxels but for clipped corners
    # March is exact where voxels are constant: here within .1 %, measured over seeds.
    relative = 1e-3 if linear and tracker == "march" else 1e-4
    comparing.assert_z(
        result.fluence[long],
        true[long],
        result.fluence_error[long],
        dof=comparing.dof(result),
        relative=relative,
    )
    assert result.fluence[true == 0].sum(dtype=float) < 1e-4 * true.sum()


def test_light_is_followed_to_optical_depth_25():
    # f32 uniforms of 24 bits never give a free path above 16.6; a diffuse field needs the deep ones
    # in proportion.
    density = np.ones((25, 1, 1), np.float32)
    photons = 4e6
    result = run(
        density,
        photons,
        spacing=(1.0, 1e4, 1e4),
        light=mcrt.PencilBeam((5e3, 5e3, -1), (0, 0, 1), 1e8),
        phase=mcrt.Isotropic(),
        albedo=0.001,
        outputs=["fluence"],
        errors=False,
        seed=68,
    )
    tau = np.arange(25)
    true = np.exp(-tau) * -np.expm1(-1)
    fluence = np.asarray(result.fluence, float)[:, 0, 0]
    # 0.2 %: scattered light of albedo 0.001. One photon in a layer is 1 / N of the fluence.
    allowed = comparing.limit(25) * np.sqrt(true / photons) + 0.002 * true + 10 / photons
    assert np.all(np.abs(fluence - true) < allowed)


@pytest.mark.parametrize("tracker", ["woodcock", "march", "analytic"])
def test_diffuse_light_through_a_thick_slab_is_the_third_exponential_integral(tracker):
    # An environment's light enters by Lambert's law: unscattered transmission 2 E3(tau).
    tau, photons = 3.0, 5e5
    result = run(
        np.ones((6, 1, 1), np.float32),
        photons,
        spacing=(0.5, 1e4, 1e4),
        light=mcrt.EnvironmentLight(1.0),
        albedo=0.5,
        outputs=["fluence"],
        errors=False,
        tracker=tracker,
        seed=69,
    )
    true = 2 * special.expn(3, tau)
    # 3e-4 of the light enters by the rim, and is lost.
    comparing.assert_z(
        result.energy.unscattered,
        true,
        np.hypot(comparing.fraction_error(true, photons), 3e-4 * true),
    )


# ---- symmetries


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_scaling_lengths_by_a_power_of_two_changes_no_photon(interpolation):
    density, k = cloud(), 4.0
    base = run(density, interpolation=interpolation, seed=70, camera=VIEW.camera())
    view = truth.View(
        tuple(np.divide(VIEW.origin, k)),
        tuple(np.divide(VIEW.target, k)),
        VIEW.resolution,
        fov=VIEW.fov,
    )
    small = run(
        density,
        interpolation=interpolation,
        seed=70,
        extinction=k,
        spacing=tuple(np.divide(SPACING, k)),
        light=mcrt.PointLight(tuple(np.divide(LIGHT, k)), 100.0 / k**2),
        camera=view.camera(),
    )
    np.testing.assert_allclose(small.fluence, base.fluence, rtol=1e-6)
    np.testing.assert_allclose(
        small.image(), base.image(), rtol=1e-6, atol=1e-7 * base.image().max()
    )
    assert small.energy.absorbed == pytest.approx(base.energy.absorbed, rel=1e-6)


def test_scaling_lengths_by_any_factor_leaves_the_physics():
    density, k = cloud(), 3.7
    large = run(
        density,
        extinction=1 / k,
        spacing=tuple(np.multiply(SPACING, k)),
        light=mcrt.PointLight(tuple(np.multiply(LIGHT, k)), 100.0 * k**2),
        seed=71,
    )
    assert_same(run(density, seed=72), large)


@cached
def upright(interpolation):
    return run(cloud(), 3e5, interpolation=interpolation, camera=VIEW.camera(), seed=73)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("axes", [(1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 2, 1)], ids=str)
def test_permuting_the_axes_permutes_the_answer(axes, interpolation):
    def turn(point):
        return tuple(np.asarray(point)[::-1][list(axes)][::-1])

    base = upright(interpolation)
    view = truth.View(
        turn(VIEW.origin), turn(VIEW.target), VIEW.resolution, fov=VIEW.fov, up=turn(VIEW.up)
    )
    turned = run(
        np.transpose(cloud(), axes),
        3e5,
        interpolation=interpolation,
        spacing=tuple(SPACING[a] for a in axes),
        light=mcrt.PointLight(turn(LIGHT), 100.0),
        camera=view.camera(),
        seed=74,
    )
    assert_same(turned, base, ("fluence", "radiance"), flip=lambda field: np.transpose(field, axes))
    mirrored = np.linalg.det(np.eye(3)[list(axes)]) < 0
    image, error = (a[:, ::-1] if mirrored else a for a in (base.image(), base.image_error()))
    dof = min(comparing.dof(base, "pixel"), comparing.dof(turned, "pixel"))
    comparing.assert_z(turned.image(), image, turned.image_error(), error, dof=dof, what="image")
    faces = [face for face in base.energy.escaped if face[0] == "-"]
    for face in faces:
        axis = "zyx".index(face[1])
        moved = "zyx"[axes.index(axis)]
        for sign in "-+":
            p, q = base.energy.escaped[sign + face[1]], turned.energy.escaped[sign + moved]
            error = comparing.fraction_error(p, 3e5)
            comparing.assert_z(q, p, error, error, what=f"escaped {sign}{face[1]}")


def test_origin_far_away_loses_nothing():
    shift = np.array([5e6, -3e6, 7e6])
    here = run(cloud(), 5e4, camera=VIEW.camera(), seed=75)
    there = run(
        cloud(),
        5e4,
        origin=tuple(shift),
        light=mcrt.PointLight(tuple(shift + LIGHT), 100.0),
        camera=truth.View(
            tuple(shift + VIEW.origin), tuple(shift + VIEW.target), VIEW.resolution, fov=VIEW.fov
        ).camera(),
        seed=75,
    )
    np.testing.assert_allclose(there.fluence, here.fluence, rtol=1e-6)
    np.testing.assert_allclose(
        there.image(), here.image(), rtol=1e-6, atol=1e-7 * here.image().max()
    )


def test_thin_chromatic_voxels_agree_with_each_channel_alone():
    """Of 24 seeds, so that the spread of z-scores is seen too."""
    extinction, shape = (0.1, 0.3, 0.5), (10, 12, 14)
    box = {
        "density": np.ones(shape, np.float32),
        "spacing": 0.2,
        "light": mcrt.EnvironmentLight(1.0),
    }
    runs = [
        run(**box, photons=4e4, extinction=extinction, seed=seed, outputs=("fluence",))
        for seed in range(24)
    ]
    assert runs[0].plan.tracker == "woodcock"
    dof = comparing.dof(runs[0])
    for c, sigma in enumerate(extinction):
        grey = run(**box, photons=1e6, extinction=sigma, seed=99, outputs=("fluence",))
        z = np.array(
            [
                comparing.z_scores(
                    one.fluence[..., c],
                    grey.fluence,
                    one.fluence_error[..., c],
                    grey.fluence_error,
                    0,
                )
                for one in runs
            ]
        )
        sample = (z**2).mean((1, 2, 3))
        bound = comparing.limit(1, len(runs) - 1) * stats.sem(sample) + 0.1
        assert abs(sample.mean() / (dof / (dof - 2)) - 1) < bound, (c, sample.mean())
        mean = np.mean([one.fluence[..., c].mean(dtype=float) for one in runs])
        error = stats.sem([one.fluence[..., c].mean(dtype=float) for one in runs])
        comparing.assert_z(
            mean, grey.fluence.mean(dtype=float), error, error / 4, dof=len(runs) - 1
        )
