"""Where the launched power goes. False alarms: 1e-5 per assertion, about 80 assertions.

Fractions carry the bound sqrt(p (1 - p) / N) as their standard error.
"""

import functools
import itertools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached, gappy
from scipy import stats

SHAPE, SPACING = (5, 6, 7), (1.0, 0.5, 0.7)
SIZE = np.multiply(SHAPE, SPACING)[::-1]  # 4.9, 3, 5
VIEW = truth.View((12, -6, 3), (2.4, 1.5, 2.6), (16, 12), fov=30)
FACES = ("-x", "+x", "-y", "+y", "-z", "+z")
POINT = (-2.0, 7.0, 9.0)
INNER = (1.0, 2.0, 3.0)
SLANT = (-0.4, 0.5, -0.8)
RAYS = pytest.mark.cpu_only("light rays are the host's")


def cloud():
    return gappy(SHAPE, 81)


def run(density=None, photons=1e5, **options):
    scene = {
        "spacing": SPACING,
        "extinction": 1.5,
        "albedo": 0.8,
        "phase": mcrt.HenyeyGreenstein(0.5),
        "method": "photon",
    }
    scene |= {"light": mcrt.PointLight(POINT, 100.0), "camera": VIEW.camera(), "seed": 82}
    return mcrt.simulate(
        cloud() if density is None else density, photons=photons, **scene | options
    )


LIGHTS = {
    "point": (lambda: mcrt.PointLight(POINT, 2.0), 8 * np.pi),
    "point inside": (lambda: mcrt.PointLight(INNER, 2.0), 8 * np.pi),
    "beam": (lambda: mcrt.PencilBeam((-1, 1.1, 2.2), (1, 0.1, 0.2), 3.0), 3.0),
    "directional": (
        lambda: mcrt.DirectionalLight(SLANT, 2.0),
        2 * truth.projected_area(SLANT, SIZE),
    ),
    "environment": (lambda: mcrt.EnvironmentLight(0.5), 0.5 * np.pi * truth.surface(SIZE)),
}


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("max_scatterings", [None, 3])
@pytest.mark.parametrize("kind", LIGHTS)
def test_energy_of_each_light_adds_up(kind, max_scatterings, interpolation):
    light, launched = LIGHTS[kind]
    energy = run(light=light(), max_scatterings=max_scatterings, interpolation=interpolation).energy
    assert energy.launched == pytest.approx(launched, rel=1e-7)
    assert set(energy.escaped) == set(FACES)
    comparing.assert_balance(energy)
    assert 0 <= energy.error < 1e-6  # every photon weighs the same
    assert all(
        v >= 0
        for v in (
            energy.missed,
            energy.unscattered,
            energy.absorbed,
            energy.truncated,
            *energy.escaped.values(),
        )
    )
    assert (energy.truncated > 1e-4) == (max_scatterings is not None)
    assert max_scatterings is None or energy.roulette == 0
    missed = 1 - truth.solid_angle(POINT, SIZE) / (4 * np.pi) if kind == "point" else 0.0
    # Stratified over a cone about the box: it scatters by 2.4e-5 from seed to seed.
    assert energy.missed == pytest.approx(missed, abs=1.2e-4)


@pytest.mark.parametrize("kind", ["point", "environment"])
def test_energy_of_each_channel_adds_up(kind):
    colour = np.array([1.0, 0.5, 4.0])
    if kind == "point":
        light, launched = mcrt.PointLight(POINT, colour), 4 * np.pi * colour
    else:
        light, launched = mcrt.EnvironmentLight(colour), np.pi * truth.surface(SIZE) * colour
    energy = run(light=light, extinction=(0.5, 1.5, 5.0), albedo=(0.9, 0.5, 0.99)).energy
    np.testing.assert_allclose(energy.launched, launched, rtol=1e-7)
    assert energy.absorbed.shape == (3,)
    comparing.assert_balance(energy)
    assert np.all(np.asarray(energy.error) < 0.006)


def test_light_that_misses_is_missed():
    away = mcrt.PencilBeam((-1, 1, 1), (-1, 0, 0), 3.0)
    result = run(light=away)
    assert result.energy.missed == pytest.approx(1, abs=1e-6)
    assert comparing.energy_sum(result.energy) == pytest.approx(1, abs=1e-6)
    assert np.all(result.fluence == 0)
    assert np.all(result.image() == 0)


def test_vacuum_scatters_nothing():
    result = run(
        np.zeros(SHAPE, np.float32), light=mcrt.PencilBeam((-1, 1.1, 2.2), (1, 0.1, 0.2), 3.0)
    )
    assert result.energy.unscattered == pytest.approx(1, abs=1e-6)
    true = 3 * truth.ray_fluence(np.zeros(SHAPE), SPACING, (-1, 1.1, 2.2), (1, 0.1, 0.2))
    assert np.all(result.fluence_error == 0)
    np.testing.assert_allclose(result.fluence, true, rtol=1e-6, atol=1e-6 * true.max())


