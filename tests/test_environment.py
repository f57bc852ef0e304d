"""Environment maps: where their texels are, what they send into a volume, what is seen behind it.

Truths are quadratures over directions of the bilinear map, written here a second time. False
alarms: 1e-5 per assertion (Bonferroni over voxels, pixels and channels), about 60 assertions.
"""

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import gappy
from scipy import stats

SHAPE, SPACING = (3, 4, 5), (1.1, 0.6, 0.8)
SIZE = np.multiply(SHAPE, SPACING)[::-1]
VIEW = truth.View((-6, -9, 8), (2.0, 1.2, 1.6), (12, 10), fov=40)
AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0)}
AXES |= {"+z": (0, 0, 1), "-z": (0, 0, -1)}


def sky(height=8, width=12, channels=1, seed=0):
    """A map with dark texels and a sun."""
    rng = np.random.default_rng(seed)
    texels = rng.gamma(1.0, 1.0, (height, width, channels))
    texels[rng.random((height, width)) < 0.3] = 0
    texels[height // 3, width // 4] = 40 * rng.random(channels) + 10
    return texels[..., 0] if channels == 1 else texels


def cloud():
    return gappy(SHAPE, 41)


def radiance(texels, d):
    """What comes from the unit vectors d (..., 3) to the sky: (..., channels)."""
    texels = np.asarray(texels, float).reshape(*texels.shape[:2], -1)
    height, width = texels.shape[:2]
    x, y, z = np.moveaxis(np.asarray(d, float), -1, 0)
    row = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * height - 0.5, 0, height - 1)
    column = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * width - 0.5
    r, c = np.floor(row).astype(int), np.floor(column).astype(int)
    v, u = (row - r)[..., None], (column - c)[..., None]
    below = np.minimum(r + 1, height - 1)

    def line(r):
        return (1 - u) * texels[r, c % width] + u * texels[r, (c + 1) % width]

    return (1 - v) * line(r) + v * line(below)


def sphere(n=200):
    """Unit vectors and weights [sr] of a midpoint rule over all directions."""
    z = 1 - (2 * np.arange(n) + 1) / n
    phi = np.pi * (np.arange(2 * n) + 0.5) / n
    s = np.sqrt(1 - z * z)[:, None]
    d = np.stack([s * np.cos(phi), s * np.sin(phi), np.broadcast_to(z[:, None], (n, 2 * n))], -1)
    return d.reshape(-1, 3), 4 * np.pi / (2 * n * n)


def launched(texels, size):
    """The integral over directions of radiance times projected area, by channel."""
    d, weight = sphere(1000)
    area = np.abs(d) @ [size[1] * size[2], size[2] * size[0], size[0] * size[1]]
    return weight * (radiance(texels, d) * area[:, None]).sum(0)


def run(density, texels=None, **arguments):
    defaults = {
        "spacing": SPACING,
        "extinction": 1.0,
        "albedo": 0.8,
        "camera": VIEW.camera(),
        "method": "photon",
        "photons": 2e5,
        "progress": False,
    }
    if texels is not None:
        defaults["light"] = mcrt.EnvironmentLight(texels)
    return mcrt.simulate(density, **(defaults | arguments))


# ----------------------------------------------------------------------------------- constant maps


@pytest.mark.parametrize("value", [1.5, (0.5, 1.0, 2.0)], ids=["grey", "rgb"])
def test_a_constant_map_is_the_constant_environment(value):
    texels = np.broadcast_to(value, (4, 8, *np.shape(value)))
    a, b = run(cloud(), texels, photons=1e4), run(cloud(), value, photons=1e4)
    assert np.array_equal(a.fluence, b.fluence)
    assert np.array_equal(a.image(), b.image())
    assert np.array_equal(a.image(order=0), b.image(order=0))


