"""Every triple of features against Mitsuba 3: target/validate/mitsuba.txt and mitsuba.png.

    python tests/validate.py [SHARE]

With a share below 1, only that share of the cases. Fails where a comparison does.
"""

import sys
import time
from pathlib import Path

import matplotlib.pyplot as plt
import mitsuba_cases as suite
import mitsuba_reference
import numpy as np
from scipy import stats

TO = Path(__file__).parents[1] / "target" / "validate"
PICTURES = 6


def kolmogorov_smirnov(z):
    return stats.kstest(z, "norm").pvalue if len(z) else np.nan


def summary(found):
    """Rows: method, cases, worst z beyond the allowance, p of all z, p of the images' means."""
    rows = []
    for method in (*suite.AXES["method"], "all"):
        of = [f for case, f in found if method in (case["method"], "all")]
        if not of:
            continue
        z = np.concatenate([f.z.ravel() for f in of])
        first = np.array([f.z[0] for f in of])
        worst = max(np.abs(f.z_beyond).max() for f in of)
        rows.append(
            f"{method:<8} {len(of):>5} {z.size:>12} {worst:>8.2f} {np.std(z):>8.2f} "
            f"{kolmogorov_smirnov(z):>12.2g} {kolmogorov_smirnov(first):>14.2g}"
        )
    return rows


def pictures(chosen, found):
    """Ours, Mitsuba, their difference; the histogram of z below."""
    rows = len(chosen) + 1
    figure, axes = plt.subplots(rows, 3, figsize=(10, 3 * rows), squeeze=False)
    for row, (case, ours, true) in zip(axes, chosen, strict=False):
        scale = true.max()
        for axis, image, title in zip(
            row,
            (ours / scale, true / scale, 5 * (ours - true) / scale + 0.5),
            (suite.name(case), "Mitsuba", "5 x difference, 0 is grey"),
            strict=True,
        ):
            axis.imshow(np.clip(image, 0, 1), cmap="gray", vmin=0, vmax=1)
            axis.set_title(title, fontsize=6)
            axis.axis("off")
    x = np.linspace(-5, 5, 200)
    for axis, method in zip(axes[-1], suite.AXES["method"], strict=True):
        of = [f.z.ravel() for case, f in found if case["method"] == method]
        if of:
            axis.hist(np.concatenate(of), 50, range=(-5, 5), density=True)
        axis.plot(x, stats.norm.pdf(x))
        axis.set_title(f"{method}: z, and N(0, 1)", fontsize=8)
    figure.tight_layout()
    figure.savefig(TO / "mitsuba.png", dpi=110)


def main(share=1.0):
    cases = suite.covering(3)
    cases = cases[:: max(1, round(1 / share))]
    level, start = suite.level(cases), time.perf_counter()
    TO.mkdir(parents=True, exist_ok=True)
    found, chosen, lines = [], [], []
    for case in cases:
        true, true_image = mitsuba_reference.reference(case, suite.VALIDATE)
        ours, image = suite.ours(case, suite.VALIDATE)
        one = suite.compare(case, ours, true)
        found.append((case, one))
        if true_image.size and len(chosen) < PICTURES and len(found) % (len(cases) // 9 + 1) == 0:
            chosen.append((case, image, true_image))
        verdict = "ok" if one.p.min() > level else "FAILS"
        lines.append(f"{verdict:<6} p {one.p.min():8.1e}  {one}  {suite.name(case)}")
        print(lines[-1], flush=True)
    failures = sum(line.startswith("FAILS") for line in lines)
    head = [
        f"{len(cases)} cases, {failures} fail at {suite.ALPHA} for all of them together; "
        f"{(time.perf_counter() - start) / 60:.0f} minutes",
        "",
        "method   cases  comparisons  worst z  std of z  KS p of all z  KS p of the means",
        *summary(found),
        "",
        "worst z: beyond the allowed bias; the other columns: without any allowance. Blocks of one",
        "image share the photons of `photon`: its p of all z takes them for independent.",
        "",
    ]
    text = "\n".join(head + lines) + "\n"
    (TO / "mitsuba.txt").write_text(text)
    pictures(chosen, found)
    print("\n".join(head))
    return failures


if __name__ == "__main__":
    sys.exit(bool(main(*map(float, sys.argv[1:]))))