def test_lights_add_up():
    names = ("point", "directional", "environment")
    lights = [LIGHTS[name][0]() for name in names]
    photons = 2e5
    alone = [run(light=light, photons=photons, seed=83 + i) for i, light in enumerate(lights)]
    together = run(light=lights, photons=3 * photons, seed=86)
    # Welch and Satterthwaite, the least of all voxels.
    squares = np.array([np.square(r.fluence_error, dtype=float) for r in (together, *alone)])
    dofs = np.array([comparing.dof(r) for r in (together, *alone)])[:, None, None, None]
    comparing.assert_z(
        together.fluence,
        sum(r.fluence.astype(float) for r in alone),
        together.fluence_error,
        np.sqrt(squares[1:].sum(0)),
        dof=(squares.sum(0) ** 2 / (squares**2 / dofs).sum(0)).min(),
    )
    launched = sum(LIGHTS[name][1] for name in names)
    assert together.energy.launched == pytest.approx(launched, rel=1e-7)
    absorbed = sum(r.energy.absorbed * r.energy.launched for r in alone) / launched
    error = [r.energy.absorbed_error * r.energy.launched / launched for r in alone]
    comparing.assert_z(
        together.energy.absorbed,
        absorbed,
        together.energy.absorbed_error,
        np.linalg.norm(error),
        dof=7,  # of 8 batches, or 8 lattices of rays
    )


@pytest.mark.parametrize("face", FACES)
def test_light_scattered_forward_escapes_by_the_face_ahead(face):
    axis, sign = "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0
    direction, position = np.zeros(3), SIZE / 2 + 0.01
    direction[axis], position[axis] = sign, -9.0 if sign > 0 else 19.0
    result = run(
        np.ones(SHAPE, np.float32),
        light=mcrt.PencilBeam(tuple(position), tuple(direction), 1.0),
        phase=mcrt.HenyeyGreenstein(1 - 1e-6),
        albedo=1.0,
        outputs=["fluence"],
    )
    unscattered = np.exp(-1.5 * SIZE[axis])
    comparing.assert_z(
        result.energy.unscattered, unscattered, comparing.fraction_error(unscattered, 1e5)
    )
    # Of a million scatterings one is by a radian, and ten are by a tenth.
    assert result.energy.escaped[face] == pytest.approx(1 - result.energy.unscattered, abs=1e-4)


def test_more_light_escapes_by_the_face_with_less_medium_before_it():
    # Symmetric about the light but for the density: mirrored volumes exchange -x and +x.
    density = np.full(SHAPE, 0.3, np.float32)
    density[:, :, 4:] = 3.0
    light = mcrt.PointLight(tuple(SIZE / 2), 1.0)
    phase = mcrt.Isotropic()
    a, b = (
        run(d, light=light, phase=phase, seed=s).energy
        for d, s in ((density, 87), (density[:, :, ::-1], 88))
    )
    assert a.escaped["-x"] > 2 * a.escaped["+x"]
    for one, other in (
        ("-x", "+x"),
        ("+x", "-x"),
        ("-y", "-y"),
        ("+y", "-y"),
        ("-z", "+z"),
        ("+z", "+z"),
    ):
        error = comparing.fraction_error(a.escaped[one], 1e5)
        comparing.assert_z(b.escaped[other], a.escaped[one], error, error, what=one)


# ---- orders


@cached
def capped(n):
    return run(photons=2e5, max_scatterings=n, phase=mcrt.Isotropic(), seed=89)


def test_no_scattering_leaves_order_0():
    energy, result = capped(0).energy, capped(0)
    true = truth.fluence_of_order_0(
        truth.Point(POINT, 100.0), 1.5 * cloud().astype(float), SPACING, True
    )
    # The noise of light rays is .3 %.
    assert comparing.relative_rms(result.fluence, true) < 0.006
    assert np.all(result.image() == 0)
    assert np.all(result.radiance == 0)
    assert sum(energy.escaped.values()) == pytest.approx(0, abs=1e-6)
    # 1 - albedo of the first collisions is absorbed, the rest truncated
    assert energy.truncated == pytest.approx(4 * energy.absorbed, rel=1e-6)


