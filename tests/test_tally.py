"""What tallies hold: weak channels, small deposits, voxels that no photon reached.

A channel of a light of the power w is the channel of power 1 times w, voxel by voxel: one walk
serves both, and only the rounding of sums may differ. What is compared so depends on no chance.
The others: 1e-5 per assertion (Bonferroni over voxels), 10 assertions.
"""

import comparing
import mcrt
import numpy as np
import pytest
from conftest import run

SHAPE = (6, 7, 8)
VIEW = mcrt.PerspectiveCamera((30, -20, 12), (4, 3.5, 3), fov=26, resolution=(8, 6))
WEAK = (1e-5, 3e-9, 1e-15, 1e-25)
# Deposits are some ten thousand units, of which one more or less may be rounded.
ROUNDING = 2e-5


def density():
    rng = np.random.default_rng(3)
    return (rng.random(SHAPE) * (rng.random(SHAPE) < 0.7)).astype(np.float32)


def sky(w):
    """A map of one pattern in all channels."""
    pattern = np.random.default_rng(4).random((4, 8, 1)) ** 4
    return (pattern * [1.0, w, 2 * w]).astype(np.float32)


def glow(w):
    pattern = np.random.default_rng(5).random((*SHAPE, 1)) ** 4
    return (pattern * [1.0, w, 2 * w]).astype(np.float32)


LIGHTS = {
    "first collisions": lambda w: {"light": mcrt.PointLight((-6, -9, 16), (1e3, 1e3 * w, 2e3 * w))},
    "inside": lambda w: {"light": mcrt.PointLight((3.1, 3.3, 2.2), (1, w, 2 * w))},
    "thick": lambda w: {
        "light": mcrt.DirectionalLight((0.2, 0.3, -1), (1, w, 2 * w)),
        "extinction": 4.0,
    },
    "beam": lambda w: {"light": mcrt.PencilBeam((3.2, 3.1, -3), (0.1, 0.2, 1), (1, w, 2 * w))},
    "environment": lambda w: {"light": mcrt.EnvironmentLight((1, w, 2 * w))},
    "map": lambda w: {"light": mcrt.EnvironmentLight(sky(w))},
    "emission": lambda w: {"light": (), "emission": glow(w)},
}


def shine(**options):
    defaults = {
        "volume": density(),
        "spacing": 1.0,
        "origin": (0.0, 0.0, 0.0),
        "extinction": 0.8,
        "camera": VIEW,
        "photons": 3000,
        "max_scatterings": None,
    }
    return run(**(defaults | options))


def assert_proportional(result, w, tolerance=ROUNDING):
    """The channels 1 and 2 are w and 2 w times channel 0."""

    def compare(values, what):
        values = np.asarray(values, float)
        scale = np.abs(values[..., 0])
        for channel, factor in ((1, w), (2, 2 * w)):
            np.testing.assert_allclose(
                values[..., channel] / factor,
                values[..., 0],
                rtol=tolerance,
                atol=tolerance * scale.mean(),
                err_msg=what,
            )

    for name in ("fluence", "fluence_error", "radiance", "radiance_error"):
        compare(getattr(result, name), name)
    compare(result.image(), "image")
    compare(result.image_error(), "image_error")
    energy = result.energy
    for name in ("missed", "unscattered", "absorbed", "truncated", "roulette"):
        part = np.asarray(getattr(energy, name), float)
        np.testing.assert_allclose(part, part[0], atol=1e-6, err_msg=name)


@pytest.mark.parametrize("simd", ["", "scalar"])
@pytest.mark.parametrize("kind", LIGHTS)
def test_a_weak_channel_is_the_strong_one_times_its_power(kind, simd, monkeypatch):
    if simd:
        monkeypatch.setenv("MCRT_SIMD", simd)
    for w in WEAK[:: 3 if simd else 1]:
        assert_proportional(shine(**LIGHTS[kind](w)), w)


