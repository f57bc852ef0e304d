"""The cloud's image by Mitsuba's volpath on the same cores, at about 1 %."""

import cloud
import numpy as np
from peers import MissingPeerError, mitsuba, mitsuba_scene
from table import heading, number, row, timed

SAMPLES, GOAL, PILOT = 16, 0.01, 1.5e6


def run(large=False):
    heading("cloud against Mitsuba volpath, its time extrapolated from its variance by 1 / N")
    try:
        mi = mitsuba()
    except MissingPeerError as error:
        row("Mitsuba", "MISSING", "", f"NOT COMPARED: {error}")
        return
    for side in (64, 256):
        compare(mi, side)


def compare(mi, side):
    size = f"{side} x {side}"
    pilot = cloud.typical([cloud.measure(side, PILOT, seed) for seed in (11, 12)])
    photons = np.clip(round(PILOT * pilot.square / GOAL**2), 1e5, 1e8)
    ours = cloud.typical([cloud.measure(side, photons, seed) for seed in cloud.SEEDS])
    error = f"{100 * ours.error():.2f} %"
    row(f"mcrt, {size}, to {error}", f"{ours.whole:.2f}", "s", f"{photons:.2g} photons")

    arguments = cloud.scene(cloud.camera(side))
    loaded = mi.load_dict(mitsuba_scene(mi, cloud.volume(), arguments))

    def render(seed):
        return np.array(mi.render(loaded, spp=SAMPLES, seed=seed))[..., 0]

    render(0)  # compiles
    runs = [timed(render, seed) for seed in range(1, 5)]
    images, seconds = np.array([image for image, _ in runs]), min(s for _, s in runs)
    truth = cloud.truth(side)[0]
    bright = truth > 0.05 * truth.max()
    variance = images.var(0, ddof=1)[bright].mean() / truth[bright].mean() ** 2
    offset = images[:, bright].mean() / truth[bright].mean() - 1
    needed = seconds * variance / ours.square
    note = f"{seconds:.2f} s; its mean {100 * offset:+.2f} % from mcrt's"
    row(f"  Mitsuba, {SAMPLES} samples a pixel: error", f"{100 * np.sqrt(variance):.1f}", "%", note)
    row(f"  Mitsuba, extrapolated to {error}", number(needed), "s")
    row("  time, Mitsuba over mcrt", number(needed / ours.whole), "x")