def test_radiance_of_one_scattering_is_albedo_times_fluence_of_order_0():
    # Of the same rays: but for single precision.
    np.testing.assert_allclose(capped(1).radiance, 0.8 / (4 * np.pi) * capped(0).fluence, rtol=1e-6)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_radiance_holds_one_order_more_than_fluence_of_isotropic_scattering(n):
    # orders 1..n of the radiance come from incident orders 0..n-1
    a, b = capped(n), run(photons=2e5, max_scatterings=n - 1, phase=mcrt.Isotropic(), seed=90)
    factor = 0.8 / (4 * np.pi)
    errors = a.radiance_error.astype(float), factor * b.fluence_error.astype(float)
    # Welch and Satterthwaite, the least of all voxels.
    dof = sum(e**2 for e in errors) ** 2
    dof /= sum(e**4 / comparing.dof(r) for e, r in zip(errors, (a, b), strict=True))
    comparing.assert_z(a.radiance, factor * b.fluence, *errors, dof=dof.min())


def test_orders_grow_to_the_uncapped_answer():
    runs = [capped(n) for n in (0, 1, 2, 5, None)]
    totals = [r.fluence.sum(dtype=float) for r in runs]
    assert all(low < high for low, high in itertools.pairwise(totals))
    cut = [r.energy.truncated for r in runs]
    assert all(high > low for high, low in itertools.pairwise(cut))
    assert cut[-1] == 0
    images = [r.image().sum(dtype=float) for r in runs]
    assert all(low < high for low, high in itertools.pairwise(images))


def test_capped_forward_scattering_truncates_the_poisson_tail():
    # A beam through tau 3 with all scattering forward, albedo 0.8: weight 0.8^(n+1) times P(more
    # than n collisions).
    n, tau, photons = 2, 3.0, 4e5
    energy = run(
        np.ones((6, 1, 1), np.float32),
        photons,
        spacing=(tau / 6, 1e4, 1e4),
        extinction=1.0,
        light=mcrt.PencilBeam((5e3, 5e3, -1), (0, 0, 1), 1.0),
        phase=mcrt.HenyeyGreenstein(1 - 1e-6),
        max_scatterings=n,
        outputs=["fluence"],
        camera=None,
    ).energy
    truncated = 0.8 ** (n + 1) * stats.poisson.sf(n, tau)
    escaped = sum(stats.poisson.pmf(k, tau) * 0.8**k for k in (1, 2))
    comparing.assert_z(
        energy.truncated, truncated, comparing.fraction_error(truncated, photons), what="truncated"
    )
    comparing.assert_z(
        energy.escaped["+z"], escaped, comparing.fraction_error(escaped, photons), what="escaped"
    )
    absorbed = 1 - truncated - escaped - np.exp(-tau)
    comparing.assert_z(
        energy.absorbed, absorbed, comparing.fraction_error(absorbed, photons), what="absorbed"
    )


@pytest.mark.parametrize("n", [1, 2, None])
def test_orders_of_the_image_add_up(n):
    result = capped(n)
    total, first, rest = result.image(), result.image(order=1), result.image(order="2+")
    np.testing.assert_allclose(first + rest, total, rtol=1e-5, atol=1e-7 * total.max())
    np.testing.assert_allclose(first, capped(1).image(), rtol=1e-5, atol=1e-7 * total.max())
    assert np.all(rest == 0) == (n == 1)


def test_absorbed_density_integrates_to_the_absorbed_energy():
    result = run(photons=4e5, interpolation="nearest")
    total = np.asarray(result.absorbed, float).sum() * np.prod(SPACING) / result.energy.launched
    comparing.assert_z(
        total,
        result.energy.absorbed,
        result.energy.absorbed_error,
        dof=7,  # of 8 lattices of rays, which find order 0 in voxels
    )
    np.testing.assert_allclose(result.absorbed, 0.2 * 1.5 * cloud() * result.fluence, rtol=1e-6)


def haze():
    return np.random.default_rng(7).random(SHAPE, dtype=np.float32)


