"""The result of a run: arrays, errors, images from any camera, energy, statistics."""

import time
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np

from . import _mcrt, display, io
from ._arguments import wrong
from ._errors import SceneError
from ._merge import merge
from ._order0 import whole
from ._records import Energy, Plan, Record, energy
from ._scene import Camera, as_camera, camera_from_spec

CACHED_CAMERAS = 16
PIXELS = ("order1", "order2", "error")  # of a path result
ORDERS = {0: "background", 1: "order1", "2+": "order2", "emission": "emitted"}


class Result:
    """What `simulate` returns.

    Voxel arrays have the shape (nz, ny, nx), or (nz, ny, nx, 3) where the scene is RGB, dtype
    float32, and are read-only views: copy one to change it. Their unscattered light is found when
    one of them is first read, unless the run needed it;
    `stats.seconds` does not count that. Images have the shape (height, width)
    or (height, width, 3), dtype float32; each call returns a new array that is the caller's. Those
    of the last 16 cameras are kept.

    Attributes
    ----------
    plan : Plan
        What ran, and why.
    warnings : list of str
    camera : Camera
        The camera of the run; if none was given, the one that frames the volume.

    Notes
    -----
    Standard errors of voxels come from the scatter of B independent batches of photons, and of the
    unscattered light of points and directions from that of K lattices of light rays (which the plan
    names): (value - truth) / error follows Student's t with at least the lesser of B - 1 and K - 1,
    `stats.degrees_of_freedom`. Those of
    an image come from K sub-volumes, each of its own photons: Student's t with
    K - 1 = `stats.degrees_of_freedom_pixel`. Pixels (and neighbouring voxels) share photons, hence
    their errors are correlated: the error of a mean over pixels does not fall as one over the
    square root of their number. What an image holds that is found without photons (order 1 of
    points, directions and beams, emission seen directly) has no standard error; a single batch
    leaves the errors unknown: infinite. Merged runs of N_i photons and
    nu_i degrees of freedom have N^2 / sum(N_i^2 / nu_i) of them (Welch and Satterthwaite), N the
    sum of N_i, but for the pixels of photons, which have those of the smallest K.

    Where nothing was sampled the scatter tells nothing. In a voxel that no photon reached (in a
    channel) the error of the fluence is what one photon would have left: the power of all photons
    over their number, times the largest albedo of the channel if only scattered light is sampled,
    along the mean chord 4 V / S of the voxel, that is 4 power / (photons S) with the voxel's
    surface S; that of the radiance is albedo / (4 pi) times as much. In a pixel whose sub-volumes
    hold nothing it is that of one photon in each voxel seen, the pixel's opacity times albedo /
    (4 pi) times that of the fluence. A pixel of a "path" result none of whose paths found light
    has the error zero: its light is rarer than one path in `stats.spp`.
    """

    def __init__(
        self,
        scene: dict[str, Any],
        settings: dict[str, Any],
        data: dict[str, Any],
        seeds: tuple[int, ...] | None = None,
        core: _mcrt.Scene | None = None,
    ) -> None:
        self._scene, self._settings, self._data = scene, settings, data
        if core is not None:
            self._core = core
        self._seeds = seeds or (settings["seed"],)
        self._layers: dict[tuple[Any, ...], dict[str, np.ndarray]] = {}
        self.plan = Plan(data["plan"])
        self.warnings: list[str] = list(data["warnings"])
        self.camera: Camera = camera_from_spec(scene["camera"])

    @cached_property
    def energy(self) -> Energy:
        """The energy balance."""
        self._need_voxels("energy")
        return energy(self._data["energy"])

    # Voxels

    @property
    def fluence(self) -> np.ndarray:
        """Fluence rate Phi = integral of L over directions [W/length^2], mean over each voxel."""
        return self._voxels("fluence")

    @property
    def fluence_error(self) -> np.ndarray:
        """Standard error of `fluence` [W/length^2]."""
        return self._voxels("fluence", "_error")

    @property
    def radiance(self) -> np.ndarray:
        """Radiance that each voxel reflects towards the eye [W/(sr length^2)].

        albedo * integral of p(w . w') L(w') dw' over directions w', w towards the eye.
        """
        return self._voxels("radiance")

    @property
    def radiance_error(self) -> np.ndarray:
        """Standard error of `radiance` [W/(sr length^2)]."""
        return self._voxels("radiance", "_error")

    @property
    def absorbed(self) -> np.ndarray:
        """Absorbed power density, the mean of sigma_a Phi over each voxel [W/length^3].

        Where sigma_a varies within voxels (interpolation="linear") it is found by itself, else it
        is sigma_a times `fluence`, computed at each access.
        """
        return self._absorbed()

    @property
    def absorbed_error(self) -> np.ndarray:
        """Standard error of `absorbed` [W/length^3]."""
        return self._absorbed("_error")

    # Images

    def image(self, camera: Camera | None = None, order: int | str | None = None) -> np.ndarray:
        """Radiance of each pixel [W/(sr length^2)], mean over its area.

        Parameters
        ----------
        camera : Camera, optional
            Any camera, outside or inside the volume; None takes that of the run.
        order : optional
            None: all light that was scattered (orders 1 and up) or emitted by the medium; 0: the
            background seen through the medium; 1: light scattered once, be it a light's or
            emitted; "2+": light scattered twice or more; "emission": light that the medium emitted
            and that was not scattered, the integral of L_e times transmittance along the view.

        Raises
        ------
        SceneError
            If the result holds no image or not this order, or if the phase function is not
            isotropic, the run was without angular="sh", and the eye is another than that of the
            run.
        """
        known = isinstance(order, int | str) and not isinstance(order, bool) and order in ORDERS
        if order is not None and not known:
            raise wrong("order", 'None, 0, 1, "2+" or "emission"', order)
        if order == "2+" and self.plan.method == "single":
            raise SceneError('method "single" holds no orders above 1; use method="photon"')
        if order is None:
            layers = self._seen(camera, "order1", "order2", "emitted")
            return layers["order1"] + layers["order2"] + layers["emitted"]
        return self._seen(camera, ORDERS[order])[ORDERS[order]].copy()

    def image_error(self, camera: Camera | None = None) -> np.ndarray:
        """Standard error of `image(camera)` [W/(sr length^2)]; see the notes of the class."""
        self._need_errors()
        return self._seen(camera, "error")["error"].copy()

    def alpha(self, camera: Camera | None = None) -> np.ndarray:
        """Opacity of each pixel, 1 - transmittance: 0 where the background is seen unweakened."""
        return 1.0 - self._seen(camera, "transmittance")["transmittance"]

    # Statistics

    @cached_property
    def stats(self) -> Record:
        """Photons, collisions, seconds by stage, photons/s, relative errors, figure of merit.

        `median_relative_error`, `relative_error_95` (95 % of them are smaller) and
        `relative_error` (R, root mean square error / mean value) are those of the pixels where a
        camera was given, else of the voxels' fluence, above 5 % of the maximum, the worst channel;
        `figure_of_merit` is 1 / (R^2 T) with T the run's seconds. None where there are no errors.
        `unreached_voxels` is the number of voxels that no photon reached, None where no values of
        voxels are kept.
        """
        stats = Record(self._data["stats"])
        kept = self.plan.method != "path" and {"fluence", "radiance"} & set(
            self._settings["outputs"]
        )
        unreached = self._data.get("unreached")
        count = 0 if unreached is None else int(np.count_nonzero(unreached))
        stats["unreached_voxels"] = count if kept else None
        seconds = sum(stats.seconds.values())
        stats["photons_per_second"] = stats.photons / seconds if seconds > 0.0 else 0.0
        median, upper, rms = self._relative_errors()
        stats["median_relative_error"] = median
        stats["relative_error_95"] = upper
        stats["relative_error"] = rms
        stats["figure_of_merit"] = 1.0 / (rms**2 * seconds) if rms and seconds else None
        return stats

    def _relative_errors(self) -> tuple[float | None, float | None, float | None]:
        """Median, 95 % quantile and RMS of the relative errors."""
        if not self._settings["errors"]:
            return None, None, None
        outputs = self._settings["outputs"]
        if self._by_pixels():
            if not self._data["stats"]["photons"]:
                return 0.0, 0.0, 0.0
            return relative_errors(self.image(), self.image_error(), self.plan.channels)
        name = "fluence" if "fluence" in outputs else "radiance"
        return relative_errors(self._voxels(name), self._voxels(name, "_error"), self.plan.channels)

    # Files and displays

    def __add__(self, other: "Result") -> "Result":
        """Merge independent runs of the same scene (other seed) as if they had been one.

        They may differ in photons, tracker, backend and threads, and may have been stopped early.
        The order makes no difference, not by a bit.

        Raises
        ------
        SceneError
            If scene, settings or outputs differ, or a seed is the same.
        """
        if not isinstance(other, Result):
            return NotImplemented
        return Result(*merge(self, other), core=self.__dict__.get("_core"))

    def __radd__(self, other: object) -> "Result":
        """`sum(results)` merges them: it starts at 0."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def save(self, path: str | PathLike[str]) -> None:
        """Write everything to a NumPy archive (npz), the scene included; `load` reads it."""
        io.save(self, path)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Result":
        """Read a result that `save` wrote; it makes images from other cameras as before.

        Raises
        ------
        SceneError
            If the file is not such an archive.
        """
        return cls(*io.load(path))

    def save_exr(self, path: str | PathLike[str], camera: Camera | None = None) -> None:
        """Write an OpenEXR image, float32: RGBA and the layers total, order0, order1, order2plus.

        RGBA is the total (orders 1 and up, and emission) with `alpha`; of a medium that emits there
        is the layer emission too. Needs the package OpenEXR.
        """
        io.save_exr(self, path, camera)

    def save_png(self, path: str | PathLike[str], camera: Camera | None = None) -> None:
        """Write the tone-mapped image as an 8-bit PNG."""
        with open(path, "wb") as file:
            file.write(display.picture(self, camera))

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` of the voxel arrays, at the voxel centres, and of the image."""
        return io.to_xarray(self)

    def plot_image(
        self, camera: Camera | None = None, order: int | str | None = None, ax: Any = None
    ) -> Any:
        """Draw the image with matplotlib, with a colour bar where it is grey; returns the axes."""
        return display.plot_image(self, camera, order, ax)

    def plot_slice(
        self,
        quantity: str = "fluence",
        axis: str = "z",
        index: int | None = None,
        log: bool = False,
        ax: Any = None,
    ) -> Any:
        """Draw a slice of a voxel array with matplotlib; returns the axes.

        Parameters
        ----------
        quantity : str
            "fluence", "radiance", "absorbed", or one of these with "_error".
        axis : "x", "y" or "z"
            The axis that the slice is perpendicular to.
        index : int, optional
            Index along it; None takes the middle.
        log : bool
            Logarithmic colours.
        """
        return display.plot_slice(self, quantity, axis, index, log, ax)

    def show(self, camera: Camera | None = None) -> None:
        """Show the image in a matplotlib window, or in the notebook."""
        display.show(self, camera)

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self._scene["density"].shape))
        walks = f"{self._data['stats']['photons']:.3g} "
        walks += "paths" if self.plan.method == "path" else "photons"
        return f"<mcrt.Result {self.plan.method}, {shape} voxels (z, y, x), {walks}>"

    def __str__(self) -> str:
        rows = display.summary(self)
        width = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{width}}  {text}" for name, text in rows)

    def _repr_html_(self) -> str:
        return display.html(self)

    # What the above is made of

    def _absorbed(self, suffix: str = "") -> np.ndarray:
        if self._data.get("absorbed") is not None:
            return self._voxels("absorbed", suffix, "fluence")
        return self._sigma_a() * self._voxels("fluence", suffix)

    @cached_property
    def _core(self) -> _mcrt.Scene:
        """The scene as the Rust core keeps it."""
        return _mcrt.Scene(self._scene, self._settings["threads"])

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_core"}

    def _whole(self) -> dict[str, Any]:
        """The data with order 0, which is found when it is first asked for."""
        data = dict(self._data)  # what another thread adds meanwhile is not added again
        if not data.get("order0", True):
            found = data.get("unscattered")
            if found is None:
                found = _mcrt.unscattered(self._core, self._settings)
            self._data.update(whole(data, found))
            self._data.pop("unscattered", None)
        return self._data

    def _voxels(self, name: str, suffix: str = "", output: str | None = None) -> np.ndarray:
        """The array of a name, which comes with an output: that of its name unless given."""
        self._need_voxels(name)
        outputs = self._settings["outputs"]
        if (output or name) not in outputs:
            raise missing(output or name, outputs)
        if suffix:
            self._need_errors()
        view = self._whole()[name + suffix].view()
        view.flags.writeable = False
        return view

    def _need_voxels(self, name: str) -> None:
        if self.plan.method == "path":
            raise SceneError(f'a "path" result has images only, no {name}; use method="photon"')

    def _need_errors(self) -> None:
        if not self._settings["errors"]:
            raise SceneError("the run kept no errors; use errors=True")

    def _sigma_a(self) -> np.ndarray:
        """Absorption coefficient of each voxel [1/length], float32, with a channel axis if RGB."""
        albedo = self._scene["albedo"]
        per_voxel = isinstance(albedo, np.ndarray)
        given = albedo[..., np.newaxis] if per_voxel else albedo
        coalbedo = (1.0 - np.asarray(given, np.float64)).astype(np.float32)
        extinction = np.array(self._scene["extinction"], np.float32)
        sigma_a = coalbedo * extinction * self._scene["density"][..., np.newaxis]
        return sigma_a if self.plan.channels == 3 else sigma_a[..., 0]

    def _by_pixels(self) -> bool:
        """Whether the run's error is meant for pixels, not for voxels."""
        outputs = self._settings["outputs"]
        return "image" in outputs and not (self._settings["over_voxels"] and "fluence" in outputs)

    def _keep_judged(self) -> None:
        """Gathers what a run by its pixels was judged by: its picture and the error of that."""
        if self._by_pixels() and self._settings["errors"] and self.plan.method != "path":
            start = time.perf_counter()
            self._seen(None, "order1", "error")
            self._data["stats"]["seconds"]["picture"] = time.perf_counter() - start

    def _seen(self, camera: Camera | None, *names: str) -> dict[str, np.ndarray]:
        """Layers that a camera sees, among them those of the given names."""
        if "image" not in self._settings["outputs"]:
            raise missing("image", self._settings["outputs"])
        spec = (self.camera if camera is None else as_camera(camera))._spec()
        if self.plan.method != "path":
            return self._gather(spec, names)
        if spec != self.camera._spec():
            raise SceneError(
                'a "path" result holds the image of its own camera only; use method="photon", or '
                "run again with camera=..."
            )
        traced = {name: self._data[name] for name in PIXELS}
        if self._scene["emission"] is None:
            traced["emitted"] = np.zeros_like(traced["order1"])
        return traced if traced.keys() >= set(names) else self._gather(spec, names) | traced

    def _gather(self, spec: tuple[Any, ...], names: tuple[str, ...]) -> dict[str, np.ndarray]:
        """Layers that a camera gathers, the image's or the error; the last cameras' are kept."""
        layers = self._layers.pop(spec, {})
        for replicates in sorted({name == "error" for name in names if name not in layers}):
            layers |= _mcrt.gather(self._core, self._volumes(), spec, replicates)
            if replicates and "error" in layers:
                self._allow_for_one_photon(layers, spec)
        if "error" in names and "error" not in layers:  # no photons, or a single batch of them
            unknown = np.inf if self._data["stats"]["photons"] else 0.0
            width, height = spec[-1]
            shape = (height, width, 3) if self.plan.channels == 3 else (height, width)
            layers["error"] = np.full(shape, unknown, np.float32)
        self._layers[spec] = layers
        if len(self._layers) > CACHED_CAMERAS:
            self._layers.pop(next(iter(self._layers)), None)  # another thread may have
        return layers

    def _allow_for_one_photon(self, layers: dict[str, np.ndarray], spec: tuple[Any, ...]) -> None:
        """The error of one photon in each voxel seen, where no sub-volume holds anything."""
        nothing = layers["error"] == 0.0
        one, albedo = self._data.get("one_photon"), self._scene["albedo"]
        if one is None or not nothing.any():
            return
        if "transmittance" not in layers:
            layers |= _mcrt.gather(self._core, self._volumes(), spec, False)
        top = np.max(albedo) if isinstance(albedo, np.ndarray) else np.array(albedo)
        error = (1.0 - layers["transmittance"]) * (one * top if one.size > 1 else np.max(one * top))
        layers["error"][nothing] = error[nothing]

    def _volumes(self) -> dict[str, Any]:
        """What a gather reads."""
        names = ("source", "source0", "subvolumes", "columns", "fine", "harmonics")
        return {
            **{name: self._data.get(name) for name in names},
            "max_scatterings": self._settings["max_scatterings"],
            "transmitted_only": self.plan.method == "path",
            "threads": self._settings["threads"],
            "backend": self._settings.get("backend"),
            "eye": self._scene["camera"],
        }


def missing(name: str, outputs: tuple[str, ...]) -> SceneError:
    """The error for an output that was not asked for."""
    wanted = ", ".join(f'"{output}"' for output in (*outputs, name))
    return SceneError(f"the result holds no {name}; ask for it with outputs=({wanted})")


def relative_errors(
    value: np.ndarray, error: np.ndarray, channels: int
) -> tuple[float, float, float]:
    """Median, 95 % quantile, RMS of error / value above 5 % of the maximum, worst channel."""
    worst = np.zeros(3)
    for v, e in zip(value.reshape(-1, channels).T, error.reshape(-1, channels).T, strict=True):
        bright = v > 0.05 * v.max()
        if bright.any():
            v, e = v[bright].astype(np.float64), e[bright].astype(np.float64)
            if not np.isfinite(e).all():
                return np.inf, np.inf, np.inf
            median, upper = np.quantile(e / v, (0.5, 0.95))
            worst = np.maximum(worst, (median, upper, np.sqrt(np.mean(e**2)) / np.mean(v)))
    return float(worst[0]), float(worst[1]), float(worst[2])
