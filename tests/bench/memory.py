"""Peak memory above the input, in a process of its own."""

import subprocess
import sys
import time

from table import heading, row

MEMORY = """
import resource, numpy as np, mcrt
n = {n}
volume = np.zeros((n, n, n), np.float32)
part = slice(n // 3, n // 2)
volume[part, part, part] = np.random.default_rng(0).random((n // 2 - n // 3,) * 3, dtype=np.float32)
before = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() // 1024
mcrt.simulate(volume, extinction=4 / n, albedo=0.9, max_scatterings=None, photons={photons},
              light=mcrt.PointLight((2 * n, -n, 3 * n), 1.0), errors=False)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print((after - before) * 1024 / n**3, after / 2**20)
"""


def measure(n, photons):
    start = time.perf_counter()
    code = MEMORY.format(n=n, photons=photons)
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    per_voxel, total = map(float, out.stdout.split())
    note = f"peak {total:.2f} GiB, {time.perf_counter() - start:.0f} s"
    # One private copy of the input is in it: 4 bytes.
    row(f"{n}^3, all outputs, with voxel errors", f"{per_voxel:.0f}", "B/voxel", note)


def run(large=False):
    heading("memory above the input, a sparse volume")
    for n in (256, 512) if large else (256,):
        measure(n, 1e6)
