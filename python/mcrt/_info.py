"""What the package finds on this machine."""

from . import _mcrt


def show_info() -> None:
    """Print the version, the CPU lanes in use, the threads, and the GPU adapters."""
    info = _mcrt.info()
    rows = [
        ("mcrt", info["version"]),
        ("CPU lanes", info["simd"]),
        ("threads", info["threads"]),
        ("GPU", "not yet available"),
    ]
    for name, value in rows:
        print(f"{name:<10} {value}")
