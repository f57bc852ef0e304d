"""White furnace: a constant environment of radiance 1 and no absorption give fluence 4 pi in every
voxel and radiance 1 along every ray, whatever the heterogeneity, the phase function and the
tracker.

False alarms: 1e-5 per assertion, about 90 assertions (Bonferroni over voxels and pixels, which
share photons). Path lengths: each run's mean over the volume is one sample of a Student's t test
over the independent runs.
"""

import itertools

import comparing
import mcrt
import numpy as np
import pytest
import truth
from conftest import cached, gappy

SHAPE, SPACING = (4, 5, 6), (1.1, 0.6, 0.8)
SIZE = np.multiply(SHAPE, SPACING)[::-1]
VIEW = truth.View((-6, -9, 8), (2.4, 1.5, 2.2), (12, 10), fov=40)
INSIDE = truth.View((1.3, 0.9, 2.2), (3.9, 2.0, 1.1), (8, 6), fov=70)


def cloud():
    """Optical depths up to about 10."""
    return gappy(SHAPE, 41)


def tabulated():
    """An asymmetric phase function with a forward and a backward lobe."""
    cosine = np.linspace(-1, 1, 41)
    values = 0.3 + np.exp(3 * (cosine - 1)) + 0.4 * cosine**4
    return mcrt.TabulatedPhase(cosine, values / (2 * np.pi * np.trapezoid(values, cosine)))


PHASES = {
    "isotropic": mcrt.Isotropic,
    "rayleigh": mcrt.Rayleigh,
    "hg0.8": lambda: mcrt.HenyeyGreenstein(0.8),
    "hg-0.5": lambda: mcrt.HenyeyGreenstein(-0.5),
    "tabulated": tabulated,
}
MEDIA = {
    "analytic": ("analytic", "nearest", lambda: np.ones(SHAPE, np.float32)),
    "woodcock": ("woodcock", "nearest", cloud),
    "woodcock-linear": ("woodcock", "linear", cloud),
    "march": ("march", "nearest", cloud),
    "march-linear": ("march", "linear", cloud),
}


@cached
def furnace(medium, phase, view=VIEW, extinction=2.0, photons=1.3e5, seed=None):
    tracker, interpolation, density = MEDIA[medium]
    return mcrt.simulate(
        density(),
        spacing=SPACING,
        interpolation=interpolation,
        extinction=extinction,
        albedo=1.0,
        phase=PHASES[phase](),
        light=mcrt.EnvironmentLight(1.0),
        camera=view.camera(),
        photons=photons,
        method="photon",
        tracker=tracker,
        seed=seed or 100 * sorted(MEDIA).index(medium) + sorted(PHASES).index(phase),
    )


def assert_unit_radiance(result, view):
    """The scattered light of every pixel makes up for what the background lost: image = alpha."""
    alpha, dof = result.alpha(view.camera()), comparing.dof(result, "pixel")
    image, error = result.image(view.camera()), result.image_error(view.camera())
    seen = alpha > 1e-3
    comparing.assert_z(image[seen], alpha[seen], error[seen], dof=dof, relative=1e-3, what="image")
    assert np.all(np.abs(image[~seen]) < 2e-3)
    np.testing.assert_allclose(result.image(view.camera(), order=0), 1 - alpha, atol=1e-5)
    assert np.median(error[seen] / alpha[seen]) < 0.05


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("medium", MEDIA)
def test_white_furnace_is_uniform(medium, phase):
    result = furnace(medium, phase)
    assert result.fluence.shape == SHAPE
    comparing.assert_z(
        result.fluence, 4 * np.pi, result.fluence_error, dof=comparing.dof(result), what="fluence"
    )
    assert np.median(result.fluence_error) < 0.03 * 4 * np.pi
    # radiance of a voxel = albedo * integral of P L = 1
    comparing.assert_z(
        result.radiance, 1, result.radiance_error, dof=comparing.dof(result), what="radiance"
    )
    assert result.energy.launched == pytest.approx(np.pi * truth.surface(SIZE), rel=1e-6)
    assert result.energy.absorbed == pytest.approx(0, abs=1e-6)
    comparing.assert_balance(result.energy)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("medium", MEDIA)
def test_white_furnace_radiance_is_one_along_every_ray(medium, phase):
    assert_unit_radiance(furnace(medium, phase), VIEW)


@pytest.mark.parametrize(
    ("medium", "phase"), [("woodcock-linear", "isotropic"), ("march", "hg0.8")]
)
def test_white_furnace_radiance_is_one_for_an_eye_inside(medium, phase):
    assert_unit_radiance(furnace(medium, phase, view=INSIDE), INSIDE)


@pytest.mark.cpu_only("many short runs; all runs together are the GPU's too")
@pytest.mark.parametrize("medium", MEDIA)
def test_mean_path_length_is_four_volumes_over_surface(medium):
    # integral of the fluence / entering power = mean path; independent runs, five or so for each
    # phase function
    power = np.pi * truth.surface(SIZE)
    phases = itertools.islice(itertools.cycle(PHASES), 24)
    runs = [furnace(medium, p, photons=1e4, seed=1000 + i) for i, p in enumerate(phases)]
    path = [run.fluence.sum(dtype=float) * np.prod(SPACING) / power for run in runs]
    comparing.assert_mean(path, truth.mean_chord(SIZE))


def test_mean_path_length_of_all_runs_is_four_volumes_over_surface():
    power = np.pi * truth.surface(SIZE)
    path = [
        furnace(m, p).fluence.sum(dtype=float) * np.prod(SPACING) / power
        for m in MEDIA
        for p in PHASES
    ]
    assert np.std(path, ddof=1) < 0.02 * truth.mean_chord(SIZE)
    comparing.assert_mean(path, truth.mean_chord(SIZE))


@pytest.mark.parametrize(
    ("medium", "phase"),
    [("woodcock", "hg0.8"), ("woodcock-linear", "isotropic"), ("march", "rayleigh")],
)
def test_white_furnace_is_uniform_in_every_channel_of_a_chromatic_medium(medium, phase):
    result = furnace(medium, phase, extinction=(0.5, 2.0, 6.0), photons=2.2e5)
    assert result.fluence.shape == (*SHAPE, 3)
    comparing.assert_z(
        result.fluence, 4 * np.pi, result.fluence_error, dof=comparing.dof(result), what="fluence"
    )
    assert np.median(result.fluence_error) < 0.05 * 4 * np.pi
    assert_unit_radiance(result, VIEW)
