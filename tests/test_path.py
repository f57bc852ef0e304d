"""Images of paths from the camera: tables, quadrature, ways to one answer, error bars.

Where there is no truth, two ways to one answer. Rays of a pixel are independent, and so are pixels:
`assert_image` tests every pixel and the mean over all of them.

False alarms: 1e-5 per assertion (Bonferroni over pixels), about 250 assertions in the tests of
paths together: 0.25 %.
"""

import functools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached
from path_cases import (
    ALMOST,
    FAR,
    FLAT,
    INSIDE,
    PHASES,
    SHAPE,
    SIMDS,
    SIZE,
    SPACING,
    SUN,
    VIEW,
    assert_image,
    cloud,
    homogeneous,
    lit,
    run,
    smooth,
    voxels,
    way,
    ways,
)
from scipy import stats
from truth import View

MU = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
REFLECTED = (0.13304, 0.13856, 0.11956, 0.09411, 0.07132, 0.06180)
TRANSMITTED = (0.16486, 0.22473, 0.27785, 0.36889, 0.72155, 2.40270)
LAYERS = np.array([0.3, 2.1, 0.0, 1.4, 0.2, 3.0])
SLABS = {
    "analytic": ("", "analytic", "nearest", 16_000),
    "analytic scalar": ("scalar", "analytic", "nearest", 4000),
    "woodcock": ("", "woodcock", "nearest", 4000),
    "woodcock linear": ("", "woodcock", "linear", 3000),
    "woodcock scalar": ("scalar", "woodcock", "linear", 2000),
    "march": ("", "march", "nearest", 2000),
    "march linear": ("", "march", "linear", 2000),
}


@pytest.mark.parametrize("name", ways(SLABS))
def test_slab_has_the_radiance_of_van_de_hulst(name, monkeypatch):
    """Layers of any density make the same slab: all that counts is the optical depth, 2."""
    simd, tracker, interpolation, spp = SLABS[name]
    monkeypatch.setenv("MCRT_SIMD", simd)
    layers = np.ones(6) if tracker == "analytic" else LAYERS
    density = np.broadcast_to((layers * 2 / layers.sum())[:, None, None], (6, 1, 1))
    middle = np.array([5e3, 5e3, 0.5])
    for side, table in ((1, REFLECTED), (-1, TRANSMITTED)):
        for seed, (mu, expected) in enumerate(zip(MU, table, strict=True)):
            towards = np.array([np.sqrt(1 - mu * mu), 0, side * mu])
            result = run(
                density,
                spacing=(1.0, 1e4, 1e4),
                interpolation=interpolation,
                albedo=0.9,
                phase=mcrt.HenyeyGreenstein(0.75),
                light=mcrt.DirectionalLight((0, 0, -1), np.pi),
                camera=mcrt.OrthographicCamera(middle + 80 * towards, middle, (0, 1, 0), 1, (4, 4)),
                tracker=tracker,
                spp=spp,
                seed=seed,
            )
            assert_image(result, expected, largest=0.05, what=f"{name}, mu {mu}, side {side}")
            assert (way(result.plan, "walk") == "in lanes") == (not simd and tracker != "march")


ONES = [
    ("scalar", "isotropic", FAR, VIEW, 0.05),
    ("scalar", "hg0.8", SUN, VIEW, 0.8),
    ("", "rayleigh", FAR, FLAT, 0.8),
    ("", "hg0.8", FAR, INSIDE, 0.3),
    ("", "isotropic", SUN, INSIDE, 0.1),
    ("", "hg0.8", SUN, FLAT, 0.02),
]


@pytest.mark.parametrize("box", [False, True], ids=["array", "box"])
@pytest.mark.parametrize(("simd", "phase", "light", "view", "sigma"), ONES)
def test_order_1_of_a_homogeneous_medium_is_its_quadrature(
    simd, phase, light, view, sigma, box, monkeypatch
):
    monkeypatch.setenv("MCRT_SIMD", simd)
    api, pdf = PHASES[phase]
    volume, options = homogeneous(box, sigma, api)
    result = run(
        volume,
        **options,
        light=lit(light),
        camera=view.camera(),
        max_scatterings=1,
        spp=20_000,
    )
    true = truth.single_image(view, SIZE, sigma, 0.9, pdf, light, sub=6, segments=16, order=4)
    assert_image(result, true, largest=0.005)
    assert np.all(result.image(order="2+") == 0)


TOWARD = np.array((-0.42, -0.8, 0.43)) / np.linalg.norm((-0.42, -0.8, 0.43))


