"""Orders 0 and 1 against quadrature.

Pictures depend on no chance. Fluence in voxels is found by rays of random shift: z-scores by their
error bars, 1e-5 per assertion, about 30 assertions.

Bounds on images are relative RMS (rms of the difference / mean of the truth): 0.2 % where the box
fills the picture, which is what a picture needs to look the same at 8 bits; 1 % where silhouettes
and edges of the box cross coarse pixels.
"""

import functools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from scipy import stats
from truth import Directional, Point, View

SHAPE, SPACING = (8, 10, 12), (1.0, 0.8, 0.5)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # 6, 8, 8
OUTSIDE, BESIDE = Point((14, -7, 16), 300.0), Directional((-0.4, 0.5, -0.8), 2.0)
WITHIN, ON_CENTRE = Point((2.1, 3.3, 4.6), 5.0), Point((2.25, 3.6, 4.5), 5.0)
LENS = View((-9, -14, 12), (3, 4, 4), (32, 24), fov=14)
FLAT = View((14, -9, 11), (3, 4, 4), (32, 24), width=3.0)
TILTED = View((-9, 14, 12), (3, 4, 4), (32, 24), fov=12, up=(0.4, 0.3, 1))
ENCLOSED = View((2.0, 3.0, 2.5), (5, 6, 7), (32, 24), fov=40)
QUADRATURE = {"sub": 3, "segments": 16, "order": 4}  # relative RMS 1e-4 of what they converge to
PHASES = {
    "isotropic": (mcrt.Isotropic, truth.isotropic),
    "rayleigh": (mcrt.Rayleigh, truth.rayleigh),
    "hg0.8": (lambda: mcrt.HenyeyGreenstein(0.8), truth.hg(0.8)),
    "hg-0.4": (lambda: mcrt.HenyeyGreenstein(-0.4), truth.hg(-0.4)),
}


def api_light(light, factor=1.0):
    if isinstance(light, Point):
        return mcrt.PointLight(light.position, np.multiply(light.intensity, factor))
    return mcrt.DirectionalLight(light.direction, np.multiply(light.irradiance, factor))


def run(light, view=LENS, density=None, **options):
    options = {"interpolation": "nearest", "method": "single", "max_scatterings": 1} | options
    light = (
        light
        if isinstance(light, mcrt.PencilBeam)
        else api_light(light, options.pop("colour", 1.0))
    )
    density = np.ones(SHAPE, np.float32) if density is None else density
    return mcrt.simulate(density, spacing=SPACING, light=light, camera=view.camera(), **options)


def assert_close(image, true, bound=0.002):
    assert image.shape == true.shape
    assert np.all(np.isfinite(image))
    assert comparing.relative_rms(image, true) < bound


# Any two values of two parameters meet. The extinction times spacing 1: optical depths of a voxel.
@pytest.mark.parametrize(
    ("phase", "light", "view", "sigma"),
    [
        ("isotropic", OUTSIDE, LENS, 0.05),
        ("isotropic", BESIDE, FLAT, 0.5),
        ("rayleigh", OUTSIDE, FLAT, 0.5),
        ("rayleigh", BESIDE, LENS, 0.05),
        ("hg0.8", OUTSIDE, LENS, 0.5),
        ("hg0.8", BESIDE, FLAT, 0.05),
        ("hg-0.4", OUTSIDE, FLAT, 0.05),
        ("hg-0.4", BESIDE, LENS, 0.5),
    ],
)
def test_single_scattering_matches_quadrature(phase, light, view, sigma):
    api, pdf = PHASES[phase]
    image = run(light, view, extinction=sigma, albedo=0.9, phase=api()).image()
    assert_close(image, truth.single_image(view, SIZE, sigma, 0.9, pdf, light, **QUADRATURE))


