"""What a run is to run on."""

import os
from typing import Any

from ._arguments import wrong


def backend(value: Any) -> str:
    """The backend that an argument asks for; the Rust core looks for the adapter."""
    if not isinstance(value, str):
        raise wrong("backend", '"auto", "cpu", "gpu" or "gpu:NAME"', value)
    if value == "auto":
        value = os.environ.get("MCRT_BACKEND") or "auto"
    if value != "cpu":
        look_quietly()
    return value


def look_quietly() -> None:
    """Keep Mesa from asking a desktop that is not there which adapter it prefers.

    It would print an error about XDG_RUNTIME_DIR for each search; the package makes its own choice.
    """
    if "XDG_RUNTIME_DIR" not in os.environ:
        os.environ.setdefault("NODEVICE_SELECT", "1")