def almost_constant(height, width, channels=1):
    """Not constant, so that it goes the way of maps, but constant as far as photons can tell."""
    texels = np.ones((height, width, channels), np.float32)
    texels[0, 0] += 1e-5
    return texels[..., 0] if channels == 1 else texels


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("shape", [(1, 2), (7, 10), (7, 10, 3)], ids=str)
def test_white_furnace_of_a_map_is_uniform(shape, interpolation):
    result = run(
        cloud(),
        almost_constant(*shape),
        albedo=1.0,
        extinction=2.0,
        interpolation=interpolation,
        phase=mcrt.HenyeyGreenstein(0.5),
        photons=4e5,
        seed=3,
    )
    error, dof = result.fluence_error, comparing.dof(result)
    comparing.assert_z(result.fluence, 4 * np.pi, error, dof=dof, what="fluence")
    assert np.median(error) < 0.012 * 4 * np.pi
    # One texel is brighter by 1e-5.
    np.testing.assert_allclose(result.energy.launched, np.pi * truth.surface(SIZE), rtol=1e-5)
    image = result.image() + result.image(order=0)
    error, dof = result.image_error(), comparing.dof(result, "pixel")
    comparing.assert_z(image, 1, error, dof=dof, what="image")


# ---------------------------------------------------------------------------- what enters a volume


@pytest.mark.parametrize("channels", [1, 3])
def test_fluence_in_a_void_is_the_integral_of_the_map(channels):
    texels = sky(channels=channels)
    result = run(np.zeros(SHAPE), texels)
    d, weight = sphere(500)
    total = weight * radiance(texels, d).sum(0)
    total = total[0] if channels == 1 else total
    comparing.assert_z(result.fluence, total, result.fluence_error, dof=comparing.dof(result))
    assert np.all(
        np.abs(result.energy.unscattered - 1) <= 1e-6 + comparing.limit(3, 7) * result.energy.error
    )


def test_fluence_in_a_pure_absorber_is_the_attenuated_map():
    texels, sigma, shape = sky(channels=3), np.array([0.3, 0.7, 1.5]), (2, 3, 2)
    size = np.multiply(shape, SPACING)[::-1]
    result = run(np.ones(shape), texels, extinction=sigma, albedo=0.0, photons=1e6, seed=5)
    d, weight = sphere(48)
    sent = weight * radiance(texels, d)
    node, w = np.polynomial.legendre.leggauss(5)
    expected = np.zeros((*shape, 3))
    for k, j, i in np.ndindex(shape):
        for at in np.ndindex(5, 5, 5):
            place = (np.array([k, j, i]) + (node[list(at)] + 1) / 2) * SPACING
            way = (np.where(d > 0, size - place[::-1], -place[::-1]) / d).min(-1)
            seen = (sent * np.exp(-sigma * way[:, None])).sum(0)
            expected[k, j, i] += np.prod(w[list(at)]) / 8 * seen
    # Nodes of 125 per voxel and 4600 directions are off by up to .09 %, of 343 and 80,000.
    comparing.assert_z(
        result.fluence, expected, result.fluence_error, dof=comparing.dof(result), relative=1e-3
    )
    assert np.median(result.fluence_error / expected) < 0.008
    # The midpoint rule is off by 1e-5.
    np.testing.assert_allclose(result.energy.launched, launched(texels, size), rtol=2e-5)


def test_a_bright_texel_is_a_directional_light():
    texels = np.zeros((256, 512), np.float32)
    row, column = 70, 330
    texels[row, column] = 1e4
    theta, phi = np.pi * (row + 0.5) / 256, 2 * np.pi * ((column + 0.5) / 512 - 0.5)
    to_sky = (np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta))
    # a texel's hat holds as much as its solid angle, to second order
    irradiance = 1e4 * np.sin(theta) * (np.pi / 256) * (2 * np.pi / 512)
    sun = mcrt.DirectionalLight(np.negative(to_sky), irradiance)
    a, b = run(cloud(), texels, photons=1e6), run(cloud(), light=sun, photons=1e6, seed=1)
    # Welch and Satterthwaite, the least of all voxels.
    one, two = (np.square(r.fluence_error, dtype=float) for r in (a, b))
    dof = ((one + two) ** 2 / (one**2 / comparing.dof(a) + two**2 / comparing.dof(b))).min()
    comparing.assert_z(
        a.fluence,
        b.fluence,
        a.fluence_error,
        b.fluence_error,
        dof=dof,
        relative=1e-3,
        what="fluence",
    )
    # (pi / 256)^2 / 12 is 1.3e-5, and more towards the pole.
    assert a.energy.launched == pytest.approx(b.energy.launched, rel=1e-4)
    for face, share in a.energy.escaped.items():
        error = comparing.fraction_error(share, 1e6)
        comparing.assert_z(b.energy.escaped[face], share, error, error, relative=1e-3, what=face)


