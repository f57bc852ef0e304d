"""The one table: groups add rows, printed as they come and kept for the file."""

import os
import time

LINES = []


def line(text=""):
    print(text, flush=True)
    LINES.append(text)


def heading(text):
    line(f"\n{text}")


def row(name, value, unit="", note=""):
    line(f"  {name:<58} {value:>9} {unit:<14} {note}".rstrip())


def number(value):
    """Three digits, without an exponent where it is not needed."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def stages(result):
    """Seconds by stage, without the gather that `result.stats` makes for its errors."""
    return result._data["stats"]["seconds"]


def timed(call, *arguments, **options):
    start = time.perf_counter()
    result = call(*arguments, **options)
    return result, time.perf_counter() - start


def busy(call, *arguments, **options):
    """What it returns, and its processor seconds, over the cores."""
    start = time.process_time()
    result = call(*arguments, **options)
    return result, (time.process_time() - start) / os.cpu_count()