@pytest.mark.parametrize("sigma", [0.05, 0.5])
@pytest.mark.parametrize(
    ("light", "view", "interpolation"),
    [(OUTSIDE, TILTED, "linear"), (OUTSIDE, ENCLOSED, "nearest"), (BESIDE, ENCLOSED, "linear")],
    ids=["tilted", "eye inside, point", "eye inside, directional"],
)
def test_single_scattering_matches_quadrature_for_other_eyes(light, view, interpolation, sigma):
    phase = mcrt.HenyeyGreenstein(0.5)
    image = run(
        light, view, extinction=sigma, albedo=0.9, phase=phase, interpolation=interpolation
    ).image()
    assert_close(
        image, truth.single_image(view, SIZE, sigma, 0.9, truth.hg(0.5), light, **QUADRATURE)
    )


@pytest.mark.parametrize("sigma", [0.05, 0.5])
@pytest.mark.parametrize("light", [WITHIN, ON_CENTRE], ids=["between centres", "on a centre"])
def test_single_scattering_matches_quadrature_with_the_light_inside(light, sigma):
    view = View((-9, -14, 12), (3.4, 4.4, 4.2), (31, 23), fov=14)
    image = run(light, view, extinction=sigma, albedo=0.9).image()
    true = truth.single_image(view, SIZE, sigma, 0.9, truth.isotropic, light, **QUADRATURE)
    # Next to the light the radiance is as 1 / distance: not a matter of quadrature within a pixel
    # or two.
    near = np.unravel_index(np.argmax(true), true.shape)
    row, column = np.indices(true.shape)
    far = np.hypot(row - near[0], column - near[1]) > 3
    assert_close(image[far], true[far])
    assert np.isfinite(image).all()
    origin, direction, weight = view.rays(40)
    ray = truth.single_scattering(
        origin[near], direction[near], SIZE, sigma, 0.9, truth.isotropic, light
    )
    # 5 %: of the brightest pixel alone, within which the radiance has its peak.
    assert image[near] == pytest.approx((ray * weight).sum(), rel=0.05)


def test_pixel_is_the_mean_over_its_area():
    # The whole box in 8 x 6 pixels: most of them hold an edge.
    view = View((-9, -14, 12), (3, 4, 4), (8, 6), fov=36)
    image = run(OUTSIDE, view, extinction=0.3).image()
    assert_close(
        image,
        truth.single_image(
            view, SIZE, 0.3, 0.9, truth.isotropic, OUTSIDE, sub=16, segments=8, order=4
        ),
        0.01,
    )


def test_colour_channels_of_light_and_albedo_are_independent():
    albedo, colour = (0.9, 0.5, 0.0), (1.0, 0.0, 3.0)
    image = run(OUTSIDE, extinction=0.3, albedo=albedo, colour=colour).image()
    true = truth.single_image(LENS, SIZE, 0.3, 1.0, truth.isotropic, OUTSIDE, **QUADRATURE)
    assert_close(image[..., 0], 0.9 * true)
    assert np.all(image[..., 1:] == 0)


def test_extinction_of_each_channel_attenuates_that_channel():
    extinction, albedo, colour = (0.02, 0.2, 1.0), (0.9, 0.8, 0.7), (1.0, 2.0, 3.0)
    image = run(BESIDE, FLAT, extinction=extinction, albedo=albedo, colour=colour).image()
    assert image.shape == (24, 32, 3)
    for c in range(3):
        true = truth.single_image(
            FLAT, SIZE, extinction[c], albedo[c], truth.isotropic, BESIDE, **QUADRATURE
        )
        assert_close(image[..., c], colour[c] * true)


def test_albedo_of_each_voxel_scales_its_scattering():
    # Two halves of different albedo, seen along x: the near half's albedo holds for the near half's
    # light.
    albedo = np.full(SHAPE, 0.8, np.float32)
    albedo[:, :, 6:] = 0.0
    view = View((-20, 4, 4), (3, 4, 4), (16, 16), width=4.0)
    image = run(BESIDE, view, extinction=0.3, albedo=albedo).image()
    origin, direction, weight = view.rays(3)
    both = truth.single_scattering(origin, direction, SIZE, 0.3, 0.8, truth.isotropic, BESIDE)
    # What the far half adds: seen from the plane x = 3 through 3 lengths of the near half, light
    # through all of the box.
    x = 3 + 3 * (np.polynomial.legendre.leggauss(40)[0] + 1) / 2
    w = np.polynomial.legendre.leggauss(40)[1] * 3 / 2
    points = origin[..., None, :] + (x - origin[..., :1])[..., None] * direction[..., None, :]
    _, fluence = truth.unscattered(BESIDE, points, SIZE, 0.3)
    far = (0.8 * 0.3 / (4 * np.pi) * fluence * np.exp(-0.3 * x) * w).sum(-1)
    assert_close(image, ((both - far) * weight).sum(-1))


