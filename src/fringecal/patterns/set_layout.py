"""A whole set of patterns for a projector: which frames in which order, and the document that describes them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fringecal.errors import PhaseError
from fringecal.patterns.code_frames import gray_frames
from fringecal.patterns.frame_drawing import (
    Axis,
    Frame,
    Raster,
    demand_contrast,
    demand_period,
    flat_frame,
    fringe_frame,
)
from fringecal.patterns.pattern_charts import alignment_chart, focus_chart

FORMAT = 1
Code = Literal["none", "plain", "complementary"]
_MOST_FRAMES = 2000  # of a set: a projector's memory, and a minute of camera frames


@dataclass(frozen=True)
class Pattern:
    """One frame.

    Parameters
    ----------
    file
        Name of its picture.
    kind
        "fringes", "gray", "white", "black", "focus" or "alignment".
    draw
        Draws it.
    axis, period_px, shift_deg, bit
        What it shows, where it has such.
    """

    file: str
    kind: str
    draw: Callable[[], Frame]
    axis: Axis | None = None
    period_px: float | None = None
    shift_deg: float | None = None
    bit: int | None = None


@dataclass(frozen=True)
class PatternSet:
    """Frames in the order in which they are shown: axis, period, phase shift; then codes, white and black, charts."""

    raster: Raster
    axes: tuple[Axis, ...]
    periods_px: dict[Axis, tuple[float, ...]]
    steps_deg: tuple[float, ...]
    code: Code
    patterns: tuple[Pattern, ...]

    def files(self, kind: str, axis: Axis | None = None) -> list[str]:
        """Return names of the frames of a kind, and of an axis where one is given."""
        return [one.file for one in self.patterns if one.kind == kind and (axis is None or one.axis == axis)]


def pattern_set(
    raster: Raster,
    axes: Sequence[Axis],
    periods_px: dict[Axis, tuple[float, ...]],
    *,
    steps: int = 4,
    code: Code = "none",
    contrast: float = 1.0,
    dithered: bool = False,
    charts: bool = False,
) -> PatternSet:
    """Lay out a set; frames are drawn when they are asked for.

    Parameters
    ----------
    raster
        The projector.
    axes
        "u", "v" or both, in their order.
    periods_px
        Of each axis, px.
    steps
        Evenly spaced phase shifts, three at least.
    code
        Gray code of the shortest period: none, plain, or with complements.
    contrast, dithered
        As for `fringecal.patterns.fringe_frame`.
    charts
        Whether focus and alignment charts are in it.

    Raises
    ------
    PhaseError
        Fewer than three steps, an axis without a period, or what cannot be drawn.
    """
    _demand(raster, axes, periods_px, steps)
    demand_contrast(contrast)
    shifts = tuple(360.0 * k / steps for k in range(steps))
    found: list[Pattern] = []
    for axis in axes:
        for number, period in enumerate(periods_px[axis]):
            found += _fringes(raster, axis, (number, period), shifts, contrast, dithered=dithered)
    for axis in axes if code != "none" else ():
        found += _codes(raster, axis, min(periods_px[axis]), complementary=code == "complementary")
    found.append(Pattern("white.png", "white", lambda: flat_frame(raster, 1.0)))
    found.append(Pattern("black.png", "black", lambda: flat_frame(raster, 0.0)))
    if charts:
        found.append(Pattern("focus.png", "focus", lambda: focus_chart(raster)))
        found.append(Pattern("alignment.png", "alignment", lambda: alignment_chart(raster)))
    return PatternSet(raster, tuple(axes), dict(periods_px), shifts, code, tuple(found))


def patterns_document(found: PatternSet) -> dict[str, Any]:
    """Return what `patterns.toml` says: the projector, the keys of a session's capture, and each frame.

    Periods and axes are those of the session format, so that `capture` can be copied into a session as it stands.
    """
    both = {axis: list(found.periods_px[axis]) for axis in found.axes}
    alike = len({tuple(each) for each in both.values()}) == 1
    capture: dict[str, Any] = {
        "axes": list(found.axes),
        "periods": next(iter(both.values())) if alike else both,
        "zeros_deg": [0.0] * len(next(iter(both.values()))) if alike else {a: [0.0] * len(p) for a, p in both.items()},
        "falling": [],
        "images": found.files("fringes"),
    }
    if found.code != "none":
        codes = {axis: found.files("gray", axis) for axis in found.axes}
        capture["gray"] = codes if len(codes) > 1 else next(iter(codes.values()))
    capture |= {"white": found.files("white"), "black": found.files("black")}
    return {
        "format": FORMAT,
        "projector": {
            "resolution_px": [found.raster.width_px, found.raster.height_px],
            "bits": found.raster.bits,
            "response_undone": found.raster.response is not None,
        },
        "phase": {"steps_deg": list(found.steps_deg)},
        "capture": capture,
        "pattern": [
            {"file": one.file, "kind": one.kind, "axis": one.axis, "period_px": one.period_px}
            | {"shift_deg": one.shift_deg, "bit": one.bit}
            for one in found.patterns
        ],
    }


def _demand(raster: Raster, axes: Sequence[Axis], periods_px: dict[Axis, tuple[float, ...]], steps: int) -> None:
    if steps < 3:
        raise PhaseError(f"{steps} phase shifts; three at least are needed for background, modulation and phase")
    if not axes or len(set(axes)) != len(axes):
        raise PhaseError("one axis or both, each once, are needed: u, v")
    for axis in axes:
        if not periods_px.get(axis):
            raise PhaseError(f"axis {axis} has no period")
    if steps * sum(len(periods_px[axis]) for axis in axes) > _MOST_FRAMES:
        raise PhaseError(f"more than {_MOST_FRAMES} frames in a set")
    for axis, period in ((name, each) for name in axes for each in periods_px[name]):
        demand_period(period, raster.extent_px(axis))  # what cannot be drawn is refused before anything is


def _fringes(
    raster: Raster,
    axis: Axis,
    numbered: tuple[int, float],
    shifts_deg: Sequence[float],
    contrast: float,
    *,
    dithered: bool,
) -> list[Pattern]:
    number, period = numbered

    def drawn(shift_deg: float) -> Callable[[], Frame]:
        shift = math.radians(shift_deg)
        return lambda: fringe_frame(raster, axis, period, shift, contrast=contrast, dithered=dithered)

    return [
        Pattern(f"{axis}-{number}-{k}.png", "fringes", drawn(shift), axis, period, shift)
        for k, shift in enumerate(shifts_deg)
    ]


def _codes(raster: Raster, axis: Axis, period: float, *, complementary: bool) -> list[Pattern]:
    frames = gray_frames(raster, axis, period, complementary=complementary)

    def drawn(k: int) -> Callable[[], Frame]:
        return lambda: np.asarray(frames[k])

    return [Pattern(f"{axis}-gray-{k:02d}.png", "gray", drawn(k), axis, period, bit=k) for k in range(len(frames))]
