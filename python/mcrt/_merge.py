"""Merging independent runs of the same scene as if they had been one.

With N_i photons, means m_i and standard errors e_i:
m = sum(N_i m_i) / N and e = sqrt(sum((N_i e_i)^2)) / N, N = sum(N_i).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import SceneError

if TYPE_CHECKING:
    from ._result import Result

MEANS = ("fluence", "radiance", "source", "source0", "subvolumes", "order1", "order2")
ERRORS = ("fluence_error", "radiance_error", "error")
SAME_SETTINGS = ("max_scatterings", "errors", "outputs", "over_voxels")
COUNTS = ("photons", "collisions", "batches")


def merge(a: "Result", b: "Result") -> dict[str, Any]:
    """The data of the merged result.

    Raises
    ------
    SceneError
        If the runs are not independent runs of the same scene.
    """
    _check(a, b)
    x, y = a._data, b._data
    weights = _weights(x["stats"]["photons"], y["stats"]["photons"])
    data = {**x}
    for name in MEANS:
        if x.get(name) is not None:
            data[name] = _mean(weights, x[name], y[name])
    for name in ERRORS:
        if x.get(name) is not None:
            data[name] = _error(weights, x[name], y[name])
    data["unreached"] = _unreached(x.get("unreached"), y.get("unreached"))
    if x.get("one_photon") is not None:
        data["one_photon"] = _one_photon(x["one_photon"], y["one_photon"])
    if "energy" in x:
        data["energy"] = {
            name: (_error if name == "error" else _mean)(weights, value, y["energy"][name])
            for name, value in x["energy"].items()
        }
    data["plan"] = {**x["plan"], "photons": x["plan"]["photons"] + y["plan"]["photons"]}
    data["stats"] = _stats(x["stats"], y["stats"])
    data["warnings"] = list(dict.fromkeys([*x["warnings"], *y["warnings"]]))
    return data


def _check(a: "Result", b: "Result") -> None:
    """Only independent runs of one scene, with the same kind of result, can be merged."""
    for name in a._scene:
        if not _same(a._scene[name], b._scene[name]):
            raise SceneError(f"results of different scenes cannot be merged: {name} differs")
    for name in SAME_SETTINGS:
        if a._settings[name] != b._settings[name]:
            given = f"{a._settings[name]!r} and {b._settings[name]!r}"
            raise SceneError(f"results of different {name} cannot be merged: {given}")
    if a.plan.method != b.plan.method:
        given = f'"{a.plan.method}" and "{b.plan.method}"'
        raise SceneError(f"results of different methods cannot be merged: {given}")
    for name in (*MEANS, *ERRORS):
        shapes = [getattr(x.get(name), "shape", None) for x in (a._data, b._data)]
        if shapes[0] != shapes[1]:
            raise SceneError(
                f"results of different {name} cannot be merged (arrays of shape {shapes[0]} and "
                f"{shapes[1]}): one of them has too few photons"
            )
    both = set(a._seeds) & set(b._seeds)
    if both:
        raise SceneError(f"results of the same seed cannot be merged: both have {min(both)}")


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return type(a) is type(b) and a == b


def _weights(n: int, m: int) -> tuple[float, float]:
    """Shares of the photons; a deterministic result stands for both."""
    return (n / (n + m), m / (n + m)) if n + m else (1.0, 0.0)


def _mean(weights: tuple[float, float], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (weights[0] * a + weights[1] * b).astype(a.dtype)


def _error(weights: tuple[float, float], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.hypot(weights[0] * a, weights[1] * b).astype(a.dtype)


def _unreached(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    """The voxels that no photon of either run reached; None if there are none."""
    return None if a is None or b is None else a & b


def _one_photon(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """One photon's part of the photons of both runs, each being one of its own's."""
    both = a + b
    return np.divide(a * b, both, out=np.zeros_like(both), where=both > 0)


def _stats(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    """Counts and seconds add up; the sub-volumes, and so the degrees of freedom, stay as many.

    View rays do not: pixels of paths have those of both runs.
    """
    stats = {**a, **{name: a[name] + b[name] for name in COUNTS}}
    if a.get("spp") is not None:
        for name in ("spp", "degrees_of_freedom_pixel"):
            stats[name] = a[name] + b[name]
    stats["seconds"] = {
        stage: a["seconds"].get(stage, 0.0) + b["seconds"].get(stage, 0.0)
        for stage in {**a["seconds"], **b["seconds"]}
    }
    if a["stopped_by"] != b["stopped_by"]:
        stats["stopped_by"] = f"{a['stopped_by']}, {b['stopped_by']}"
    return stats