def test_order_1_of_a_photon_run_is_the_image_of_single():
    options = {"extinction": 0.3, "albedo": 0.9}
    single = run(OUTSIDE, **options)
    photon = run(OUTSIDE, method="photon", max_scatterings=4, photons=1e4, seed=51, **options)
    np.testing.assert_allclose(photon.image(order=1), single.image(), rtol=1e-5)
    np.testing.assert_allclose(
        photon.image(order=1) + photon.image(order="2+"), photon.image(), rtol=1e-5
    )


def blobs(linear, shape=SHAPE):
    """Heterogeneous density with voids; smooth where it is interpolated."""
    rng = np.random.default_rng(52)
    if not linear:
        return np.where(rng.random(shape) < 0.3, 0, rng.gamma(1.0, 1.0, shape)).astype(np.float32)
    z, y, x = (np.linspace(-1, 1, n) for n in shape)
    radius = np.sqrt(z[:, None, None] ** 2 + y[:, None] ** 2 + x**2)
    return np.clip(1.2 - radius, 0, None).astype(np.float32)


@pytest.mark.parametrize(
    "view", [LENS, FLAT, ENCLOSED], ids=["perspective", "orthographic", "eye inside"]
)
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_alpha_is_one_minus_transmittance(interpolation, view):
    linear = interpolation == "linear"
    density = blobs(linear)
    alpha = run(OUTSIDE, view, density, extinction=0.4, interpolation=interpolation).alpha(
        view.camera()
    )
    true = 1 - truth.transmittance_image(view, 0.4 * density, SPACING, linear, sub=4)
    assert_close(alpha, true)


# ---- fluence of order 0: voxel means

SEEDS, LATTICES, GRIDS = 4, 8, 16
FEW = (5, 6, 7)  # voxels: each is met by more of the rays of a truth
AMID = Point((1.6, 2.6, 2.7), 5.0)
FLUENCE = ("fluence", "fluence_error")


def assert_voxels(light, density, grids, ceiling=None, **options):
    """The fluence of several seeds, each and their mean, within its error bars of the truth.

    The truth is the mean over `grids`, with its scatter for an error if they are many.
    """
    runs = [run(light, density=density, seed=s, **options) for s in range(SEEDS)]
    values, errors = (np.array([getattr(r, n) for r in runs], float) for n in FLUENCE)
    true, noise, doubt, dof = grids.mean(0), 0.0, 0.0, np.inf
    if len(grids) > 1:
        sums = grids.sum((1, 2, 3))
        noise, doubt, dof = stats.sem(grids), stats.sem(sums) / sums.mean(), len(grids) - 1
    comparing.assert_z(values, true, errors, noise, dof=LATTICES - 1, what="each")
    mean_error = np.sqrt((errors**2).mean(0) / SEEDS)
    dof = min(dof, SEEDS * (LATTICES - 1))
    comparing.assert_z(values.mean(0), true, mean_error, noise, dof=dof, what="mean")
    total = values.sum((1, 2, 3)) / true.sum() - 1
    rms = np.sqrt(np.mean((values / true - 1) ** 2))
    print(f"total {np.abs(total).max():.1e}, doubt {doubt:.1e}, rms {rms:.1e}")
    # 0.05 %: the whole is sharper than its voxels, and has an error of 0.01 % where rays are drawn.
    assert np.abs(total).max() < 5e-4 + comparing.limit(1, GRIDS - 1) * doubt
    assert ceiling is None or rms < ceiling


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("light", [WITHIN, ON_CENTRE], ids=["between centres", "on a centre"])
def test_fluence_of_a_light_inside_follows_beer_lambert(light, sigma):
    density = np.full(SHAPE, sigma, np.float32)
    true = truth.fluence_of_inner_point(light.position, light.intensity, SHAPE, SPACING, sigma)
    # Half a percent is what is claimed of voxels where the error bar is not to be looked at.
    assert_voxels(light, density, true[None], 0.005)


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("sigma", [0.05, 0.5])
@pytest.mark.parametrize("light", [OUTSIDE, BESIDE], ids=["point", "directional"])
def test_fluence_of_a_light_outside_follows_beer_lambert(light, sigma):
    density = np.full(FEW, sigma, np.float32)
    grids = truth_grids(light, density, False)
    assert_voxels(light, density, grids)