@pytest.mark.parametrize("tracker", ["march", "woodcock"])
def test_a_weak_channel_of_unequal_extinctions_keeps_its_error(tracker):
    """The walk is one for all three; what a channel is drawn by does not depend on its power."""
    options = {"extinction": (0.8, 0.5, 0.6), "tracker": tracker}
    for position in ((-6, -9, 16), (3.1, 3.3, 2.2)):
        even = shine(light=mcrt.PointLight(position, (1.0, 1.0, 1.0)), **options)
        weak = shine(light=mcrt.PointLight(position, (1.0, 3e-9, 1e-25)), **options)
        power = np.array([1.0, 3e-9, 1e-25])
        bounds = {"rtol": ROUNDING, "atol": ROUNDING * even.fluence.mean()}
        np.testing.assert_allclose(weak.fluence / power, even.fluence, **bounds)


def test_what_only_a_weak_lamp_lights_has_its_share_of_photons():
    """Two lamps without a channel in common: the weak one's is as sure as the other's."""
    w = 1e-12
    lamps = [
        mcrt.PointLight((-6, -9, 16), (1e3, 0.0, 0.0)),
        mcrt.PointLight((16, -9, -6), (0.0, 0.0, 1e3 * w)),
    ]
    both = shine(light=lamps, photons=20_000)
    for channel, factor, position in ((0, 1.0, (-6, -9, 16)), (2, w, (16, -9, -6))):
        alone = shine(light=mcrt.PointLight(position, 1e3), photons=20_000, seed=9)
        comparing.assert_z(
            both.fluence[..., channel] / factor,
            alone.fluence,
            both.fluence_error[..., channel] / factor,
            alone.fluence_error,
            dof=comparing.dof(both),
            what=f"channel {channel}",
        )


def test_a_patch_of_sky_that_shines_in_a_weak_channel_alone_is_drawn():
    w = 1e-9
    sky = np.zeros((4, 8, 3), np.float32)
    sky[..., 0] = 1.0
    sky[0, 2, 2] = w
    grey = np.zeros((4, 8), np.float32)
    grey[0, 2] = 1.0
    both = shine(light=mcrt.EnvironmentLight(sky), photons=30_000)
    alone = shine(light=mcrt.EnvironmentLight(grey), photons=30_000, seed=9)
    comparing.assert_z(
        both.fluence[..., 2] / w,
        alone.fluence,
        both.fluence_error[..., 2] / w,
        alone.fluence_error,
        dof=comparing.dof(both),
    )


@pytest.mark.parametrize("simd", ["", "scalar"])
def test_small_albedos_keep_their_mean(simd, monkeypatch):
    """Light that is scattered once: albedo times that of albedo 1."""
    if simd:
        monkeypatch.setenv("MCRT_SIMD", simd)
    albedo = np.array([1.0, 1e-8, 1e-13])
    result = shine(albedo=tuple(albedo), max_scatterings=1, photons=100_000)
    escaped = sum(np.asarray(part) for part in result.energy.escaped.values()) / albedo
    assert escaped[1] == pytest.approx(escaped[0], rel=ROUNDING)
    # Single photons are 2^36 1e-13 = .007 units here, all together some hundreds: five errors.
    assert escaped[2] == pytest.approx(escaped[0], rel=0.4)
    # What is scattered is tallied in units of its own; order 0 is added where it is first read.
    error = result._data["fluence_error"] / albedo
    assert error[..., 0].all()
    np.testing.assert_allclose(error[..., 1:], error[..., :1].repeat(2, -1), rtol=ROUNDING)


