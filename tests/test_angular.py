"""Spherical harmonics: one run serves every camera of an anisotropic medium.

False alarms: 1e-5 per assertion, about 30 assertions.
"""

import comparing
import mcrt
import numpy as np
import pytest

EYES = [(70, -30, 30), (-50, -20, 15), (10, 90, -40), (12, 11, -60)]
VIEWS = [mcrt.PerspectiveCamera(eye, (12, 11, 10), fov=35, resolution=(16, 16)) for eye in EYES]
SUN = mcrt.PointLight((-30, -40, 50), 1e4)


def volume():
    z, y, x = (np.linspace(-1, 1, n) for n in (20, 22, 24))
    ball = 1.2 - (x**2 + 1.3 * y[:, None] ** 2 + 0.9 * z[:, None, None] ** 2)
    return np.clip(ball, 0, 1).astype(np.float32)


def run(phase, **options):
    scene = {"extinction": 0.25, "albedo": 0.95, "light": SUN, "method": "photon", "photons": 1e5}
    return mcrt.simulate(volume(), phase=phase, **scene | options)


@pytest.mark.parametrize(
    ("phase", "light", "left_out"),
    [
        (mcrt.Rayleigh(), SUN, 0.0),
        (mcrt.HenyeyGreenstein(0.3), SUN, 0.002),
        (mcrt.HenyeyGreenstein(-0.5), SUN, 0.004),
        (mcrt.HenyeyGreenstein(0.4), mcrt.EnvironmentLight(1.0), 0.005),
        (mcrt.TabulatedPhase([-1, 0, 1], [1, 0.5, 3]), (1.0, 0.5, 0.2), 0.005),
    ],
    ids=["rayleigh", "forward", "backward", "environment", "rgb"],
)
def test_one_run_gives_the_images_of_runs_for_each_eye(phase, light, left_out):
    if isinstance(light, tuple):
        light = mcrt.PointLight((-30, -40, 50), [1e4 * c for c in light])
    one = run(phase, light=light, angular="sh", camera=VIEWS[0], seed=1)
    for seed, view in enumerate(VIEWS, 2):
        own = run(phase, light=light, camera=view, seed=seed, outputs=("image",))
        bright = own.image() > 0.05 * own.image().max()
        values = [r.image(view)[bright] for r in (one, own)]
        errors = [r.image_error(view)[bright] for r in (one, own)]
        dof = comparing.dof(own, "pixel")
        comparing.assert_z(*values, *errors, dof=dof, relative=1e-3 + 3 * left_out, what=view)


@pytest.mark.cpu_only("many short runs; the GPU's harmonics meet what its eye records, bit by bit")
@pytest.mark.parametrize(
    ("phase", "angular"),
    [(mcrt.Rayleigh(), "sh"), (mcrt.HenyeyGreenstein(0.5), 8)],
    ids=["rayleigh", "forward"],
)
def test_means_over_images_are_exact_where_nothing_is_left_out(phase, angular):
    """Rayleigh has no harmonics beyond order 2; beyond 8, g = .5 has 4e-6 of them."""
    options = {"photons": 2e4, "outputs": ("image",)}
    ones = [run(phase, angular=angular, camera=VIEWS[0], seed=s, **options) for s in range(24)]
    for number, view in enumerate(VIEWS[1:], 1):
        owns = [run(phase, camera=view, seed=100 * number + s, **options) for s in range(24)]
        sums = [[result.image(view, "2+").sum() for result in each] for each in (ones, owns)]
        comparing.assert_mean(np.divide(*sums), 1.0, what=view)


def test_the_voxels_radiance_is_that_towards_the_eye():
    one, own = (
        run(mcrt.Rayleigh(), angular=angular, camera=VIEWS[0], seed=seed)
        for seed, angular in enumerate(("sh", "auto"), 40)
    )
    dof = min(comparing.dof(one), comparing.dof(own))
    for what in ("fluence", "radiance"):
        a, b, ea, eb = (getattr(r, what + e) for e in ("", "_error") for r in (one, own))
        comparing.assert_z(a, b, ea, eb, dof=dof, relative=1e-3, what=what)