def truth_grids(light, density, linear):
    """Fluence by rays of the truth's own."""
    scene = (light, density.astype(float), SPACING, linear, (1.0,), 30 if linear else 40)
    return np.array([truth.order_0_by_rays(*scene, seed)[0, 0] for seed in range(GRIDS)])


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize(
    "light", [OUTSIDE, BESIDE, AMID], ids=["point", "directional", "light inside"]
)
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_fluence_in_a_heterogeneous_volume_follows_beer_lambert(interpolation, light):
    # Of such depths that a density wrong by 1 % is seen.
    density = (1.6 if interpolation == "linear" else 0.8) * blobs(interpolation == "linear", FEW)
    grids = truth_grids(light, density, interpolation == "linear")
    assert_voxels(light, density, grids, interpolation=interpolation)


def test_light_along_an_axis_is_attenuated_column_by_column():
    density = blobs(False)
    fluence = run(Directional((0, 0, 1), 2.0), density=density, extinction=0.4).fluence
    tau = 0.4 * density.astype(float) * SPACING[0]
    before = np.cumsum(tau, axis=0) - tau
    true = 2 * np.exp(-before) * np.where(tau > 0, -np.expm1(-tau) / np.where(tau > 0, tau, 1), 1)
    np.testing.assert_allclose(fluence, true, rtol=1e-4)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("direction", [(0, 0, 1), (0.3, 0.4, -0.5)], ids=["along z", "skew"])
def test_fluence_of_a_pencil_beam_is_its_path_in_each_voxel(direction, interpolation):
    linear = interpolation == "linear"
    density = blobs(linear)
    start = np.array([2.77, 3.53, 3.91]) - 20 * np.array(direction) / np.linalg.norm(direction)
    beam = mcrt.PencilBeam(tuple(start), direction, 3.0)
    result = run(
        beam,
        density=density,
        extinction=0.4,
        interpolation=interpolation,
        albedo=0.0,
        method="auto",
        seed=53,
    )
    true = 3 * truth.ray_fluence(
        0.4 * density.astype(float), SPACING, start, direction, linear=linear
    )
    comparing.assert_z(
        result.fluence, true, np.hypot(result.fluence_error, 2e-4 * true.max()), relative=3e-3
    )


@functools.cache
def true_of_blobs():
    return truth.fluence_of_order_0(OUTSIDE, 0.4 * blobs(True, FEW).astype(float), SPACING, True)


@pytest.mark.parametrize("method", ["auto", "single", "photon"])
def test_pure_absorber_follows_beer_lambert(method):
    density = blobs(True, FEW)
    options = {"photons": 1e4} if method == "photon" else {}
    result = run(
        OUTSIDE,
        density=density,
        extinction=0.4,
        interpolation="linear",
        albedo=0.0,
        method=method,
        max_scatterings=None,
        **options,
    )
    true = true_of_blobs()
    assert comparing.relative_rms(result.fluence, true) < 0.002
    assert np.all(result.image() == 0)
    assert np.all(result.radiance == 0)
    assert result.energy.truncated == pytest.approx(0, abs=1e-6)
    assert sum(result.energy.escaped.values()) == pytest.approx(0, abs=1e-6)
    absorbed = (0.4 * density * true).sum() * np.prod(SPACING) / result.energy.launched
    # 1 %: the truth's sum is of products of voxel values, not of the product's voxel means
    assert result.energy.absorbed == pytest.approx(absorbed, rel=0.01)
