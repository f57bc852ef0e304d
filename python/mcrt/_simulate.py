"""`simulate` and `plan`: one signature, turned into the scene and the settings of the Rust core."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence, Set
from contextlib import suppress
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from . import _mcrt
from ._arguments import Value, channels, choice, flag, integer, not_yet, positive, wrong
from ._device import backend
from ._errors import DeviceLostError, McrtError, SceneError
from ._medium import Medium, emission_planes
from ._progress import reporting
from ._records import Plan
from ._result import Result
from ._scene import Camera, Light, Phase, as_camera, as_lights, as_phase

OUTPUTS = ("fluence", "radiance", "image")
MEDIUM = ("spacing", "origin", "interpolation", "extinction", "albedo", "phase", "emission")


def simulate(
    volume: ArrayLike | Medium,
    *,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    interpolation: str | None = None,
    extinction: ArrayLike | None = None,
    albedo: ArrayLike | None = None,
    phase: Phase | None = None,
    emission: ArrayLike | None = None,
    light: Light | Sequence[Light] | None = None,
    camera: Camera | None = None,
    detector: None = None,
    photons: float | None = None,
    spp: float | None = None,
    target_error: float | None = None,
    time_limit: float | None = None,
    max_scatterings: int | None = None,
    method: str = "auto",
    tracker: str = "auto",
    angular: str | int = "auto",
    backend: str = "auto",
    seed: int = 0,
    threads: int | None = None,
    errors: bool = True,
    outputs: Sequence[str] | Set[str] | None = None,
    photoelectric: bool = False,
    force: bool = False,
    progress: bool | Callable[[float, dict[str, Any]], bool | None] | None = None,
) -> Result:
    """Transport light through a volume: voxel arrays and images, with standard errors.

    Parameters
    ----------
    volume : array (nz, ny, nx) or Medium
        The density, or a medium that holds it; what the medium holds must not be given again. An
        `xarray.DataArray` brings its axes' names, spacing and origin along, see `Medium`.
    spacing, origin, interpolation, extinction, albedo, phase, emission
        As for `Medium`, with its defaults: 1.0, (0, 0, 0), "linear", 1.0, 0.9, `Isotropic()`, none.
    light : light or sequence of lights, optional
        They add up; an empty sequence is no light. None lights the volume from beside the camera
        that frames it, unless it emits by itself.
    camera : PerspectiveCamera or OrthographicCamera, optional
        None frames the volume, and `target_error` is then meant for voxels, not for pixels.
    photons : int, optional
        Number of photons, 1 to 1e15; `1e7` is fine.
    spp : int, optional
        Paths per pixel of method "path", 1 to 1e9 (rounded up to whole view rays of up to 4 paths).
    target_error : float, optional
        Stop at this relative error: sqrt(mean(stderr^2 + estimated bias^2)) / mean(value), the
        worst channel, over the pixels (or voxels) above 5 % of the maximum. 0.02 where neither
        `photons`, `spp`, `target_error` nor `time_limit` is given.
    time_limit : float, optional
        Stop after this many seconds (such a result depends on the machine's speed).
    max_scatterings : int, optional
        n: images and radiance hold orders 1..n, fluence and absorbed 0..n. None: all orders.
    method : "auto", "single", "photon" or "path"
        "single" is deterministic and holds order 1 only; its fluence is that of order 0. "photon"
        keeps orders 2 and up in the voxels, for any number of images. "path" traces paths from the
        camera: the image of this camera alone, without bias. "auto" takes "path" if `spp` is given,
        or if only the image is wanted and the voxels seen are too thick for one made of voxels.
    tracker : "auto", "woodcock", "march" or "analytic"
        How free flights are sampled; "analytic" needs a homogeneous medium.
    angular : "auto", "sh" or int
        How light is recorded in a medium whose phase function is not isotropic. "auto": towards the
        eye of the camera, whose images alone then are served. "sh": in spherical harmonics, of an
        order that the plan picks from the phase function and the target error, for every camera;
        the plan says what that leaves out of orders >= 2 (nothing for `Rayleigh`). A number, 0 to
        8, is the order itself; it takes (order + 1)^2 times the memory of the tallies.
    backend : "auto", "cpu", "gpu" or "gpu:NAME"
        "auto" takes a GPU where there is one, and else the CPU; "gpu" takes any adapter, also one
        that a processor plays; "gpu:NAME" the one with this in its name, "gpu:low" and "gpu:high"
        by its power. The environment variable MCRT_BACKEND says what "auto" means.
    seed : int
        0 to 2^64 - 1. The same seed gives the same bits, whatever `threads` is.
    threads : int, optional
        None takes all cores.
    errors : bool
        False spares the memory of the standard errors.
    outputs : sequence (or set) of "fluence", "radiance", "image", optional
        What the result shall hold; None: all of them (of method "path" the image).
    force : bool
        Run even if the estimated memory is more than there is.
    progress : bool or callable, optional
        None: a tqdm bar where tqdm is installed and somebody watches. A function is called with
        (fraction done, info); returning False it stops the run, which keeps what is there, as
        `time_limit` does. Ctrl-C, or an exception that it raises, ends the run without a result.
    detector, photoelectric
        Not yet available.

    Returns
    -------
    Result

    Raises
    ------
    SceneError
        If an argument is not allowed: the message says what was given, what is allowed, and where.
        Quantities with a unit (of astropy, pint, ...) and masked values are not.
    VolumeTooLargeError
        If the run needs more memory than there is, or than the GPU can hold.
    NoAdapterError
        If there is no GPU adapter, or none of that name, or the process is a fork of one that used
        the GPU.
    DeviceLostError
        If the GPU is lost.
    McrtError
        If the GPU fails otherwise. Of a run that had begun, this error and those above hold what
        was finished (`error.partial`), and can go on from there (`error.resume()`).

    Notes
    -----
    Solves the stationary radiative transfer equation
    (w . grad) L = -sigma_t L + sigma_s integral p(w . w') L(w') dw' + L_e for the radiance L.
    """
    scene, settings, progress = _parse(locals())
    return _run(_mcrt.Scene(scene, settings["threads"]), scene, settings, progress)


def _run(
    core: _mcrt.Scene,
    scene: dict[str, Any],
    settings: dict[str, Any],
    progress: Any,
    before: Any = None,
) -> Result:
    """Run, or go on with what an error cut short."""

    def resume(progress: Any = None) -> Result:
        return _run(core, scene, settings, progress, before)

    try:
        with reporting(progress) as report:
            data = _mcrt.simulate(core, settings, report, before)
        _remark(data["plan"], settings)
        data["warnings"] = [*settings["remarks"]["warnings"], *data["warnings"]]
    except McrtError as error:
        if before is not None or isinstance(error, DeviceLostError):
            error._run = resume
        raise
    cut_short, before = data.pop("cut_short", None), data.pop("unfinished", None)
    result = Result(scene, settings, data, core=core)
    if cut_short is not None:
        cut_short.partial, cut_short._run = result, resume
        raise cut_short
    if data["stats"]["stopped_by"] == "target_error":
        with suppress(McrtError):  # the run is done; `image` meets the error where it is asked for
            result._keep_judged()
    return result


def plan(
    volume: ArrayLike | Medium,
    *,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    interpolation: str | None = None,
    extinction: ArrayLike | None = None,
    albedo: ArrayLike | None = None,
    phase: Phase | None = None,
    emission: ArrayLike | None = None,
    light: Light | Sequence[Light] | None = None,
    camera: Camera | None = None,
    detector: None = None,
    photons: float | None = None,
    spp: float | None = None,
    target_error: float | None = None,
    time_limit: float | None = None,
    max_scatterings: int | None = None,
    method: str = "auto",
    tracker: str = "auto",
    angular: str | int = "auto",
    backend: str = "auto",
    seed: int = 0,
    threads: int | None = None,
    errors: bool = True,
    outputs: Sequence[str] | Set[str] | None = None,
    photoelectric: bool = False,
    force: bool = False,
    progress: bool | Callable[[float, dict[str, Any]], bool | None] | None = None,
) -> Plan:
    """What `simulate` would run with the same arguments, why, and at what cost; runs nothing.

    Parameters
    ----------
    volume, spacing, ..., progress
        As for `simulate`.

    Returns
    -------
    Plan
        Prints like a database's EXPLAIN; its entries are attributes too.

    Raises
    ------
    SceneError
        As `simulate`.
    """
    scene, settings, _ = _parse(locals())
    planned = Plan(_mcrt.plan(_mcrt.Scene(scene, settings["threads"]), settings))
    _remark(planned, settings)
    planned._scene = scene, settings
    return planned


def _remark(plan: dict[str, Any], settings: dict[str, Any]) -> None:
    """Add to a plan what was decided and noticed where the arguments were read."""
    for name in ("decisions", "warnings"):
        plan[name] = [*settings["remarks"][name], *plan[name]]


def _parse(arguments: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any], Any]:
    """The arguments of `simulate` as scene, settings, and `progress`."""
    settings, medium = _settings(arguments), _medium(arguments)
    settings["remarks"] = medium.remarks
    return _scene(medium, arguments), settings, arguments["progress"]


def _medium(arguments: dict[str, Any]) -> Medium:
    """The medium, given whole or by its arguments; the same thing twice is an error."""
    volume = arguments["volume"]
    given = {name: arguments[name] for name in MEDIUM if arguments[name] is not None}
    if not isinstance(volume, Medium):
        return Medium(volume, **given)
    if given:
        raise SceneError(f"{', '.join(given)} given both in the Medium and beside it; drop one")
    return volume


def _scene(medium: Medium, arguments: dict[str, Any]) -> dict[str, Any]:
    """The scene that the Rust core takes; it checks the values."""
    box: tuple[Any, Any, Any] = (medium.density.shape, medium.spacing, medium.origin)
    camera, light, albedo = arguments["camera"], arguments["light"], medium.albedo
    if light is None and medium.emission is not None:
        light = ()
    return {
        "density": medium.density,
        "spacing": medium.spacing,
        "origin": medium.origin,
        "linear": medium.interpolation == "linear",
        "extinction": channels(cast(Value, medium.extinction)),
        "albedo": albedo if isinstance(albedo, np.ndarray) else channels(albedo),
        "phase": as_phase(medium.phase)._spec(),
        "emission": emission_planes(medium),
        "shape": medium.shape,
        "lights": tuple(
            _mcrt.default_lights(*box)
            if light is None
            else [one._spec() for one in as_lights(light)]
        ),
        "camera": _mcrt.framing_camera(*box) if camera is None else as_camera(camera)._spec(),
        "frame": medium.frame
        and {
            "dims": medium.frame.dims,
            "coordinates": medium.frame.coordinates,
            "unit": medium.frame.unit,
        },
    }


def _settings(arguments: dict[str, Any]) -> dict[str, Any]:
    """How to run: everything but the scene."""
    if arguments["detector"] is not None:
        raise not_yet("detector")
    if flag("photoelectric", arguments["photoelectric"]):
        raise not_yet("photoelectric")

    def optional(name: str, parse: Callable[..., Any], *limits: int) -> Any:
        value = arguments[name]
        return None if value is None else parse(name, value, *limits)

    method = choice("method", arguments["method"], ("auto", "single", "photon", "path"))
    if method == "auto" and arguments["spp"] is not None:
        method = "path"
    method, outputs = _method_and_outputs(arguments["volume"], method, arguments["outputs"])
    return {
        "method": method,
        "tracker": choice(
            "tracker", arguments["tracker"], ("auto", "woodcock", "march", "analytic")
        ),
        "angular": _angular(arguments["angular"]),
        "photons": optional("photons", integer, 1, 10**15),
        "spp": optional("spp", integer, 1, 10**9),
        "target_error": optional("target_error", positive),
        "time_limit": optional("time_limit", positive),
        "max_scatterings": optional("max_scatterings", integer, 0, 2**31 - 1),
        "backend": backend(arguments["backend"]),
        "seed": integer("seed", arguments["seed"], 0, 2**64 - 1),
        "threads": optional("threads", integer, 1, 1024),
        "errors": flag("errors", arguments["errors"]),
        "outputs": outputs,
        "force": flag("force", arguments["force"]),
        "over_voxels": arguments["camera"] is None,
        "simd": os.environ.get("MCRT_SIMD") or None,
    }


def _method_and_outputs(volume: Any, method: str, outputs: Any) -> tuple[str, tuple[str, ...]]:
    """The method, and what it shall give: of a solid without voxels either images or means."""
    if not isinstance(volume, Medium) or volume.shape == "voxels":
        return method, _outputs(outputs, ("image",) if method == "path" else OUTPUTS)
    names = _outputs(outputs, OUTPUTS[:2] if method == "photon" else ("image",))
    if method == "auto" and names == ("image",):
        method = "path"
    if "image" in names and method in ("auto", "photon"):
        raise SceneError(
            f"a {volume.shape} has no voxels that photons could be kept in for an image; use "
            'method="path" for its image, outputs=("fluence", "radiance") for means over it'
        )
    return method, names


def _angular(value: Any) -> int | None:
    """None for the run's eye, -1 for harmonics of an order that the plan picks, or the order."""
    if isinstance(value, str):
        return None if choice("angular", value, ("auto", "sh")) == "auto" else -1
    return integer("angular", value, 0, 8)


def _outputs(value: Any, default: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the outputs, each once, in their own order."""
    if value is None:
        return default
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, Sequence | Set) or not names:
        raise wrong("outputs", f"a sequence of {', '.join(OUTPUTS)}", value)
    for name in names:
        choice("outputs", name, OUTPUTS)
    return tuple(name for name in OUTPUTS if name in names)