def test_a_beam_serves_every_camera():
    beam = mcrt.PencilBeam((12.3, 11.2, -5), (0, 0, 1), 1e3)
    phase = mcrt.HenyeyGreenstein(0.5)
    one = run(phase, light=beam, angular="sh", camera=VIEWS[0])
    for view in VIEWS[:3]:
        own = run(phase, light=beam, camera=view, outputs=("image",), seed=1)
        np.testing.assert_allclose(one.image(view, 1), own.image(view, 1), rtol=1e-4, atol=1e-9)


def test_harmonics_are_kept_saved_and_merged(tmp_path):
    phase = mcrt.HenyeyGreenstein(0.3)
    a, b = (run(phase, angular="sh", photons=2e4, seed=seed) for seed in (1, 2))
    a.save(tmp_path / "a.npz")
    loaded = mcrt.Result.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(loaded.image(VIEWS[2]), a.image(VIEWS[2]))
    np.testing.assert_array_equal(loaded.image_error(VIEWS[2]), a.image_error(VIEWS[2]))
    mean = 0.5 * (a.image(VIEWS[1]) + b.image(VIEWS[1]))
    np.testing.assert_allclose((a + b).image(VIEWS[1]), mean, rtol=1e-4, atol=1e-6 * mean.max())
    bare = run(phase, angular="sh", errors=False, outputs=("image",), seed=3)
    full = run(phase, angular="sh", seed=4)
    value, error = full.image(VIEWS[2]), full.image_error(VIEWS[2])
    comparing.assert_z(bare.image(VIEWS[2]), value, 1.5 * error, dof=comparing.dof(full, "pixel"))


def test_the_plan_picks_the_order_and_says_what_it_costs():
    def plan(phase, **options):
        return mcrt.plan(volume(), phase=phase, angular="sh", **options)

    orders = [
        int(str(plan(mcrt.HenyeyGreenstein(g))).split("harmonics of order ")[1].split(",")[0])
        for g in (0.1, 0.3, 0.6, 0.95)
    ]
    assert orders == sorted(orders)
    assert orders[0] < orders[2] < orders[3] == 8
    assert "order 2" in str(plan(mcrt.Rayleigh()))
    assert any("leave out" in warning for warning in plan(mcrt.HenyeyGreenstein(0.95)).warnings)
    assert not plan(mcrt.HenyeyGreenstein(0.3)).warnings
    coarse, fine = (plan(mcrt.HenyeyGreenstein(0.6), target_error=e) for e in (0.1, 1e-3))
    assert coarse.bytes < fine.bytes
    assert "isotropic" in str(plan(mcrt.Isotropic()))


def test_another_eye_without_harmonics_is_an_error_that_names_them():
    result = run(mcrt.HenyeyGreenstein(0.3), camera=VIEWS[0], photons=1e4)
    with pytest.raises(mcrt.SceneError, match='angular="sh"'):
        result.image(VIEWS[1])


@pytest.mark.parametrize("light", [SUN, mcrt.EnvironmentLight(1.0)], ids=["point", "environment"])
def test_harmonics_of_rayleigh_are_what_the_eye_records(light):
    """The same photons: of an eye far away both are sums of the same numbers, up to rounding."""
    far = mcrt.OrthographicCamera((70, -30, 30), (12, 11, 10), width=24, resolution=(8, 8))
    options = {"light": light, "camera": far, "photons": 3e4, "outputs": ("image",), "seed": 5}
    one, own = (run(mcrt.Rayleigh(), angular=angular, **options) for angular in ("sh", "auto"))
    for order in (1, "2+"):
        value, true = one.image(order=order), own.image(order=order)
        np.testing.assert_allclose(value, true, rtol=1e-3, atol=1e-4 * true.max())
