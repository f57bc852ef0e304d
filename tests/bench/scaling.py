"""How cost grows with each parameter of a scene: rows, and target/bench/scaling.png.

Rates are those of the photon stage; what comes before it (light grid) and after (estimate) is in
the note. A rate of collisions that does not fall is a cost that is linear in collisions.
"""

import os

import mcrt
import numpy as np
from peers import BENCH
from table import heading, number, row

SIDE, DEPTH, PHOTONS = 64, 10.0, 1e6
MEDIA = ("box", "cloud")


def sweeps(large):
    cores = os.cpu_count()
    doubled = [2**i for i in range(cores.bit_length()) if 2**i < cores]
    return {
        "volume": [32, 64, 128, 256, *([512] if large else [])],
        "optical depth": [0.1, 1.0, 10.0, 100.0, 1000.0],
        "albedo": [0.1, 0.5, 0.9, 0.99, 1.0],
        "g": [-0.5, 0.0, 0.5, 0.9, 0.99],
        "threads": [*doubled, cores],
    }


def density(medium, side):
    """Constant, or a cloud that has the same shape at every size."""
    if medium == "box":
        return np.ones((side,) * 3, np.float32)
    values = mcrt.datasets.cloud(32)
    for axis in range(3):
        values = values.repeat(side // 32, axis)
    return values


def measure(medium, parameter, value):
    side = value if parameter == "volume" else SIDE
    g = value if parameter == "g" else 0.0
    depth = value if parameter == "optical depth" else DEPTH
    result = mcrt.simulate(
        density(medium, side),
        extinction=depth / side,
        albedo=value if parameter == "albedo" else 0.9,
        phase=mcrt.HenyeyGreenstein(g) if g else mcrt.Isotropic(),
        light=mcrt.DirectionalLight((0.3, 0.2, -1.0), 1.0),
        threads=value if parameter == "threads" else None,
        method="photon",
        photons=PHOTONS,
        outputs=("image",),
        errors=False,
        progress=False,
    )
    return result.stats


def run(large=False):
    base = f"{SIDE}^3, optical depth {DEPTH:g}, albedo 0.9, isotropic"
    heading(f"scaling: {base}, unless said; {PHOTONS:.0e} photons a run")
    found = {}
    for parameter, values in sweeps(large).items():
        for medium in MEDIA:
            for value in values:
                stats = measure(medium, parameter, value)
                seconds = stats.seconds
                rates = [count / seconds["photons"] for count in (stats.photons, stats.collisions)]
                found[parameter, medium, value] = rates
                others = seconds["light grid"] + seconds["estimate"]
                note = f"{rates[1] / 1e6:8.2f} M collisions/s, other stages {others:.2f} s"
                name = f"{value}^3" if parameter == "volume" else f"{parameter} {value:g}"
                row(f"{medium}, {name}", number(rates[0] / 1e6), "M photons/s", note)
    plot(found)


def plot(found):
    try:
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError as error:
        row("plot", "MISSING", "", str(error))
        return
    parameters = list(dict.fromkeys(key[0] for key in found))
    figure, axes = plt.subplots(1, len(parameters), figsize=(17, 4), sharey=True, layout="tight")
    for panel, parameter in zip(axes, parameters, strict=True):
        for colour, medium in enumerate(MEDIA):
            points = {
                key[2]: rates for key, rates in found.items() if key[:2] == (parameter, medium)
            }
            photons, collisions = 1e-6 * np.array(list(points.values())).T
            style = {"color": f"C{colour}", "marker": "o"}
            panel.plot(list(points), photons, "-", label=f"{medium}, photons", **style)
            panel.plot(list(points), collisions, "--", label=f"{medium}, collisions", **style)
        logarithmic = parameter in ("volume", "optical depth")
        panel.set(xlabel=parameter, xscale="log" if logarithmic else "linear", yscale="log")
        panel.grid(alpha=0.3)
    sides = [key[2] for key in found if key[0] == "volume"]
    axes[0].set_xticks(sides, [f"{side}³" for side in sides])
    axes[0].minorticks_off()
    threads = sorted({key[2] for key in found if key[0] == "threads"})
    axes[-1].set_xticks(threads)
    axes[0].set_ylabel("million per second")
    axes[0].yaxis.set_major_formatter("{x:g}")
    axes[0].legend()
    BENCH.mkdir(parents=True, exist_ok=True)
    figure.savefig(BENCH / "scaling.png", dpi=120)
    plt.close(figure)
    row("plot", "", "", str(BENCH / "scaling.png"))
