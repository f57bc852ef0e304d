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