@pytest.mark.parametrize("axis", AXES)
def test_light_of_an_axis_falls_on_its_face(axis):
    direction = np.array(AXES[axis])
    texels = np.zeros((18, 36))
    rows, columns = np.indices(texels.shape)
    theta, phi = np.pi * (rows + 0.5) / 18, 2 * np.pi * ((columns + 0.5) / 36 - 0.5)
    centres = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)])
    texels[np.tensordot(direction, centres, 1) > np.cos(np.radians(15))] = 1
    fluence = run(np.ones((5, 5, 5)), texels, spacing=1.0, extinction=3.0, albedo=0.0).fluence
    face = {"z": 0, "y": 1, "x": 2}[axis[1]]
    along = fluence.sum(tuple(a for a in range(3) if a != face))
    along = along if axis[0] == "+" else along[::-1]
    assert along[-1] > 10 * along[:-1].max()


@pytest.mark.parametrize("extinction", [1.0, (0.5, 1.0, 2.0)], ids=["grey", "rgb"])
@pytest.mark.parametrize("channels", [1, 3])
def test_energy_of_a_map_adds_up(channels, extinction):
    texels = sky(channels=channels)
    result = run(cloud(), texels, extinction=extinction, max_scatterings=4)
    expected = launched(texels, SIZE)
    expected = np.broadcast_to(expected, 3) if np.ndim(result.energy.launched) else expected[0]
    # The midpoint rule is off by 1e-5.
    np.testing.assert_allclose(result.energy.launched, expected, rtol=2e-5)
    comparing.assert_balance(result.energy)
    # every photon weighs the same, or the same in all channels together
    assert np.all(result.energy.error < (1e-6 if np.ndim(expected) == 0 else 0.004))


def test_channels_of_a_map_are_maps_of_their_own():
    texels = sky(channels=3)
    all_three = run(cloud(), texels, photons=1e6)
    for c in range(3):
        one = run(cloud(), texels[..., c], seed=7 + c)
        comparing.assert_z(
            all_three.fluence[..., c],
            one.fluence,
            all_three.fluence_error[..., c],
            one.fluence_error,
            dof=comparing.dof(one),
        )


@pytest.mark.cpu_only("many short runs; test_gpu.py holds the GPU's pictures against the CPU's")
def test_single_and_photon_agree_on_light_scattered_once():
    """Over seeds, for the error of a picture is that of all its orders together."""
    options = {"phase": mcrt.HenyeyGreenstein(0.3), "photons": 2e4, "outputs": ("image",)}
    single = [run(cloud(), sky(), method="single", seed=s, **options).image() for s in range(24)]
    photon = [run(cloud(), sky(), seed=100 + s, **options).image(order=1) for s in range(24)]
    errors = stats.sem(single), stats.sem(photon)
    comparing.assert_z(np.mean(single, 0), np.mean(photon, 0), *errors, dof=23)
    whole = [np.sum(images, (1, 2)).ravel() for images in (single, photon)]
    comparing.assert_mean(whole[0] / whole[1], 1.0)


# ------------------------------------------------------------------------------ what is seen of it


def assert_background(result, view, texels, extinction, size, sub=24):
    origin, direction, weight = view.rays(sub)
    near, far = truth.box_interval(origin, direction, size)
    way = np.clip(far - near, 0, None)
    seen = radiance(texels, direction) * np.exp(-np.multiply.outer(way, np.ravel(extinction)))
    expected = (seen * weight[:, None]).sum(-2)
    image = result.image(view.camera(), order=0)
    image = image[..., None] if image.ndim == 2 else image
    # Few rays a pixel: a regular grid of 3 x 3 has an rms of 2 % here, and 10 % of a dark pixel
    # beside the sun.
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=0.05, atol=0.1)
    assert comparing.relative_rms(image, expected) < 0.025


