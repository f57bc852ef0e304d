"""The exceptions of the package; the Rust core raises the same classes."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._result import Result


class McrtError(Exception):
    """Base of every error that the package raises.

    Attributes
    ----------
    partial : Result or None
        What a run had finished that the error cut short, as one that was stopped then; None if that
        is nothing.
    """

    partial: "Result | None" = None
    _run: "Callable[..., Result] | None" = None

    def resume(self, progress: "bool | Callable[..., bool | None] | None" = None) -> "Result":
        """Go on from where the run was cut short, on the device opened anew: to the same bits.

        Raises
        ------
        McrtError
            If there is no run to go on with, or if it is cut short again.
        """
        if self._run is None:
            raise McrtError("there is no run to go on with")
        return self._run(progress)

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process gets: all but the run to go on with, which stays in this one."""
        return type(self), self.args, {"partial": self.partial}


class SceneError(McrtError, ValueError):
    """An argument without a meaning: says what was given, what is allowed, and where."""


class VolumeTooLargeError(McrtError, MemoryError):
    """The run needs more memory than there is; `force=True` tries all the same."""


class NoAdapterError(McrtError, RuntimeError):
    """No GPU adapter was found, or the process is a fork of one that used it."""


class DeviceLostError(McrtError, RuntimeError):
    """The GPU was lost in the middle of a run."""