@functools.cache
def columns(kind, linear):
    """Column densities through the box of what is launched into it, and the share of each."""
    rng, size, density = np.random.default_rng(6), np.asarray(SIZE), haze()
    if kind == "beam":
        start, along = np.array([0.9, 0.5, -1.0]), np.array([0.1, 0.2, 1.0])
        start, along = start[None], along[None] / np.linalg.norm(along)
        weight = np.ones(1)
    elif kind == "directional":
        # The face that it meets at a right angle, in equal parts of all voxels.
        place = (np.indices((42, 42)).reshape(2, -1).T + 0.5) / 42 * size[:2]
        start = np.column_stack([place, np.full(len(place), size[2])])
        along, weight = np.array([[0.0, 0.0, -1.0]]), np.full(len(place), 1 / len(place))
    else:
        # The cone around the box, or all directions, in parts with a random one in each.
        start = np.array([POINT if kind == "point" else INNER], float)
        axis = 0.5 * size - start[0]
        axis = axis / np.linalg.norm(axis)
        corners = np.array(list(itertools.product((0, 1), repeat=3))) * size - start
        least = ((corners @ axis) / np.linalg.norm(corners, axis=1)).min()
        least = least if kind == "point" else -1.0
        cells = np.indices((90, 180)).reshape(2, -1).T
        cosine, turn = ((cells + rng.random(cells.shape)) / (90, 180)).T
        cosine, turn = least + (1 - least) * cosine, 2 * np.pi * turn
        side = np.cross(axis, (0.0, 0.0, 1.0))
        side /= np.linalg.norm(side)
        sine, other = np.sqrt(1 - cosine**2), np.cross(axis, side)
        round_ = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
        along = cosine[:, None] * axis + sine[:, None] * round_
        weight = np.full(len(along), 0.5 * (1 - least) / len(along))
    start, along = np.broadcast_arrays(start, along)
    near, far = truth.box_interval(start, along, SIZE)
    near, hit = np.maximum(near, 0), far > np.maximum(near, 0)
    ends = (start + t[:, None] * along for t in (near, np.where(hit, far, near)))
    return truth.optical_depth(density, SPACING, *ends, linear), np.where(hit, weight, 0)


@pytest.mark.parametrize("orders", [None, pytest.param(0, marks=RAYS)], ids=["photons", "rays"])
@pytest.mark.parametrize(
    ("kind", "interpolation"),
    [("beam", "linear"), ("directional", "linear"), ("point", "nearest"), ("inner", "nearest")],
)
def test_what_passes_unscattered_is_what_beer_and_lambert_let_through(kind, orders, interpolation):
    """Thin voxels, whose photons start at first collisions, and thick ones, where at the light.

    The truth is a sum over some 10,000 rays: .2 % off for a lamp, and .06 % for a sun. That of a
    beam is exact but for single precision.
    """
    relative = {"beam": 1e-6, "directional": 1e-3}.get(kind, 4e-3)
    lights = {
        "beam": mcrt.PencilBeam((0.9, 0.5, -1.0), (0.1, 0.2, 1.0), 3.0),
        "directional": mcrt.DirectionalLight((0, 0, -1), 2.0),
        "point": mcrt.PointLight(POINT, 5.0),
        "inner": mcrt.PointLight(INNER, 5.0),
    }
    for extinction in (0.3, 2.5):
        energy = run(
            haze(),
            light=lights[kind],
            extinction=extinction,
            max_scatterings=orders,
            interpolation=interpolation,
            outputs=("fluence",),
        ).energy
        column, weight = columns(kind, interpolation == "linear")
        true = (weight * np.exp(-extinction * column)).sum()
        # Of 8 lattices of rays, or of single photons: both bound it.
        bound = comparing.limit(2, 7) * energy.unscattered_error
        bound = min(bound, comparing.limit(2) * comparing.fraction_error(true, 1e5))
        assert abs(energy.unscattered - true) < bound + relative * true, extinction


def test_photons_at_first_collisions_of_a_lamp_hold_its_power():
    """Their weights, too: each is what arrives where it starts."""
    options = {"light": mcrt.PointLight(POINT, 5.0), "extinction": 0.3}
    result = run(haze(), **options)
    assert "photons start at their first collision" in str(result.plan).replace("\n", " ")
    comparing.assert_balance(result.energy)
    assert result.energy.error < 2e-5


@pytest.mark.cpu_only("found on the host whatever the backend")
@pytest.mark.parametrize("method", ["single", "photon"])
def test_parts_of_the_energy_scatter_as_their_errors_say(method):
    """Of light rays the sum is 1 whatever they meet: the parts have errors of their own."""
    rng = np.random.default_rng(4)
    spikes = np.where(rng.random((6, 7, 8)) < 0.1, 30.0, 0.0)
    albedo = rng.random(spikes.shape)
    runs = [
        mcrt.simulate(
            spikes,
            albedo=albedo,
            light=mcrt.PointLight((3.0, 9.0, 12.0), 50.0),
            method=method,
            max_scatterings=3,
            photons=None if method == "single" else 3000,
            # Rays take 7 times as long in linear voxels, and add up in the same way.
            interpolation="nearest" if method == "single" else "linear",
            outputs=("fluence",),
            backend="cpu",
            seed=seed,
        ).energy
        for seed in range(160)
    ]
    for part in ("unscattered", "absorbed"):
        values = np.array([run[part] for run in runs])
        claimed = np.array([run[part + "_error"] for run in runs]) ** 2
        off = (values - values.mean()) ** 2 * len(runs) / (len(runs) - 1)
        assert values.std() > 0
        comparing.assert_mean(off / claimed.mean() - claimed / claimed.mean() + 1, 1.0)
