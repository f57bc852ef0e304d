"""What the wheel for Linux can promise: manylinux_2_17, installable since RHEL 7 and Ubuntu 14.04.

`make wheel` links against that glibc and checks the tag. Here, without a second build, the
extension that the tests run on is asked for what that glibc does not have.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import mcrt
import pytest

pytestmark = [
    pytest.mark.cpu_only("no result of a simulation"),
    pytest.mark.skipif(
        not sys.platform.startswith("linux") or shutil.which("readelf") is None,
        reason="needs Linux and readelf of binutils",
    ),
]
GLIBC = (2, 17)
# Old glibc has these in the static part that each program links.
STATIC = {
    "stat64",
    "fstat64",
    "lstat64",
    "fstatat64",
    "stat",
    "fstat",
    "lstat",
    "fstatat",
    "atexit",
}


def symbols(path):
    """(defined, binding, name, version of glibc) of each dynamic symbol of a library."""
    text = subprocess.run(
        ["readelf", "-W", "--dyn-syms", path], capture_output=True, text=True, check=True
    ).stdout
    for _, binding, place, name, version in re.findall(
        r" (FUNC|OBJECT|IFUNC|NOTYPE|TLS) +(\w+) +\w+ +(\w+) ([\w.]+)@+GLIBC_([\d.]+)", text
    ):
        yield place != "UND", binding, name, tuple(map(int, version.split(".")))


def test_the_extension_needs_nothing_that_glibc_2_17_lacks():
    loaded = Path("/proc/self/maps").read_text()
    libraries = set(
        re.findall(r"/\S+/(?:lib[cm]|libdl|libpthread|librt|ld)[-\w.]*\.so[\d.]*", loaded)
    )
    oldest = {}
    for library in libraries:
        for defined, _, name, version in symbols(library):
            if defined:
                oldest[name] = min(version, oldest.get(name, version))
    needed = {
        name
        for defined, binding, name, _ in symbols(mcrt._mcrt.__file__)
        if not defined and binding != "WEAK"
    }
    assert {"memcpy", "malloc", "exp"} <= needed & oldest.keys()
    assert {name for name in needed - STATIC if oldest.get(name, (9,)) > GLIBC} == set()
