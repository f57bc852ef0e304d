"""Volumes to try things on: a real one, and one that is made."""

import gzip
import importlib.util
from pathlib import Path

import numpy as np

from ._arguments import integer

HEAD = "mni_icbm152_t1_tal_nlin_sym_09a_converted.nii.gz"
NIFTI_UINT8 = 2


def mni_head() -> np.ndarray:
    """The MNI ICBM152 brain: the mean T1-weighted MRI of 152 heads, without the skull.

    The file is read from the package nilearn, which need not be imported (and whose own
    dependencies need not be installed).

    Returns
    -------
    array of float32, shape (189, 233, 197) = (z, y, x), in [0, 1]
        Voxels of 1 mm; x to the right, y to the front, z to the top of the head.

    Raises
    ------
    ImportError
        If nilearn is not installed.

    References
    ----------
    Fonov et al. 2011, NeuroImage 54, 313.
    """
    found = importlib.util.find_spec("nilearn")
    if found is None or not found.submodule_search_locations:
        raise ImportError("mni_head() reads a file of nilearn: pip install 'mcrt-wgpu[demo]'")
    path = Path(found.submodule_search_locations[0], "datasets", "data", HEAD)
    return np.divide(_read_nifti(path), 255.0, dtype=np.float32)


def _read_nifti(path: Path) -> np.ndarray:
    """A compressed NIfTI-1 file of unsigned bytes as an array (z, y, x)."""
    data = gzip.decompress(path.read_bytes())
    rank, nx, ny, nz = np.frombuffer(data, "<i2", 4, offset=40)
    (kind,) = np.frombuffer(data, "<i2", 1, offset=70)
    if rank != 3 or kind != NIFTI_UINT8:
        raise ValueError(f"{path} is not a NIfTI volume of unsigned bytes")
    start = int(np.frombuffer(data, "<f4", 1, offset=108)[0])
    return np.frombuffer(data, np.uint8, int(nx) * int(ny) * int(nz), start).reshape(nz, ny, nx)


def cloud(n: int = 128, seed: int = 0) -> np.ndarray:
    """A procedural cumulus cloud: blobs above a flat base, their surface displaced by noise.

    Parameters
    ----------
    n : int
        Voxels along each axis, 1 to 1024.
    seed : int
        Another seed, another cloud.

    Returns
    -------
    array of float32, shape (n, n, n) = (z, y, x), in [0, 1]
        Density, zero in the outermost voxels (from n = 20 on).
    """
    n = integer("n", n, 1, 1024)
    rng = np.random.default_rng(integer("seed", seed, 0, 2**64 - 1))
    axis = ((np.arange(n) + 0.5) / n).astype(np.float32)
    height = _blobs(axis, rng) + np.float32(0.25) * np.clip(_billows(n, rng), -2.0, 3.0)
    density = np.clip((height - 0.2) / 0.3, 0.0, 1.0, dtype=np.float32)
    inside = np.clip(np.minimum(axis, 1.0 - axis) * 20.0 - 0.5, 0.0, 1.0)
    density *= inside[:, None, None] * inside[:, None] * inside
    return density * density * (3.0 - 2.0 * density)


def _blobs(axis: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Largest of 1 - distance / radius over spheres in the unit cube; -1 far from all of them."""
    field = np.full((axis.size,) * 3, -1.0, dtype=np.float32)
    for i in range(56):
        up = rng.random() ** 1.7
        angle, reach = 2.0 * np.pi * rng.random(), 0.31 * (1.0 - 0.8 * up) * np.sqrt(rng.random())
        radius = 0.24 if i == 0 else rng.uniform(0.08, 0.19) * (1.0 - 0.3 * up)
        centre = (0.30 + 0.40 * up, 0.5 + 0.8 * reach * np.sin(angle), 0.5 + reach * np.cos(angle))
        near = tuple(
            slice(*np.searchsorted(axis, (c - 1.6 * radius, c + 1.6 * radius))) for c in centre
        )
        z, y, x = ((axis[s] - np.float32(c)) ** 2 for s, c in zip(near, centre, strict=True))
        distance = np.sqrt(z[:, None, None] + y[:, None] + x)
        field[near] = np.maximum(field[near], 1.0 - distance / np.float32(radius))
    base = np.clip((axis - 0.18) / 0.08, 0.0, 1.0, dtype=np.float32)[:, None, None]
    return field * base - (1.0 - base)


def _billows(n: int, rng: np.random.Generator) -> np.ndarray:
    """Octaves of |noise|, each with zero mean: the creases of a cauliflower."""
    k = np.fft.fftfreq(n, 1.0 / n).astype(np.float32)
    half = np.fft.rfftfreq(n, 1.0 / n).astype(np.float32)
    wave = np.sqrt(k[:, None, None] ** 2 + k[:, None] ** 2 + half**2)
    white = np.fft.rfftn(rng.standard_normal((n, n, n), dtype=np.float32))
    total = np.zeros((n, n, n), dtype=np.float32)
    for octave in range(4):
        centre = 5.0 * 2.0**octave
        band = white * np.exp(-(((wave - centre) / (0.4 * centre)) ** 2))
        noise = np.fft.irfftn(band, s=(n, n, n), axes=(0, 1, 2))
        deviation = noise.std()
        if deviation > 0.0:
            billow = np.abs(noise / deviation)
            total += ((billow - billow.mean()) * 0.5**octave).astype(np.float32)
    return total
