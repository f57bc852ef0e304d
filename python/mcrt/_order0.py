"""Adding what the core finds without photons, unscattered light, to what photons left."""

from typing import Any

import numpy as np


def whole(data: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """The entries of a run's data that change when order 0 is added to them.

    Values add up; the standard errors of what is independent do in quadrature.
    """
    changed: dict[str, Any] = {"order0": True}
    for name, values in found.items():
        if name == "energy":
            changed[name] = values
        else:
            changed[name] = (np.hypot if name.endswith("_error") else np.add)(data[name], values)
    return changed
