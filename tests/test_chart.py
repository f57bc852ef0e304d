"""`python -m mcrt chart` measures and draws what it says."""

import functools
import sys

import mcrt
import numpy as np
import pytest
from conftest import camera, density
from mcrt import __main__ as command
from mcrt import chart

pytestmark = pytest.mark.cpu_only("a chart of the machine's speed")


def test_chart_draws_every_method(tmp_path, monkeypatch, capsys):
    path = tmp_path / "chart.png"
    small = functools.partial(
        chart.chart,
        side=14,
        resolution=16,
        photons=(1e3, 1e5),
        paths=(4, 400),
        reference_photons=3e5,
    )
    points = []
    monkeypatch.setattr(command, "chart", lambda *a, **k: points.extend(small(*a, **k)))
    monkeypatch.setattr(sys, "argv", ["mcrt", "chart", "--output", str(path)])
    assert command.main() == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert all(way in printed for way in ("single", "woodcock", "march", "path", str(path)))
    assert [point.method for point in points] == ["single"] + 4 * ["photon"] + 2 * ["path"]
    assert all(point.seconds > 0.0 for point in points)
    error = [point.error for point in points]
    # What single leaves out is large here; a hundred times the photons, a tenth of the noise.
    assert error[0] > 0.2
    assert error[2] < 0.5 * error[1]
    assert error[4] < 0.5 * error[3]
    assert error[6] < 0.3 * error[5]


@pytest.mark.parametrize("factor", [3, 5])
def test_finer_voxels_hold_the_same_field(factor):
    volume = density()
    fine = chart.finer(volume, factor)
    assert fine.shape == tuple(factor * n for n in volume.shape)
    middle = factor // 2
    centres = fine[middle::factor, middle::factor, middle::factor]
    np.testing.assert_allclose(centres, volume, atol=1e-6)
    options = {"extinction": 0.5, "camera": camera(), "light": mcrt.EnvironmentLight(1.0)}
    options |= {"method": "single", "origin": (10, -20, 30), "progress": False}
    alphas = [
        mcrt.simulate(v, spacing=h, **options).alpha()
        for v, h in ((volume, (1.5, 1.0, 0.5)), (fine, np.array((1.5, 1.0, 0.5)) / factor))
    ]
    np.testing.assert_allclose(*alphas, atol=1e-2)  # view rays are denser in finer voxels


def test_chart_without_matplotlib_says_so(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        chart.chart(tmp_path / "chart.png")
