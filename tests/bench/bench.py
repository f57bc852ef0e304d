"""How fast it is: `make bench` prints one table, each ratio's two sides timed in the same run.

Seconds are the shortest of a few runs, which other load on the machine disturbs least.

    python tests/bench/bench.py [--large] [GROUP ...]

runs the groups named, or all of them, and keeps the table in target/bench/table.txt.
"""

import argparse
import contextlib
import os
import time

import backends
import cloud
import cube60
import mcrt
import memory
import path
import scaling
import seed
import specialise
import table
import volpath
from peers import BENCH

# The other groups compare the CPU's.
os.environ.setdefault("MCRT_BACKEND", "cpu")

GROUPS = {
    "cube60": cube60.run,
    "cloud": cloud.run,
    "mitsuba": volpath.run,
    "path": path.run,
    "seed": seed.run,
    "specialise": specialise.run,
    "scaling": scaling.run,
    "memory": memory.run,
    "backends": backends.run,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("group", nargs="*", metavar="GROUP", help=", ".join(GROUPS))
    parser.add_argument("--large", action="store_true", help="512^3 too")
    arguments = parser.parse_args()
    if unknown := set(arguments.group) - set(GROUPS):
        parser.error(f"no such group: {', '.join(sorted(unknown))}; there are {', '.join(GROUPS)}")
    info = mcrt._mcrt.info()
    start = time.perf_counter()
    table.line(f"mcrt {info['version']}, lanes {info['simd']}, {info['threads']} threads")
    with contextlib.suppress(OSError):
        table.line(f"load before the start {os.getloadavg()[0]:.1f}")
    try:
        for name in arguments.group or GROUPS:
            GROUPS[name](large=arguments.large)
        table.line(f"\n{time.perf_counter() - start:.0f} s in all")
    finally:
        BENCH.mkdir(parents=True, exist_ok=True)
        (BENCH / "table.txt").write_text("\n".join(table.LINES) + "\n")


if __name__ == "__main__":
    main()
