"""Merging independent runs of the same scene as if they had been one.

With N_i photons, means m_i and standard errors e_i:
m = sum(N_i m_i) / N and e = sqrt(sum((N_i e_i)^2)) / N, N = sum(N_i).

A photon's variance is the same in all runs, so that e_i^2 is proportional to 1 / N_i, and the
degrees of freedom of e are those of Welch and Satterthwaite (1946): nu = N^2 / sum(N_i^2 / nu_i).

Runs are taken in the order of their seeds, whatever the order of the sum: a + b and b + a have the
same bits.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import SceneError

if TYPE_CHECKING:
    from ._result import Result

MEANS = ("fluence", "radiance", "absorbed", "order1", "order2")
SOURCES = ("source", "source0")
ERRORS = ("fluence_error", "radiance_error", "absorbed_error", "error")
SAME_SETTINGS = ("max_scatterings", "errors", "outputs", "over_voxels")
COUNTS = ("photons", "collisions", "batches")

Weights = tuple[float, float]


def merge(
    a: "Result", b: "Result"
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], tuple[int, ...]]:
    """Scene, settings, data and seeds of the merged result.

    Raises
    ------
    SceneError
        If the runs are not independent runs of the same scene.
    """
    _check(a, b)
    a, b = sorted((a, b), key=lambda result: min(result._seeds))
    x, y = a._whole(), b._whole()
    seeds = tuple(sorted(a._seeds + b._seeds))
    counts = x["stats"]["photons"], y["stats"]["photons"]
    if counts == (0, 0):  # light rays have noise without any photon
        counts = len(a._seeds), len(b._seeds)
    weights = counts[0] / sum(counts), counts[1] / sum(counts)
    data = {**x, "subvolumes": _subvolumes(weights, x.get("subvolumes"), y.get("subvolumes"))}
    for names, formula in ((MEANS, _mean), (SOURCES, _source), (ERRORS, _error)):
        for name in names:
            one, other = x.get(name), y.get(name)
            if one is not None or other is not None:
                data[name] = formula(weights, one, other)
    data["unreached"] = _unreached(weights, x.get("unreached"), y.get("unreached"))
    if x.get("one_photon") is not None and y.get("one_photon") is not None:
        data["one_photon"] = _one_photon(weights, x["one_photon"], y["one_photon"])
    if "energy" in x:
        data["energy"] = {
            name: (_error if name.endswith("error") else _mean)(weights, value, y["energy"][name])
            for name, value in x["energy"].items()
        }
    data["stats"] = _stats(counts, x["stats"], y["stats"])
    data["plan"] = _plan(x["plan"], y["plan"], seeds)
    data["warnings"] = _union(x["warnings"], y["warnings"])
    return a._scene, a._settings, data, seeds


def _check(a: "Result", b: "Result") -> None:
    """Only independent runs of one scene, with the same kind of result, can be merged."""
    for name in {**a._scene, **b._scene}:
        if not _same(a._scene.get(name), b._scene.get(name)):
            raise SceneError(f"results of different scenes cannot be merged: {name} differs")
    given = {name: (a._settings[name], b._settings[name]) for name in SAME_SETTINGS}
    given["method"] = a.plan.method, b.plan.method
    given["angular"] = a._data.get("harmonics"), b._data.get("harmonics")
    for name, (one, other) in given.items():
        if one != other:
            raise SceneError(f"results of different {name} cannot be merged: {one!r} and {other!r}")
    for name in (*MEANS, *ERRORS):
        one, other = (getattr(r._data.get(name), "shape", None) for r in (a, b))
        if one != other:
            raise SceneError(
                f"results with {name} of the shapes {one} and {other} cannot be merged"
            )
    both = set(a._seeds) & set(b._seeds)
    if both:
        raise SceneError(f"results of the same seed cannot be merged: both have {min(both)}")


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[name], b[name]) for name in a)
    return type(a) is type(b) and a == b


def _merged(
    weights: Weights, a: np.ndarray, b: np.ndarray, formula: Callable[[Any, Any], Any]
) -> np.ndarray:
    """`formula` of two arrays in double precision, slice by slice to spare memory.

    A run without photons says nothing.
    """
    if 0.0 in weights:
        return a if weights[0] else b
    out = np.empty_like(a)
    for i in range(len(a)):
        out[i] = formula(np.asarray(a[i], np.float64), np.asarray(b[i], np.float64))
    return out


def _mean(weights: Weights, a: Any, b: Any) -> np.ndarray:
    """The weighted mean; equal values, which have no noise, stay as they are."""
    wa, wb = weights
    return _merged(weights, a, b, lambda a, b: np.where(a == b, a, wa * a + wb * b))


def _source(weights: Weights, a: Any, b: Any) -> np.ndarray:
    """The mean of what photons scattered: None of a run in which none did."""
    a = np.zeros_like(b) if a is None else a
    return _mean(weights, a, np.zeros_like(a) if b is None else b)


def _unreached(weights: Weights, a: Any, b: Any) -> np.ndarray | None:
    """The voxels that no photon of either run reached; None if there are none."""
    if 0.0 in weights:
        return a if weights[0] else b
    return None if a is None or b is None else a & b


def _one_photon(weights: Weights, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """One photon's part of the photons of both runs, each being one of its own's."""
    if 0.0 in weights:
        return a if weights[0] else b
    both = a + b
    return np.divide(a * b, both, out=np.zeros_like(both), where=both > 0)


def _error(weights: Weights, a: Any, b: Any) -> np.ndarray:
    """The standard error of the weighted mean."""
    wa, wb = weights
    return _merged(weights, a, b, lambda a, b: np.hypot(wa * a, wb * b))


def _subvolumes(weights: Weights, a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    """The sub-volumes (..., K), each of photons of both runs, K the smaller number of both.

    They stay independent and equally distributed, so their spread has K - 1 degrees of freedom. A
    run with a single batch has none, and leaves the error unknown.
    """
    if 0.0 in weights:
        return a if weights[0] else b
    if a is None or b is None:
        return None
    k = min(a.shape[-1], b.shape[-1])
    return _mean(weights, _folded(a, k), _folded(b, k))


def _folded(subvolumes: np.ndarray, k: int) -> np.ndarray:
    """`k` sub-volumes with the mean, and the variance of that mean, of more of them.

    Each is the mean of as many as there are for each; what some were too many for is left out of
    the deviations from the mean, which shrink by as much as the mean of all is surer than theirs.
    """
    given = subvolumes.shape[-1]
    if given == k:
        return subvolumes
    each = given // k
    out = np.empty((*subvolumes.shape[:-1], k), subvolumes.dtype)
    for i, plane in enumerate(subvolumes):
        groups = plane[..., : k * each].reshape(*plane.shape[:-1], k, each).mean(-1)
        deviation = (groups - groups.mean(-1, keepdims=True)) * np.sqrt(k * each / given)
        out[i] = plane.mean(-1, keepdims=True) + deviation
    return out


def _stats(counts: tuple[int, int], a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    """Counts and seconds add up; degrees of freedom of voxels, and of paths' pixels, too.

    Pixels of photons have those of the smaller number of sub-volumes.
    """
    stats = {**a, **{name: a[name] + b[name] for name in COUNTS}}
    voxel, pixel = "degrees_of_freedom", "degrees_of_freedom_pixel"
    n, m = counts
    stats[voxel] = _degrees(n, a[voxel], m, b[voxel])
    if a.get("spp") is not None:
        stats["spp"] = a["spp"] + b["spp"]
        stats[pixel] = _degrees(n, a[pixel], m, b[pixel])
    elif not (n and m):
        stats[pixel] = (a if n else b)[pixel]
    else:
        stats[pixel] = min(a[pixel], b[pixel])
    stats["seconds"] = {
        stage: a["seconds"].get(stage, 0.0) + b["seconds"].get(stage, 0.0)
        for stage in {**a["seconds"], **b["seconds"]}
    }
    stats["stopped_by"] = _joined(a["stopped_by"], b["stopped_by"])
    return stats


def _degrees(n: int, nu: float, m: int, mu: float) -> float:
    """N^2 / (n^2 / nu + m^2 / mu), N = n + m: 0 where an error is unknown."""
    if not (n and m):
        return nu if n else mu
    return (n + m) ** 2 / (n**2 / nu + m**2 / mu) if nu and mu else 0


def _plan(a: dict[str, Any], b: dict[str, Any], seeds: tuple[int, ...]) -> dict[str, Any]:
    """The first run's, with the photons of all, and a decision that names their seeds."""
    plan = {**a, **{name: a[name] + b[name] for name in ("photons", "batches", "seconds")}}
    plan |= {name: _joined(a[name], b[name]) for name in ("backend", "tracker")}
    plan["subvolumes"] = min(a["subvolumes"], b["subvolumes"])
    plan["warnings"] = _union(a["warnings"], b["warnings"])
    some = ", ".join(map(str, seeds[:8])) + (", ..." if len(seeds) > 8 else "")
    row = (
        "merged",
        f"{len(seeds)} independent runs",
        f"of the seeds {some}; the above is the first's",
    )
    plan["decisions"] = [*(d for d in a["decisions"] if d[0] != row[0]), row]
    return plan


def _joined(a: str, b: str) -> str:
    """The names that two lists of names hold."""
    return ", ".join(sorted({*a.split(", "), *b.split(", ")}))


def _union(a: Any, b: Any) -> list[str]:
    return list(dict.fromkeys([*a, *b]))