@functools.cache
def ways_out():
    """From points all over the box, the ways to the eye and to the sun together."""
    x = stats.qmc.Sobol(3, seed=1).random_base2(18) * SIZE
    away = -np.divide(SUN.direction, np.linalg.norm(SUN.direction))
    return sum(np.where(v > 0, (SIZE - x) / v, -x / v).min(-1) for v in (TOWARD, away))


@pytest.mark.parametrize("box", [False, True], ids=["array", "box"])
@pytest.mark.parametrize("sigma", [0.5, 3.0])
def test_the_whole_of_order_1_is_its_integral(sigma, box):
    """Edges and all: the sum over a parallel view's pixels is an integral over the medium.

    Known within 0.025 %. Mitsuba's `volpath` has +0.039 +- 0.010 % in the box of `to_mitsuba`.
    """
    eye = SIZE / 2 + 28 * TOWARD
    camera = mcrt.OrthographicCamera(eye, SIZE / 2, width=9, resolution=(12, 10))
    true = 0.9 * sigma / (4 * np.pi) * SUN.irradiance * np.exp(-sigma * ways_out())
    volume, options = homogeneous(box, sigma, mcrt.Isotropic())
    result = run(
        volume, **options, light=lit(SUN), camera=camera, max_scatterings=1, spp=250_000, seed=7
    )
    image, error = result.image().astype(float), result.image_error().astype(float)
    true = true.mean() * SIZE.prod() / (9**2 * 10 / 12)
    spread = np.sqrt((error**2).sum()) / error.size
    assert spread < 2.5e-4 * true
    assert abs(image.mean() - true) < comparing.limit() * spread


@pytest.mark.parametrize("simd", SIMDS)
@pytest.mark.parametrize(
    ("interpolation", "light", "view", "extinction"),
    [
        ("nearest", FAR, VIEW, 0.5),
        ("nearest", SUN, INSIDE, 2.0),
        ("linear", SUN, VIEW, 0.5),
        ("linear", FAR, INSIDE, 2.0),
    ],
)
def test_order_1_of_voxels_is_their_quadrature(
    interpolation, light, view, extinction, simd, monkeypatch
):
    monkeypatch.setenv("MCRT_SIMD", simd)
    result = run(
        cloud(),
        spacing=SPACING,
        interpolation=interpolation,
        extinction=extinction,
        albedo=0.9,
        phase=mcrt.HenyeyGreenstein(0.3),
        light=lit(light),
        camera=view.camera(),
        max_scatterings=1,
        spp=20_000,
    )
    true, error = voxels(interpolation, light, view, extinction)
    assert_image(result, true, error, largest=0.01)


@pytest.mark.parametrize("simd", SIMDS)
def test_an_interpolated_depth_is_put_right(simd, monkeypatch):
    """A step of density in thick voxels: the light grid errs by a lot, the mean image by nothing.

    Lit along an axis each voxel column is a medium of its own, so that order 1 seen from the side
    is a sum over voxels.
    """
    monkeypatch.setenv("MCRT_SIMD", simd)
    rng = np.random.default_rng(2)
    density = np.where(rng.random((6, 40, 40)) < 0.5, 0.1, 2.0).astype(np.float32)
    result = run(
        density,
        interpolation="nearest",
        extinction=0.6,
        light=mcrt.DirectionalLight((0, 0, -1), 1.0),
        camera=mcrt.OrthographicCamera((20, 20, 90), (20, 20, 3), (0, 1, 0), 40, (4, 4)),
        max_scatterings=1,
        albedo=1.0,
        spp=60_000,
    )
    assert "light grid" in way(result.plan, "light")
    # Down and up the same column: int sigma exp(-2 tau) dt / 4 pi = (1 - exp(-2 tau)) / 8 pi.
    tau = 0.6 * density.sum(0, dtype=float)
    column = -np.expm1(-2 * tau) / (8 * np.pi)
    true = column.reshape(4, 10, 4, 10).mean((1, 3))[::-1]
    assert_image(result, true, largest=0.001)


PAIRS = {
    "linear": {},
    "nearest": {"interpolation": "nearest", "phase": mcrt.Rayleigh()},
    "thin": {"extinction": 0.1},
    "opaque": {"extinction": 6.0, "albedo": 0.99},
    "albedo": {"albedo": np.random.default_rng(1).random(SHAPE)},
    "albedo nearest": {
        "albedo": np.random.default_rng(1).random(SHAPE),
        "interpolation": "nearest",
    },
    "rgb albedo": {"albedo": (0.99, 0.5, 0.1), "phase": mcrt.HenyeyGreenstein(-0.4)},
    "dark": {"albedo": 0.3, "extinction": 3.0},
    "point inside": {"light": mcrt.PointLight((2.5, 1.9, 2.6), 5.0)},
    "limited": {"max_scatterings": 3, "light": [lit(FAR), mcrt.EnvironmentLight(0.5)]},
    "two lights": {"light": [lit(SUN), mcrt.PointLight((2.1, 1.4, 2.9), 5.0)]},
}


