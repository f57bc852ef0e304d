"""Pictures of voxels thicker than a mean free path, against Chandrasekhar's half space.

The middle of a wide slab, seen from straight above under a sun at mu0, has the radiance
a / (4 pi) mu0 / (1 + mu0) H(1) H(mu0). What photons leave in such voxels makes it too dark: `auto`
leaves them, or the run says by how much.
"""

import re

import closed_forms
import comparing
import mcrt
import numpy as np
import pytest

pytestmark = pytest.mark.cpu_only("the bias is told by paths on the host")

VISIBLE = 0.02


def half_space(tau, mu0, albedo):
    """A slab 12 mean free paths deep and twice as wide at least, and the arguments of a run."""
    n = max(3, int(np.ceil(12 / tau)))
    middle = n + 0.5
    return np.ones((n, 2 * n + 1, 2 * n + 1), np.float32), {
        "extinction": tau,
        "albedo": albedo,
        "interpolation": "nearest",
        "light": mcrt.DirectionalLight((np.sqrt(1 - mu0**2), 0, -mu0), 1.0),
        "camera": mcrt.OrthographicCamera(
            (middle, middle, n + 5.0), (middle, middle, 0), (0, 1, 0), 1.0, (4, 4)
        ),
        "progress": False,
    }


def radiance(mu0, albedo):
    h, h0 = closed_forms.h_function(albedo, np.array([1.0, mu0]))
    return albedo / (4 * np.pi) * mu0 / (1 + mu0) * h * h0


def told(result):
    """The bias that the run tells, 0 if none."""
    pattern = r"bias of the voxels' size is (\S+): the picture"
    found = [re.search(pattern, text) for text in result.warnings]
    return max((float(match[1]) for match in found if match), default=0.0)


def _cases():
    for mu0, albedo in [(1.0, 0.7), (0.5, 0.7), (1.0, 0.95), (0.5, 0.95)]:
        for tau in (1, 2, 5, 10, 20, 50, 100):
            yield tau, mu0, albedo


CASES = list(_cases())


@pytest.mark.cpu_only("a bias of the method, whatever runs it")
@pytest.mark.parametrize(("tau", "mu0", "albedo"), CASES)
def test_a_dense_picture_of_photons_tells_its_bias(tau, mu0, albedo):
    volume, arguments = half_space(tau, mu0, albedo)
    result = mcrt.simulate(volume, method="photon", photons=1e5, outputs=("image",), **arguments)
    true, value = radiance(mu0, albedo), result.image().mean(dtype=float)
    bias, error = abs(1 - value / true), result.image_error().mean() / true
    said = told(result)
    print(f"tau {tau}: bias {bias:.3f} +- {error:.3f}, told {said:.3f}")
    # Of the same picture: the paths that it is held against have 1 % of noise, three of which are
    # allowed. A bias is told from 2 % on.
    noise = 3 * 0.01
    assert abs(said - bias) < noise or (not said and bias < VISIBLE + noise)
    if said and bias > VISIBLE + noise:
        assert ("too dark" in " ".join(result.warnings)) == (value < true)


@pytest.mark.cpu_only("a bias of the method, whatever runs it")
@pytest.mark.parametrize(
    ("tau", "mu0", "albedo"), [(5, 1.0, 0.7), (10, 0.5, 0.95), (20, 1.0, 0.95)]
)
def test_the_bias_told_is_the_true_one_on_average(tau, mu0, albedo):
    volume, arguments = half_space(tau, mu0, albedo)
    options = arguments | {"method": "photon", "photons": 1e5, "outputs": ("image",)}
    runs = [mcrt.simulate(volume, seed=seed, **options) for seed in range(8)]
    image = np.mean([run.image().mean(dtype=float) for run in runs])
    off = np.mean(np.log([told(run) for run in runs])) - np.log(1 - image / radiance(mu0, albedo))
    print(f"mean of log(told bias / true bias): {off:.3f}")
    assert abs(off) < 0.1


@pytest.mark.parametrize(
    ("tau", "mu0", "albedo"), [(5, 1.0, 0.7), (20, 0.5, 0.7), (100, 0.5, 0.95)]
)
def test_a_dense_picture_alone_is_made_by_paths(tau, mu0, albedo):
    volume, arguments = half_space(tau, mu0, albedo)
    result = mcrt.simulate(volume, outputs=("image",), target_error=0.05, **arguments)
    assert result.plan.method == "path"
    assert not told(result)
    image, error = result.image(), np.sqrt((result.image_error() ** 2).mean() / 16)
    comparing.assert_z(image.mean(dtype=float), radiance(mu0, albedo), error)


def test_auto_takes_paths_for_dense_pictures_only():
    def method(tau, **options):
        volume, arguments = half_space(tau, 0.5, 0.7)
        return mcrt.plan(volume, **(arguments | {"outputs": ("image",)} | options)).method

    assert method(1.2) == "photon"
    assert method(1.4) == "path"
    assert method(1.4, target_error=0.1) == "photon"
    assert method(5, photons=1000) == "photon"
    assert method(5, outputs=("image", "fluence")) == "photon"
    assert method(5, angular="sh", phase=mcrt.HenyeyGreenstein(0.5)) == "photon"
    assert method(5, max_scatterings=1) == "photon"
    middle = mcrt.PencilBeam((3.5, 3.5, 9.0), (0, 0, -1), 1.0)
    assert method(5, light=middle) == "photon"


def test_the_target_counts_the_bias_of_dense_voxels():
    volume, arguments = half_space(5, 0.5, 0.7)
    result = mcrt.simulate(volume, method="photon", target_error=0.05, **arguments)
    assert any("out of reach" in text for text in result.warnings)
    assert told(result) > 0.1


def test_bytes_taken_as_they_are_give_a_word():
    z, y, x = np.indices((12, 12, 12)) - 5.5
    volume = np.where(x * x + y * y + z * z < 25, 255, 0).astype(np.uint8)
    result = mcrt.simulate(volume, photons=1e5, progress=False)
    camera = mcrt.PerspectiveCamera(
        result.camera.origin, result.camera.target, fov=result.camera.fov, resolution=(8, 8)
    )
    paths = mcrt.simulate(volume, method="path", spp=512, camera=camera, progress=False)
    image, true = result.image(camera).astype(float), paths.image().astype(float)
    seen = true > 0.05 * true.max()
    noise = np.hypot(result.image_error(camera), paths.image_error())
    bias = np.sqrt(np.mean(((image - true) ** 2 - noise**2)[seen])) / true[seen].mean()
    print(f"bias {bias:.3f}, told {told(result):.3f}")
    # The paths that tell it have 4 % of noise of their own.
    assert abs(np.log(told(result) / bias)) < 0.2
    assert "too dark" in " ".join(result.warnings)


def test_thin_voxels_are_not_held_against_paths():
    volume, arguments = half_space(0.5, 0.5, 0.7)
    thin, dense = (mcrt.plan(volume, **(arguments | {"extinction": tau})) for tau in (0.5, 3.0))
    assert "held against paths" not in str(thin)
    assert "held against paths" in str(dense)
