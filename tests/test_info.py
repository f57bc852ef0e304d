"""What the package says of the machine, with and without GPU adapters."""

import glob
import os
import subprocess
import sys

import mcrt
import pytest
from conftest import require
from mcrt import _info

pytestmark = pytest.mark.cpu_only("looks for adapters, with drivers of its own")

LAVAPIPE = glob.glob("/usr/share/vulkan/icd.d/lvp_icd.*.json")


@pytest.fixture
def lavapipe():
    """Drivers by which the processor plays a GPU."""
    require(LAVAPIPE, "mesa-vulkan-drivers is not installed; make vulkan installs it")
    return LAVAPIPE[0]


def python(*arguments, drivers):
    """Standard output of Python where Vulkan sees these drivers alone."""
    environment = os.environ | {"VK_DRIVER_FILES": drivers, "VK_ICD_FILENAMES": drivers}
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, env=environment
    ).stdout


def test_info_without_adapters():
    shown = python("-m", "mcrt", "info", drivers="/nonexistent")
    assert mcrt.__version__ in shown
    assert '"auto" takes the CPU, for there is no adapter' in shown
    assert '"gpu" takes nothing' in shown
    assert "formulas" not in shown


def test_info_with_a_processor_that_plays_a_gpu(lavapipe):
    shown = python("-m", "mcrt", "info", drivers=lavapipe)
    assert "llvmpipe" in shown
    assert "software; vulkan" in shown
    assert '"auto" takes the CPU, for the adapter is only a processor' in shown
    assert '"gpu" takes llvmpipe' in shown
    assert "functions agree with the CPU" in shown


def test_import_touches_no_gpu(lavapipe):
    loaded = "'libvulkan' in open('/proc/self/maps').read()"
    script = f"import mcrt; assert not {loaded}; mcrt._mcrt.probe(); assert {loaded}"
    python("-c", script, drivers=lavapipe)


ADAPTER = {
    "name": "Fast GPU",
    "kind": "discrete",
    "driver": "vulkan 1",
    "buffer": 2**40,
    "binding": 2**31 - 1,
    "extent": 16384,
}


class Core:
    """Stands for the Rust core."""

    def __init__(self, adapters, probes=()):
        self.adapters, self.probes = list(adapters), list(probes)

    def info(self):
        return {"version": "1", "simd": "none", "threads": 2, "adapters": self.adapters}

    def probe(self):
        if not self.probes:
            raise mcrt.DeviceLostError("it fell off the bus")
        return self.probes


def shown(capsys, monkeypatch, core):
    monkeypatch.setattr(_info, "_mcrt", core)
    _info.show_info()
    _info.show_probes()
    return capsys.readouterr().out


def test_auto_takes_a_real_gpu(capsys, monkeypatch):
    text = shown(capsys, monkeypatch, Core([ADAPTER, ADAPTER | {"kind": "software"}]))
    assert '"auto" takes Fast GPU' in text
    assert "buffers up to 1 TiB, 2 GiB in one piece" in text
    assert "could not be checked: it fell off the bus" in text


def test_wrong_functions_are_named(capsys, monkeypatch):
    probes = [
        ("real", "ln", "f32", 10, 3.0, 4.0),
        ("real", "ln", "f64", 10, 57.3, 4.0),
        ("rng", "words", "f32", 10, 0.0, 0.0),
        ("frame", "rotate", "f32", 10, float("nan"), 12.0),
    ]
    text = shown(capsys, monkeypatch, Core([ADAPTER], probes))
    assert "2 of 3 disagree with the CPU" in text
    assert "ln of real.wgsl: 57.3 units" in text
    assert "rotate of frame.wgsl: nan units" in text
    assert "words" not in text