def pair(name, monkeypatch, simd="", **options):
    monkeypatch.setenv("MCRT_SIMD", simd)
    base = {"spacing": SPACING, "extinction": 1.0, "albedo": 0.95, "light": lit(FAR)}
    base |= {"phase": mcrt.HenyeyGreenstein(0.5), "camera": VIEW.camera(), "spp": 4000}
    return run(cloud(), **base | PAIRS[name] | options)


@pytest.mark.parametrize("name", PAIRS)
def test_lanes_and_trackers_agree(name, monkeypatch):
    lanes = pair(name, monkeypatch, tracker="woodcock", spp=8000)
    scalar = pair(name, monkeypatch, "scalar", tracker="woodcock", seed=1)
    march = pair(name, monkeypatch, tracker="march", seed=2)
    assert [way(r.plan, "walk") for r in (lanes, scalar, march)] == ["in lanes"] + 2 * [
        "one by one"
    ]
    for other in (scalar, march):
        assert_image(lanes, other.image(), other.image_error(), what=name)
    # Layers too, by the errors of the sums, which are not less than theirs.
    for order in (1, "2+"):
        layer = (lanes.image(order=order), lanes.image_error())
        assert_image(layer, scalar.image(order=order), scalar.image_error(), what=f"{name} {order}")


@pytest.mark.parametrize("simd", SIMDS)
@pytest.mark.parametrize("kind", ["point", "environment", "map", "inside"])
def test_a_limit_leaves_out_higher_orders_only(kind, simd, monkeypatch):
    light = {
        "point": lit(FAR),
        "environment": mcrt.EnvironmentLight(1.0),
        "map": mcrt.EnvironmentLight(ALMOST),
        "inside": mcrt.PointLight((2.5, 1.9, 2.6), 5.0),
    }[kind]
    all_orders = pair("linear", monkeypatch, simd, light=light)
    one = pair("linear", monkeypatch, simd, light=light, max_scatterings=1, seed=1)
    two = pair("linear", monkeypatch, simd, light=light, max_scatterings=2, seed=2)
    layer = (all_orders.image(order=1), all_orders.image_error())
    assert_image(layer, one.image(), one.image_error(), what=kind)
    assert_image((two.image(order=1), two.image_error()), one.image(), one.image_error())
    assert np.all(one.image(order="2+") == 0)
    assert np.all(two.image(order="2+") > 0)
    assert np.all(two.image() < all_orders.image() + 5 * all_orders.image_error())


@pytest.mark.parametrize("kind", ["point", "environment", "emission"])
def test_paths_and_photons_agree(kind):
    options = {
        "point": {"light": mcrt.PointLight((30, -20, 30), 1e3)},
        "environment": {"light": mcrt.EnvironmentLight(1.0)},
        "emission": {"light": (), "emission": smooth()},
    }[kind]
    view = View((40, -30, 25), (6, 6, 6), (4, 3), fov=8)
    options |= {"extinction": 0.4, "albedo": 0.9, "camera": view.camera()}
    path = run(smooth(), spp=30_000, **options)
    photon = mcrt.simulate(
        smooth(), method="photon", photons=2e6, outputs=("image",), progress=False, **options
    )
    dof = comparing.dof(photon, "pixel")
    # Photons' voxels are a 4th of the blob's width: their interpolation errs by some thousandths
    # of orders 2 and up, and their light grid in order 1.
    for order in (None, 1, "2+"):
        a, b = path.image(order=order), photon.image(order=order)
        comparing.assert_z(
            a, b, path.image_error(), photon.image_error(), dof=dof, relative=4e-3, what=str(order)
        )


