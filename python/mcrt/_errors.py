"""The exceptions of the package; the Rust core raises the same classes."""


class McrtError(Exception):
    """Base of every error that the package raises."""


class SceneError(McrtError, ValueError):
    """An argument without a meaning: says what was given, what is allowed, and where."""


class VolumeTooLargeError(McrtError, MemoryError):
    """The run needs more memory than there is; `force=True` tries all the same."""


class NoAdapterError(McrtError, RuntimeError):
    """No GPU adapter was found."""


class DeviceLostError(McrtError, RuntimeError):
    """The GPU was lost in the middle of a run."""
