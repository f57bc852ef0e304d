"""The exceptions of the package; the Rust core raises the same classes."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._result import Result


class McrtError(Exception):
    """Base of every error that the package raises."""


class SceneError(McrtError, ValueError):
    """An argument without a meaning: says what was given, what is allowed, and where."""


class VolumeTooLargeError(McrtError, MemoryError):
    """The run needs more memory than there is; `force=True` tries all the same."""


class NoAdapterError(McrtError, RuntimeError):
    """No GPU adapter was found, or the process is a fork of one that used it."""


class DeviceLostError(McrtError, RuntimeError):
    """The GPU was lost in the middle of a run.

    Attributes
    ----------
    partial : Result or None
        What was finished before, as a run that was stopped then; None if that is nothing.
    """

    def __init__(
        self,
        message: str,
        partial: "Result | None" = None,
        run: "Callable[..., Result] | None" = None,
    ) -> None:
        super().__init__(message)
        self.partial = partial
        self._run = run

    def resume(self, progress: "bool | Callable[..., bool | None] | None" = None) -> "Result":
        """Go on from where the run was cut short, on the device opened anew: to the same bits.

        Raises
        ------
        DeviceLostError
            If the device is lost again.
        """
        if self._run is None:
            raise McrtError("there is no run to go on with")
        return self._run(progress)