# Any two values of two parameters meet.
@pytest.mark.parametrize(
    ("kind", "scale", "tracker"),
    [
        ("point", 0.1, "woodcock"),
        ("point", 1.0, "march"),
        ("inside", 0.1, "march"),
        ("inside", 1.0, "woodcock"),
        ("environment", 0.1, "woodcock"),
        ("environment", 1.0, "march"),
        ("map", 0.1, "march"),
        ("map", 1.0, "woodcock"),
    ],
)
def test_each_channel_is_its_own_grey_run(kind, scale, tracker):
    """Extinctions of 1 : 5 : 20 in one walk."""
    light = {
        "point": lit(FAR),
        "inside": mcrt.PointLight((2.5, 1.9, 2.6), 5.0),
        "environment": mcrt.EnvironmentLight(1.0),
        "map": mcrt.EnvironmentLight(ALMOST[..., 0]),
    }[kind]
    extinction = scale * np.array([0.2, 1.0, 4.0])
    common = {"spacing": SPACING, "light": light, "camera": VIEW.camera(), "albedo": 0.9}
    common |= {"phase": mcrt.HenyeyGreenstein(0.5)}
    rgb = run(cloud(), extinction=extinction, tracker=tracker, spp=4000, **common)
    assert "spectral MIS" in way(rgb.plan, "channels")
    for c in range(3):
        grey = run(cloud(), extinction=extinction[c], spp=4000, seed=c + 1, **common)
        mine = rgb.image()[..., c], rgb.image_error()[..., c]
        assert_image(mine, grey.image(), grey.image_error(), what=f"channel {c}")


@pytest.mark.parametrize("light", [lit(FAR), mcrt.PointLight((2.5, 1.9, 2.6), 5.0)])
def test_the_origin_may_be_far_away(light, monkeypatch):
    away = np.array([5e6, -5e6, 5e6])
    moved = mcrt.PointLight(light.position + away, light.intensity)
    view = View(VIEW.origin + away, VIEW.target + away, VIEW.resolution, fov=VIEW.fov)
    here = pair("linear", monkeypatch, light=light)
    there = pair("linear", monkeypatch, light=moved, origin=away, camera=view.camera())
    # 2 %: coordinates of 5e6 are known to half a unit in single precision, fates of a few differ.
    np.testing.assert_allclose(there.image(), here.image(), rtol=0.02)
    assert_image(there, here.image(), here.image_error())


STARTS = {"thin": ("walked", 0.15), "opaque": ("flown", 3.0)}
SEEDS = 44


@cached
def replicas(kind, simd):
    volume = np.random.default_rng(91).gamma(2.0, 0.5, SHAPE).astype(np.float32)
    runs = [
        run(
            volume,
            spacing=SPACING,
            extinction=STARTS[kind][1],
            albedo=0.95,
            phase=mcrt.HenyeyGreenstein(0.3),
            light=lit(SUN),
            camera=VIEW.camera(),
            spp=500,
            seed=seed,
            threads=1,
        )
        for seed in range(SEEDS)
    ]
    assert ("walk" in way(runs[0].plan, "first collisions")) == (kind == "thin")
    images = np.array([r.image() for r in runs], float).reshape(SEEDS, -1)
    errors = np.array([r.image_error() for r in runs], float).reshape(SEEDS, -1)
    # Deviations from the mean over all seeds have 1 - 1 / SEEDS of the variance.
    return (images - images.mean(0)) / errors / np.sqrt(1 - 1 / SEEDS), errors / images


@pytest.mark.parametrize("simd", SIMDS)
@pytest.mark.parametrize("kind", STARTS)
def test_error_bars_have_the_right_size(kind, simd, monkeypatch):
    monkeypatch.setenv("MCRT_SIMD", simd)
    z, relative = replicas(kind, simd)
    pixels = z.shape[1]
    free = (SEEDS - 1) * pixels
    # Errors are known to a few percent (125 rays): they widen z by as little.
    low, high = stats.chi2.interval(1 - comparing.ALPHA, free)
    assert low * 0.97 < (z**2).sum() < high * 1.05
    assert relative.max() < 0.2
    # Pixels are independent: the sum over them scatters as the root of their number.
    sums = z.sum(1) / np.sqrt(pixels)
    low, high = stats.chi2.interval(1 - comparing.ALPHA, SEEDS - 1)
    assert low < (sums**2).sum() < high
    correlation = np.corrcoef(z.T)[np.triu_indices(pixels, 1)]
    assert np.abs(correlation).max() < comparing.limit(len(correlation)) / np.sqrt(SEEDS - 3)
    assert abs(correlation.mean()) < comparing.limit() / np.sqrt(SEEDS * len(correlation))


def test_errors_fall_as_one_over_the_root_of_the_samples(monkeypatch):
    few, many = (
        np.sqrt(np.mean(pair("linear", monkeypatch, spp=spp).image_error().astype(float) ** 2))
        for spp in (400, 40_000)
    )
    # 15 %: 400 samples know their error by some percent.
    assert few / many == pytest.approx(10, rel=0.15)
