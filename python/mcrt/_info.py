"""What the package finds on this machine."""

from typing import Any

from . import _mcrt
from ._device import look_quietly
from ._errors import McrtError


def show_info() -> None:
    """Print the version, the CPU lanes in use, the threads, and the GPU adapters.

    Of each adapter: name; kind and driver; the largest buffer and what of it a kernel may see at
    once; the largest volume. Then what ``backend="auto"`` and ``backend="gpu"`` take.
    """
    look_quietly()
    info = _mcrt.info()
    _show("mcrt", info["version"])
    _show("CPU lanes", info["simd"])
    _show("threads", info["threads"])
    adapters = info["adapters"]
    for adapter in adapters:
        _show(
            "adapter",
            adapter["name"],
            f"{adapter['kind']}; {adapter['driver']}",
            f"buffers up to {_size(adapter['buffer'])}, {_size(adapter['binding'])} in one piece; "
            f"volumes up to {adapter['extent']} voxels along an axis",
        )
    if "refusal" in info:
        _show("backend", '"auto" takes the CPU', f'"gpu" takes nothing: {info["refusal"]}')
    else:
        _show("backend", f'"auto" takes {_auto(adapters)}', f'"gpu" takes {_gpu(adapters)}')


def show_probes() -> None:
    """Run every formula of the shaders on the adapter of ``backend="gpu"``; print those that fail.

    Each is compared with its twin on the CPU and, where there is one, with its double-precision
    truth, within what rounding explains. A driver that compiles a formula wrongly is thus found.
    """
    if not _mcrt.info()["adapters"]:
        return
    try:
        probes = _mcrt.probe()
    except McrtError as error:
        _show("formulas", f"could not be checked: {error}")
        return
    functions = {(file, function) for file, function, *_ in probes}
    wrong = {
        (file, function): f"{function} of {file}.wgsl: {worst:.3g} units in the last place off "
        f"the {against}, {bound:.3g} expected"
        for file, function, against, _, worst, bound in probes
        if not worst <= bound
    }
    if wrong:
        advice = 'its driver compiles them wrongly, use backend="cpu"'
        _show("formulas", f"{len(wrong)} of {len(functions)} disagree with the CPU; {advice}")
        _show("", *wrong.values())
    else:
        _show("formulas", f"all {len(functions)} functions agree with the CPU")


def _show(name: str, *lines: Any) -> None:
    for line in lines:
        print(f"{name:<10} {line}")
        name = ""


def _size(number: int) -> str:
    """Bytes in the unit that suits them."""
    size = float(number)
    for unit in ("B", "KiB", "MiB", "GiB"):
        if size < 1024.0:
            return f"{size:.3g} {unit}"
        size /= 1024.0
    return f"{size:.3g} TiB"


def _auto(adapters: list[dict[str, Any]]) -> str:
    if not adapters:
        return "the CPU, for there is no adapter"
    if adapters[0]["kind"] == "software":
        return "the CPU, for the adapter is only a processor that plays a GPU"
    return f"{adapters[0]['name']}, the fastest kind that there is"


def _gpu(adapters: list[dict[str, Any]]) -> str:
    if not adapters:
        return "nothing: install a driver for Vulkan, Metal or DirectX 12"
    return f"{adapters[0]['name']}"
