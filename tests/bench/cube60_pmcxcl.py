"""Runs in pmcxcl's own environment: FILE PHOTONS SEED ...; writes the fluence, prints the rest."""

import json
import os
import sys

report = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # pmcxcl's log is no part of the report

import numpy as np  # noqa: E402
import pmcxcl  # noqa: E402


def run(photons, seed, level):
    case = dict(pmcxcl.bench["cube60"])
    case |= {"gpuid": 1, "compileropt": "-cl-std=CL3.0", "optlevel": level}
    return pmcxcl.run(case | {"nphoton": photons, "seed": seed})


def summary(results):
    """Shortest seconds, mean fraction absorbed."""
    stats = [result["stat"] for result in results]
    seconds = [stat["runtime"] / 1000 for stat in stats]
    absorbed = [stat["energyabs"] / stat["energytot"] for stat in stats]
    return min(seconds), float(np.mean(absorbed))


file, photons, *seeds = sys.argv[1:]
run(10_000, 999, 3)
fast, exact = (
    [run(int(photons), int(seed), level) for seed in chosen]
    for level, chosen in ((3, seeds), (0, seeds[:3]))
)
np.save(file, [result["flux"][..., 0] for result in fast])
json.dump({"fast": summary(fast), "exact": summary(exact)}, report)
report.close()