@pytest.mark.parametrize("axis", AXES)
def test_a_camera_sees_the_map_where_it_looks(axis):
    texels = sky(16, 24)
    centre = SIZE / 2
    view = truth.View(
        tuple(centre),
        tuple(centre + AXES[axis]),
        (9, 7),
        fov=80,
        up=(0, 0, 1) if axis[1] != "z" else (0.3, 1, 0),
    )
    result = run(np.zeros(SHAPE), texels, photons=100)
    assert_background(result, view, texels, 0.0, SIZE)


@pytest.mark.parametrize("extinction", [0.6, (0.3, 0.8, 2.0)], ids=["grey", "rgb"])
def test_the_background_is_the_map_through_the_medium(extinction):
    texels = sky(64, 128, channels=np.size(extinction))
    result = run(np.ones(SHAPE), texels, extinction=extinction, photons=1000)
    assert_background(result, VIEW, texels, extinction, SIZE)


def test_parallel_rays_see_one_point_of_the_sky():
    texels = sky()
    view = truth.View((-6, -9, 8), (2.0, 1.2, 1.6), (8, 6), width=30)
    result = run(np.zeros(SHAPE), texels, camera=view.camera(), photons=100)
    d = np.subtract(view.target, view.origin)
    expected = radiance(texels, d / np.linalg.norm(d))[0]
    np.testing.assert_allclose(result.image(order=0), expected, rtol=2e-6)


# ----------------------------------------------------------------------------------------- records


@pytest.mark.cpu_only("what the core is given does not depend on the backend")
def test_maps_are_compared_by_value_and_kept():
    texels = sky()
    a, b = mcrt.EnvironmentLight(texels), mcrt.EnvironmentLight(texels.copy())
    other = mcrt.EnvironmentLight(2 * texels)
    assert len({a, b, other, mcrt.EnvironmentLight(1.0)}) == 3
    assert (
        mcrt.EnvironmentLight(1.0) == mcrt.EnvironmentLight(1) != mcrt.EnvironmentLight((1, 1, 1))
    )
    texels[:] = 0
    assert a == b
    assert not a.radiance.flags.writeable
    assert isinstance(mcrt.EnvironmentLight(np.ones(3)).radiance, tuple)
    assert mcrt.EnvironmentLight(np.ones((3, 3))).radiance.ndim == 2


@pytest.mark.parametrize("channels", [1, 3])
def test_results_with_maps_are_saved_and_merged(tmp_path, channels):
    texels = sky(channels=channels)
    a, b = (run(cloud(), texels, photons=2e4, seed=seed) for seed in range(2))
    merged = a + b
    merged.save(tmp_path / "map.npz")
    loaded = mcrt.Result.load(tmp_path / "map.npz")
    assert np.array_equal(loaded.image(), merged.image())
    assert np.array_equal(loaded.image(order=0), a.image(order=0))
    assert merged.stats.photons == 40000
    assert loaded.to_xarray()["image"].shape[:2] == (10, 12)
    with pytest.raises(mcrt.SceneError, match="lights differs"):
        a + run(cloud(), 2 * texels, photons=2e4, seed=2)


def test_the_threads_do_not_matter():
    one, two = (run(cloud(), sky(channels=3), photons=2e4, threads=n) for n in (1, 2))
    assert np.array_equal(one.fluence, two.fluence)
    assert np.array_equal(one.image(), two.image())


def test_a_dark_map_gives_a_dark_picture():
    for texels in (np.zeros((4, 8)), np.zeros((4, 8, 3))):
        result = run(cloud(), texels, photons=1000)
        for values in (result.image(), result.image(order=0), result.fluence, result.radiance):
            assert np.all(values == 0)
        assert np.all(result.energy.launched == 0)
        assert np.all(result.energy.sum() == 0)


def test_the_plan_names_the_map():
    text = str(mcrt.plan(cloud(), light=mcrt.EnvironmentLight(sky())))
    assert "EnvironmentLight (map)" in text
    assert "maps of the sky" in text
