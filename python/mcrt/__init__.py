"""Monte Carlo radiative transport in voxel volumes: fluence, radiance and pictures, with errors.

    result = mcrt.simulate(density, extinction=8.0, light=mcrt.PointLight((200, -150, 300)))
    result.fluence         # (nz, ny, nx[, 3])
    result.image(camera)   # any camera, same photons

Arrays are C-order (nz, ny, nx); `spacing` is (dz, dy, dx); points are world (x, y, z).
"""

from importlib.metadata import version as _version

from . import datasets, interop
from ._errors import DeviceLostError, McrtError, NoAdapterError, SceneError, VolumeTooLargeError
from ._info import show_info
from ._medium import Medium
from ._records import Plan
from ._result import Result
from ._scene import (
    DirectionalLight,
    EnvironmentLight,
    HenyeyGreenstein,
    Isotropic,
    OrthographicCamera,
    PencilBeam,
    PerspectiveCamera,
    PointLight,
    Rayleigh,
    TabulatedPhase,
)
from ._simulate import plan, simulate

__version__ = _version("mcrt-wgpu")

__all__ = [
    "DeviceLostError",
    "DirectionalLight",
    "EnvironmentLight",
    "HenyeyGreenstein",
    "Isotropic",
    "McrtError",
    "Medium",
    "NoAdapterError",
    "OrthographicCamera",
    "PencilBeam",
    "PerspectiveCamera",
    "Plan",
    "PointLight",
    "Rayleigh",
    "Result",
    "SceneError",
    "TabulatedPhase",
    "VolumeTooLargeError",
    "__version__",
    "datasets",
    "interop",
    "plan",
    "show_info",
    "simulate",
]