@pytest.mark.parametrize("simd", ["", "scalar"])
@pytest.mark.parametrize("extinction", [1e6, 1e11])
def test_deposits_far_below_a_unit_keep_their_mean(extinction, simd, monkeypatch):
    """Where a free path is 1e-11 of a voxel a deposit is some 1e-4 of a unit.

    What emits and absorbs at once has the fluence 4 pi times emission over extinction.
    """
    if simd:
        monkeypatch.setenv("MCRT_SIMD", simd)
    result = shine(
        volume=np.ones((1, 1, 1), np.float32),
        extinction=extinction,
        albedo=0.0,
        light=(),
        emission=np.ones((1, 1, 1), np.float32),
        photons=200_000,
        outputs=("fluence",),
        camera=None,
    )
    comparing.assert_z(
        result.fluence,
        4 * np.pi / extinction,
        result.fluence_error,
        dof=comparing.dof(result),
        relative=1e-5,
    )


def dark_corner(**options):
    """A thick block that a beam enters from one side: few photons reach the other."""
    defaults = {
        "volume": np.ones((6, 6, 40), np.float32),
        "extinction": 1.0,
        "albedo": 0.5,
        "light": mcrt.PencilBeam((-1.0, 3.3, 3.2), (1, 0, 0), 1.0),
        "photons": 2000,
    }
    return shine(**(defaults | options))


def test_a_voxel_that_no_photon_reached_has_the_error_of_one():
    few = dark_corner()
    assert (few.fluence_error > 0).all()
    assert (few.radiance_error > 0).all()
    unreached = few._data["unreached"]
    count = int(unreached.sum())
    assert few.stats.unreached_voxels == count > 100
    # 4 power / (photons S) with the largest albedo, for scattered light alone is sampled.
    one = 4 * 0.5 / (few.stats.photons * 6.0)
    np.testing.assert_allclose(few.fluence_error[unreached], one, rtol=1e-6)
    np.testing.assert_allclose(few.radiance_error[unreached], 0.5 * one / (4 * np.pi), rtol=1e-6)
    # More photons tell what is there: nowhere more than the error said.
    many = dark_corner(photons=200_000, seed=3)
    assert many.stats.unreached_voxels < count
    assert (np.abs(many.fluence - few.fluence)[unreached] < 5 * one).all()


def test_merged_runs_know_what_neither_reached():
    a, b = dark_corner(), dark_corner(seed=1, photons=4000)
    both = a + b
    neither = a._data["unreached"] & b._data["unreached"]
    assert both.stats.unreached_voxels == neither.sum() < b.stats.unreached_voxels
    one = 4 * 0.5 / (6000 * 6.0)
    # One photon of all is `one` in either run, and they add up in quadrature.
    np.testing.assert_allclose(both.fluence_error[neither], np.sqrt(2) * one, rtol=1e-6)


def test_what_is_exact_has_no_error():
    for options in ({"albedo": 0.0}, {"max_scatterings": 0}):
        exact = dark_corner(**options)
        assert not exact.fluence_error.any()
        assert exact.stats.unreached_voxels == 0
    red = shine(light=mcrt.PointLight((-6, -9, 16), (1e3, 0.0, 0.0)))
    assert not red.fluence_error[..., 1:].any()
    assert red.fluence_error[..., 0].all()


def test_a_pixel_whose_sub_volumes_hold_nothing_has_the_error_of_one_photon():
    volume = np.zeros((6, 6, 40), np.float32)
    volume[..., :3] = volume[..., -3:] = 1.0
    result = dark_corner(
        volume=volume,
        camera=mcrt.OrthographicCamera((20, -20, 3), (20, 3, 3), width=44, resolution=(44, 8)),
        photons=100,
        extinction=0.02,
    )
    scattered, error = result.image(order="2+"), result.image_error()
    nothing = scattered == 0
    seen = result.alpha() > 1e-6
    assert (nothing & seen).any()
    assert (error[nothing & seen] > 0).all()
    assert not error[~seen].any()
    one = 4 * 0.5 / (100 * 6.0) * 0.5 / (4 * np.pi)
    np.testing.assert_allclose(
        error[nothing & seen], (result.alpha() * one)[nothing & seen], rtol=1e-6
    )
