"""Other codes, each with its set-up: pmcxcl in an environment of its own, Mitsuba's LLVM."""

import glob
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

TARGET = Path(__file__).parents[2] / "target"
BENCH = TARGET / "bench"
PEERS = TARGET / "bench-peers"
PMCXCL = ("pmcxcl==0.7.5", "intel-opencl-rt", "intel-cmplr-lib-rt", "numpy")


class MissingPeerError(Exception):
    """A code to compare with is not to be had here."""


class Cube60(NamedTuple):
    """pmcxcl's runs: shortest seconds, mean fraction absorbed, fluence (seeds, nz, ny, nx).

    The seconds are its own, without the compilation of its kernel. `exact` is without its fast
    mathematics, which absorbs too little on a CPU; `fluence` is with.
    """

    seconds: float
    absorbed: float
    exact_seconds: float
    exact_absorbed: float
    fluence: np.ndarray


def pmcxcl_cube60(photons, seeds):
    """pmcxcl's cube60 on the CPU, by Intel's OpenCL, after a run that warms up."""
    script = Path(__file__).with_name("cube60_pmcxcl.py")
    found = PEERS / "fluence.npy"
    command = [_pmcxcl(), script, found, str(int(photons)), *map(str, seeds)]
    paths = {"OCL_ICD_VENDORS": str(PEERS / "vendors"), "LD_LIBRARY_PATH": str(PEERS / "lib")}
    report = json.loads(_call(command, env=os.environ | paths))
    fluence = np.load(found).transpose(0, 3, 2, 1)  # it has x first
    return Cube60(*report["fast"], *report["exact"], fluence)


def _pmcxcl():
    """The Python that has pmcxcl and the OpenCL run time; installs them once."""
    python, done = PEERS / "bin" / "python", PEERS / "installed.txt"
    wanted = "\n".join(PMCXCL)
    if not done.exists() or done.read_text() != wanted:
        _call([sys.executable, "-m", "venv", PEERS])
        _call([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *PMCXCL])
        driver = PEERS / "lib" / "libintelocl.so"
        if not driver.exists():
            raise MissingPeerError(f"intel-opencl-rt brought no {driver}")
        (PEERS / "vendors").mkdir(exist_ok=True)
        (PEERS / "vendors" / "intel.icd").write_text(f"{driver}\n")
        done.write_text(wanted)
    return python


def _call(command, **options):
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=300, **options
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        last = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[-1]
        raise MissingPeerError(f"{command[0]}: {last}") from error


def mitsuba():
    """The module, with its LLVM variant set."""
    # Dr.Jit aborts with LLVM 15 and 16, which it may find first.
    llvm = glob.glob("/usr/lib/*/libLLVM*19*") + glob.glob("/usr/lib/llvm-19/lib/libLLVM*.so*")
    if llvm:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", sorted(llvm)[0])
    try:
        import mitsuba
    except ImportError as error:
        raise MissingPeerError(f"{error}; pip install 'mcrt-wgpu[test]'") from error
    mitsuba.set_variant("llvm_ad_mono")
    return mitsuba


def mitsuba_scene(mi, volume, arguments):
    """What `mcrt.simulate` is given, for `mi.load_dict`: unit voxels at 0, a point light."""
    transform = mi.ScalarTransform4f()
    camera, light, phase = (arguments.get(name) for name in ("camera", "light", "phase"))
    nz, ny, nx = volume.shape
    extent = mi.ScalarPoint3f(nx, ny, nz)
    optical = {
        "albedo": arguments["albedo"],
        "phase": {"type": "hg", "g": phase.g} if phase else {"type": "isotropic"},
    }
    if np.ptp(volume) == 0.0:
        sigma_t = float(volume.flat[0]) * arguments["extinction"]
        medium = {"type": "homogeneous", "sigma_t": sigma_t}
    else:
        nearest = arguments.get("interpolation") == "nearest"
        medium = {
            "type": "heterogeneous",
            "scale": arguments["extinction"],
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(np.ascontiguousarray(volume)[..., np.newaxis]),
                "filter_type": "nearest" if nearest else "trilinear",
                "to_world": transform.scale(extent),
                "accel": False,
                "raw": True,
            },
        }
    return {
        "type": "scene",
        "integrator": {
            "type": "volpath",
            "max_depth": arguments["max_scatterings"] + 1,
            "rr_depth": 100000,
        },
        "light": {
            "type": "point",
            "position": [float(x) for x in light.position],
            "intensity": float(light.intensity),
        },
        "sensor": {
            "type": "perspective",
            "fov": float(camera.fov),
            "to_world": transform.look_at(camera.origin, camera.target, camera.up),
            "film": {
                "type": "hdrfilm",
                "width": camera.resolution[0],
                "height": camera.resolution[1],
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
                "component_format": "float32",
            },
            "sampler": {"type": "independent"},
        },
        "box": {
            "type": "cube",
            "to_world": transform.scale(extent / 2).translate([1, 1, 1]),
            "bsdf": {"type": "null"},
            "interior": medium | optical,
        },
    }
