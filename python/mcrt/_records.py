"""Dictionaries whose entries are attributes too: the plan, the energy balance, the statistics."""

import html
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

FACES = ("-x", "+x", "-y", "+y", "-z", "+z")


class Record(dict[str, Any]):
    """A dictionary whose entries are attributes too."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(
                f"{type(self).__name__} has no {name!r}, it has: {', '.join(self)}"
            ) from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]


class Energy(Record):
    """Where the light went: `launched` [W], and fractions of it.

    `missed` the volume, `unscattered` through it (or out of it, of light that it emits),
    `absorbed`, `truncated` at the last order, `roulette` (net, zero mean), `escaped` by face
    `-x +x -y +y -z +z` after at least one scattering; `error` is the standard error of their sum,
    `unscattered_error` and `absorbed_error` those of these parts, `imbalance` the sum - 1 as it was
    found. Each is tallied or integrated by itself. Floats where the scene is grey, arrays of shape
    (3,) where it is RGB.
    """

    def sum(self) -> float | np.ndarray:
        """Sum of all fractions: 1 but for the errors of the run."""
        parts = ("missed", "unscattered", "absorbed", "truncated", "roulette")
        return sum(self[part] for part in parts) + sum(self["escaped"].values())


def energy(raw: dict[str, np.ndarray]) -> Energy:
    """The energy balance from the core's entries, arrays of shape (channels,)."""
    flat = {
        name: float(values[0]) if len(values) == 1 else np.array(values)
        for name, values in raw.items()
    }
    escaped = Record({face: flat.pop(f"escaped_{face}") for face in FACES})
    return Energy(flat, escaped=escaped)


class Plan(Record):
    """What runs, why, and at what cost: prints like a database's EXPLAIN.

    Entries: `method`, `tracker`, `backend`, `channels`, `photons`, `batches`, `subvolumes`,
    `decisions` (name, choice, reason), `bytes`, `bytes_by_part`, `seconds` (an estimate).
    """

    _scene: tuple[dict[str, Any], dict[str, Any]] | None = None  # and settings, of `mcrt.plan`

    def rows(self) -> list[tuple[str, str, str]]:
        """The lines of the plan: name, choice, reason."""
        parts = sorted(self.bytes_by_part.items(), key=lambda part: -part[1])
        memory = ", ".join(f"{name} {show_bytes(size)}" for name, size in parts)
        shots = f"{self.photons:.3g} photons, {self.batches} batches, {self.subvolumes} sub-volumes"
        if self.method == "path":
            shots = f"{self.photons:.3g} paths, {self.batches} view rays a pixel"
        return [
            *((str(name), str(choice), str(reason)) for name, choice, reason in self.decisions),
            ("memory", show_bytes(self.bytes), memory),
            ("time", f"{self.seconds:.2g} s", f"estimate for {shots}"),
        ]

    def __str__(self) -> str:
        rows = self.rows()
        width = max(len(name) for name, _, _ in rows)
        lines = [f"mcrt plan: {self.method} on {self.backend}, tracker {self.tracker}"]
        for name, choice, reason in rows:
            text = f"{choice} -- {reason}" if reason else choice
            head, indent = f"  {name:<{width}}  ", " " * (width + 4)
            lines += textwrap.wrap(
                text, 100, initial_indent=head, subsequent_indent=indent, break_on_hyphens=False
            )
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return table(self.rows())


def table(rows: Sequence[tuple[str, ...]]) -> str:
    """Rows of text as an HTML table, the first cell of each row in bold."""
    cell = '<td style="text-align:left">'
    lines = []
    for first, *rest in rows:
        cells = "".join(f"{cell}{html.escape(text)}</td>" for text in rest)
        lines.append(f"<tr>{cell}<b>{html.escape(first)}</b></td>{cells}</tr>")
    return "<table>" + "".join(lines) + "</table>"


def show_bytes(size: float) -> str:
    """A size in the unit that suits it."""
    for unit in ("B", "KiB", "MiB"):
        if size < 1024:
            return f"{size:.4g} {unit}"
        size /= 1024
    return f"{size:.4g} GiB"
