"""`python -m mcrt info | demo`."""

import argparse
import sys
from pathlib import Path

import mcrt


def main() -> int:
    """Run the command; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m mcrt", description=mcrt.__doc__.splitlines()[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("info", help="print version, CPU lanes, threads, GPU adapters")
    shown = commands.add_parser(
        "demo", help="light in a real MRI volume: two pictures, one shot of photons"
    )
    shown.add_argument("--output", type=Path, default=Path("demo"), help="folder of the pictures")
    shown.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.command == "info":
        mcrt.show_info()
    else:
        demo(arguments.output, arguments.seed)
    return 0


def demo(folder: Path, seed: int) -> None:
    """Multiple scattering of a point light in the MRI head: two views from the same photons."""
    head = mcrt.Medium(mcrt.datasets.mni_head(), extinction=0.5, albedo=0.97)
    light = mcrt.PointLight((320.0, 420.0, 330.0), intensity=1e5)
    front = mcrt.PerspectiveCamera((480.0, 420.0, 260.0), (98.0, 110.0, 88.0), fov=28.0)
    side = mcrt.PerspectiveCamera((-120.0, 620.0, 200.0), (98.0, 110.0, 88.0), fov=28.0)
    result = mcrt.simulate(head, light=light, camera=front, seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    for name, camera in {"front": front, "side": side}.items():
        path = folder / f"head_{name}.png"
        result.save_png(path, camera)
        print(f"wrote {path}")
    print(result.plan, result, sep="\n\n")


if __name__ == "__main__":
    sys.exit(main())
