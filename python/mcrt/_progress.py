"""Progress of a run: a tqdm bar, a function of the user's, or nothing."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ._arguments import wrong

Report = Callable[[float, dict[str, Any]], bool]


@contextmanager
def reporting(progress: Any) -> Iterator[Report | None]:
    """Give the function that the core calls with (fraction done, info), or None.

    It returns False where the run shall stop; what was shot until then is the result.
    """
    if progress is None:
        progress = _somebody_watches() and importlib.util.find_spec("tqdm") is not None
    if progress is False:
        yield None
    elif progress is True:
        with _bar() as report:
            yield report
    elif callable(progress):
        yield lambda fraction, info: not _is_false(progress(fraction, info))
    else:
        raise wrong("progress", "None, True, False or a function (fraction, info)", progress)


def _is_false(value: Any) -> bool:
    return isinstance(value, bool | np.bool_) and not value


def _somebody_watches() -> bool:
    """True in a terminal and in Jupyter."""
    return "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())


@contextmanager
def _bar() -> Iterator[Report]:
    try:
        from tqdm import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install tqdm") from error
    layout = "mcrt {percentage:3.0f} %|{bar}| {elapsed} < {remaining} {postfix}"
    with tqdm(total=1.0, bar_format=layout, leave=False, delay=0.5) as bar:

        def report(fraction: float, info: dict[str, Any]) -> bool:
            if "photons" in info:
                bar.set_postfix_str(f"{info['photons']:.2g} photons", refresh=False)
            bar.update(max(0.0, min(fraction, 1.0) - bar.n))
            return True

        yield report
