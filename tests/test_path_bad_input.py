"""Paths from the camera: what is refused, and in what words."""

import mcrt
import numpy as np
import pytest
from conftest import CENTRE, ORIGIN, camera, density
from test_path_api import LIGHT, run

NAN, INF = float("nan"), float("inf")

BALL = mcrt.Medium.sphere(2, center=CENTRE)
BOX = mcrt.Medium.box((3, 5, 6), origin=ORIGIN)


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"light": mcrt.PencilBeam((0, 0, 0), (1, 0, 0))}, 'PencilBeam.*method = "photon"'),
        ({"light": [LIGHT, mcrt.PencilBeam((0, 0, 0), (1, 0, 0))]}, 'PencilBeam.*"photon"'),
        ({"outputs": ("fluence",)}, 'images only.*"photon"'),
        ({"outputs": ("image", "radiance")}, 'images only.*"photon"'),
        ({"photons": 1000}, "photons"),
        ({"photons": 1000, "spp": None}, "photons"),
        ({"method": "photon"}, "spp"),
        ({"method": "single"}, "spp"),
        ({"spp": 0}, "spp must be an integral number from 1 to 1,000,000,000"),
        ({"spp": -4}, "spp must be"),
        ({"spp": 1.5}, "spp must be"),
        ({"spp": 1e10}, "spp must be"),
        ({"spp": NAN}, "spp must be"),
        ({"spp": INF}, "spp must be"),
        ({"spp": True}, "spp must be"),
        ({"spp": "16"}, "spp must be"),
        ({"spp": [16]}, "spp must be"),
        ({"spp": None, "target_error": NAN}, "target_error"),
        ({"volume": BALL, "method": "photon", "spp": None}, 'sphere has none.*"path"'),
        ({"volume": BALL, "method": "single", "spp": None}, 'sphere has none.*"path"'),
        ({"volume": BALL, "tracker": "march"}, 'march.*sphere.*"analytic"'),
        ({"volume": BALL, "outputs": ("fluence",)}, "voxel|images only"),
        ({"volume": BALL, "extinction": 2.0}, "extinction given both"),
        ({"volume": BALL, "spacing": 2.0}, "spacing given both"),
        (
            {
                "volume": BOX,
                "method": "photon",
                "spp": None,
                "photons": 100,
                "outputs": ("image",),
            },
            'method="path" for its image',
        ),
        ({"tracker": "analytic"}, "analytic"),
    ],
    ids=str,
)
def test_bad_arguments_are_scene_errors(arguments, message):
    for call in (mcrt.plan, mcrt.simulate):
        given = {"volume": density(), "light": LIGHT, "spp": 16, "method": "path"} | arguments
        with pytest.raises(mcrt.SceneError, match=message):
            call(given.pop("volume"), **given)


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize("value", [NAN, INF, -1.0])
def test_bad_maps_are_scene_errors(value):
    sky = np.ones((4, 8))
    sky[2, 5] = value
    with pytest.raises(mcrt.SceneError, match=r"[\[(]2, 5[\])]"):
        run(light=mcrt.EnvironmentLight(sky))


@pytest.mark.cpu_only("arguments are checked before any backend")
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mcrt.Medium.box(0.0), "size must be a positive number"),
        (lambda: mcrt.Medium.box(-1.0), "size"),
        (lambda: mcrt.Medium.box(NAN), "size"),
        (lambda: mcrt.Medium.box(INF), "size|spacing|finite"),
        (lambda: mcrt.Medium.box((1, 2)), "size"),
        (lambda: mcrt.Medium.box((1, 2, 0)), "size"),
        (lambda: mcrt.Medium.box("1"), "size"),
        (lambda: mcrt.Medium.box(1, origin=(0, 0)), "origin"),
        (lambda: mcrt.Medium.box(1, spacing=1), "spacing is not for a box"),
        (lambda: mcrt.Medium.box(1, density=1), "density is not for a box"),
        (lambda: mcrt.Medium.box(1, albedo=1.5), "albedo"),
        (lambda: mcrt.Medium.box(1, albedo=np.full((2, 2, 2), 0.5)), "albedo"),
        (lambda: mcrt.Medium.box(1, extinction=-1.0), "extinction"),
        (lambda: mcrt.Medium.sphere(0.0), "radius must be"),
        (lambda: mcrt.Medium.sphere(-1.0), "radius"),
        (lambda: mcrt.Medium.sphere(NAN), "radius"),
        (lambda: mcrt.Medium.sphere(INF), "radius"),
        (lambda: mcrt.Medium.sphere("1"), "radius"),
        (lambda: mcrt.Medium.sphere(1, center=(0, NAN, 0)), "center|origin"),
        (lambda: mcrt.Medium.sphere(1, center=3), "center"),
        (lambda: mcrt.Medium.sphere(1, interpolation="linear"), "not for a sphere"),
        (lambda: mcrt.Medium.sphere(1, emission=-1.0), "emission"),
    ],
)
def test_bad_solids_are_scene_errors(make, message):
    with pytest.raises(mcrt.SceneError, match=message):
        run(make())


def test_a_path_result_holds_one_image_only():
    result = run()
    other = camera(eye=(-25.0, -5.0, 40.0))
    for name in ("fluence", "radiance", "absorbed", "fluence_error", "radiance_error"):
        with pytest.raises(mcrt.SceneError, match=r'images only.*method="photon"'):
            getattr(result, name)
    for call in (result.image, result.image_error, result.alpha):
        with pytest.raises(mcrt.SceneError, match="own camera only"):
            call(other)
        assert call(camera()).shape == (10, 14)
    with pytest.raises(mcrt.SceneError, match="order"):
        result.image(order=2)
    with pytest.raises(mcrt.SceneError):
        _ = result.energy
    with pytest.raises(mcrt.SceneError, match="errors"):
        run(errors=False).image_error()
    np.testing.assert_array_equal(run(errors=False).image(), result.image())
