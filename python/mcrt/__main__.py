"""`python -m mcrt info | demo | chart`."""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import mcrt

from ._info import show_probes
from .chart import chart


def main() -> int:
    """Run the command; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m mcrt", description=mcrt.__doc__.splitlines()[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser(
        "info", help="print version, CPU lanes, threads, GPU adapters; check the GPU"
    )
    shown = commands.add_parser(
        "demo", help="light in a real MRI volume: two pictures, one shot of photons"
    )
    shown.add_argument("--output", type=Path, default=Path("demo"), help="folder of the pictures")
    shown.add_argument("--seed", type=int, default=0)
    drawn = commands.add_parser(
        "chart", help="speed against accuracy of each method, on a small cloud"
    )
    drawn.add_argument("--output", type=Path, default=Path("chart.png"), help="the picture")
    drawn.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.command == "info":
        mcrt.show_info()
        show_probes()
    elif arguments.command == "chart":
        chart(arguments.output, seed=arguments.seed)
    else:
        demo(arguments.output, arguments.seed)
    return 0


def demo(folder: Path, seed: int) -> None:
    """Multiple scattering of a point light in the MRI head: two views from the same photons."""
    start = time.perf_counter()
    light = mcrt.PointLight((300.0, 50.0, 370.0), intensity=1e5)
    target = (98.0, 119.0, 76.0)
    views = {
        "side": mcrt.PerspectiveCamera((420.0, 362.0, 190.0), target, fov=25.0),
        "front": mcrt.PerspectiveCamera((230.0, 470.0, 300.0), target, fov=25.0),
    }
    head = tissue()
    result = mcrt.simulate(
        head, light=light, camera=views["side"], photons=2e6, outputs=["image"], seed=seed
    )
    print(result.plan, result, sep="\n\n", end="\n\n")
    folder.mkdir(parents=True, exist_ok=True)
    for name, camera in views.items():
        path = folder / f"head_{name}.png"
        result.save_png(path, camera)
        print(f"wrote {path}")
    print(f"{time.perf_counter() - start:.1f} s in all")


def tissue() -> mcrt.Medium:
    """The MRI head as a pink, translucent medium in millimetres; what holds no brain is cut off.

    A smooth ramp from the grey value of the fluid between the folds to that of white matter is
    the density, so that the fluid is clear.
    """
    t = np.clip((mcrt.datasets.mni_head() - 0.45) / 0.4, 0.0, 1.0)
    density = t * t * (3.0 - 2.0 * t)
    filled = [np.flatnonzero(density.any(axis=others)) for others in ((1, 2), (0, 2), (0, 1))]
    z, y, x = (slice(int(i[0]), int(i[-1]) + 1) for i in filled)
    return mcrt.Medium(
        density[z, y, x],
        origin=(x.start, y.start, z.start),
        extinction=0.13,
        albedo=(0.985, 0.87, 0.75),
    )


if __name__ == "__main__":
    sys.exit(main())
