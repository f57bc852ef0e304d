"""The Rust core. A scene is parsed once, and kept; nothing else is kept between calls."""

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Scene",
    "Unfinished",
    "check_camera",
    "check_light",
    "check_phase",
    "default_lights",
    "framing_camera",
    "gather",
    "info",
    "lose_device",
    "phase_eval",
    "phase_sample",
    "plan",
    "probe",
    "simulate",
    "unscattered",
]

def check_camera(spec: tuple[Any, ...]) -> None: ...
def check_light(spec: tuple[Any, ...]) -> None: ...
def check_phase(spec: tuple[Any, ...]) -> None: ...
def default_lights(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    origin: tuple[float, float, float],
) -> list[tuple[Any, ...]]: ...
def framing_camera(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    origin: tuple[float, float, float],
) -> tuple[Any, ...]: ...

@final
class Scene:
    def __new__(cls, scene: dict[str, Any]) -> Scene: ...

@final
class Unfinished: ...

def gather(
    scene: Scene,
    volumes: dict[str, Any],
    camera: tuple[Any, ...],
    replicates: bool,
) -> dict[str, NDArray[np.float32]]: ...
def lose_device(backend: str) -> None: ...
def info() -> dict[str, Any]: ...
def phase_eval(spec: tuple[Any, ...], cos_theta: NDArray[np.float64]) -> NDArray[np.float64]: ...
def phase_sample(spec: tuple[Any, ...], n: int, seed: int) -> NDArray[np.float64]: ...
def plan(scene: Scene, settings: dict[str, Any]) -> dict[str, Any]: ...
def probe() -> list[tuple[str, str, str, int, float, float]]: ...
def simulate(
    scene: Scene,
    settings: dict[str, Any],
    progress: Callable[[float, dict[str, Any]], bool | None] | None,
    before: Unfinished | None = None,
) -> dict[str, Any]: ...
def unscattered(
    scene: Scene, settings: dict[str, Any], energy: dict[str, NDArray[np.float64]] | None
) -> dict[str, Any]: ...
