"""MCX's cube60 with its fluence volume, against pmcxcl on the same cores."""

import mcrt
import numpy as np
from peers import MissingPeerError, pmcxcl_cube60
from table import heading, number, row, timed

PHOTONS, PEER_PHOTONS = 2e6, 2e5
SEEDS = range(1, 6)


def scene(**options):
    """The case as pmcxcl.bench has it; its 5 ns end after the light has."""
    arguments = {
        "volume": np.ones((60, 60, 60), np.float32),
        "extinction": 1.005,
        "albedo": 1 / 1.005,
        "phase": mcrt.HenyeyGreenstein(0.01),
        "light": mcrt.PencilBeam((29, 29, -1), (0, 0, 1), 1.0),
        "interpolation": "nearest",
        "outputs": ("fluence",),
        "errors": False,
        "progress": False,
    }
    return arguments | options


def relative_variance(runs, bright):
    """R^2 of one run: mean over voxels of the variance over the squared mean."""
    runs = np.asarray(runs, np.float64)[:, bright]
    return np.mean(runs.var(0, ddof=1) / runs.mean(0) ** 2)


def run(large=False):
    heading("cube60, fluence volume (R: spread over seeds, voxels above 1e-4 of the maximum)")
    mcrt.simulate(**scene(photons=1e5))  # warms up
    runs = [timed(mcrt.simulate, **scene(photons=PHOTONS, seed=seed)) for seed in SEEDS]
    fluence = np.array([result.fluence for result, _ in runs])
    seconds = min(seconds for _, seconds in runs)
    absorbed = np.mean([result.energy.absorbed for result, _ in runs])
    bright = fluence.mean(0) > 1e-4 * fluence.mean(0).max()
    variance = relative_variance(fluence, bright)
    rate = PHOTONS / seconds
    row("mcrt", number(rate / 1e6), "M photons/s", f"wall time; absorbed {absorbed:.4f}")
    row("  R of one run", f"{100 * np.sqrt(variance):.2f}", "%", f"{PHOTONS:.0e} photons")
    try:
        peer = pmcxcl_cube60(PEER_PHOTONS, SEEDS)
    except MissingPeerError as error:
        row("pmcxcl 0.7.5", "MISSING", "", f"NOT COMPARED: {error}")
        return
    peer_rate = PEER_PHOTONS / peer.seconds
    note = f"its own run time, without compilation; absorbed {peer.absorbed:.4f}"
    row("pmcxcl 0.7.5, Intel OpenCL", number(peer_rate / 1e6), "M photons/s", note)
    exact_rate = PEER_PHOTONS / peer.exact_seconds
    note = f"without its fast mathematics; absorbed {peer.exact_absorbed:.4f}"
    row("  with optlevel=0", number(exact_rate / 1e6), "M photons/s", note)
    peer_variance = relative_variance(peer.fluence, bright)
    row("  R of one run", f"{100 * np.sqrt(peer_variance):.2f}", "%", f"{PEER_PHOTONS:.0e} photons")
    shapes = [runs.mean(0)[bright] / runs.mean(0)[bright].sum() for runs in (fluence, peer.fluence)]
    offset = np.median(shapes[0] / shapes[1]) - 1
    note = f"shape of the fluence: median voxel {100 * offset:+.2f} % from pmcxcl's"
    row("photons/s, mcrt over pmcxcl", number(rate / peer_rate), "x", note)
    merit = peer_variance * peer.seconds / (variance * seconds)
    row("figure of merit 1 / (R^2 T), mcrt over pmcxcl", number(merit), "x")
