"""A capture's frames become a phase map: with the model as stated, or as the frames show it."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError, SessionError
from fringecal.phase import (
    ADAPTATION_RULES,
    Adapted,
    FringeOrders,
    PhaseMap,
    PhaseShiftEstimate,
    Waveform,
    decide_orders,
    demodulate_adapted,
    mean_of_repeats,
    orders_by_gray,
)
from fringecal.session import Capture

# Pixels move by whole phase shifts all over a raster, where a mirror that turns does not; edges of a board's squares
# would pass for shifts that change over the field.
# Of large pictures a million pixels hold a hundred blocks and more: phase shifts of a raster are the same everywhere.
_RASTER_RULES = replace(ADAPTATION_RULES, change_rad=math.inf, most_pixels=1e6)

BORDER_PX = 3  # what blurs or filters a picture lacks neighbours there, and a fringe's phase is pulled aside


def within_border(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask a picture's border of `BORDER_PX` pixels: true inside."""
    inside = np.zeros(shape, dtype=np.bool_)
    inside[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = True
    return inside


@dataclass(frozen=True)
class CapturePhase:
    """The phase of one capture, and how its frames differ from what is stated of them."""

    capture: Capture
    adapted: Adapted
    orders: FringeOrders | None = None

    @property
    def map(self) -> PhaseMap:
        """The phase map of the shortest period, corrected, with its orders where further periods decide them."""
        return replace(self.adapted.map, orders=self.orders)

    def again(self, frames: ArrayLike) -> PhaseMap:
        """Demodulate other frames of the same set, such as filtered ones, with the same corrections and orders."""
        map_ = self.adapted.again(frames, white_level=self.capture.white_level)
        return map_ if self.orders is None else replace(map_, orders=self.orders.of(map_.phase))

    @property
    def phase_shifts_rad(self) -> tuple[float, ...]:
        """Phase shifts that were used, rad."""
        return self.adapted.scheme.phase_shifts_rad

    @property
    def estimated(self) -> PhaseShiftEstimate | None:
        """Phase shifts estimated from the frames; None where that is impossible, with the reason in the notes."""
        return self.adapted.phase_shifts

    @property
    def used(self) -> str:
        """Which phase shifts were used: "stated" or "estimated"."""
        return "stated" if self.phase_shifts_rad == tuple(self.capture.phase_shifts_rad) else "estimated"

    def sentence(self) -> str:
        """State which model was used and why."""
        stated = ", ".join(f"{math.degrees(s):.1f}" for s in self.capture.phase_shifts_rad)
        notes = "".join(f"; {note}" for note in self.adapted.notes)
        notes += "" if self.orders is None else f"; {self.orders.sentence()}"
        if not self.adapted.undone:
            return f"{self.capture.name}: phase shifts as stated ({stated} deg){notes}."
        undone = "; ".join(self.adapted.undone)
        return f"{self.capture.name}: the frames do not fit the stated model ({stated} deg): {undone}{notes}."


def phase_of_capture(capture: Capture, *, wave: Waveform | None = None) -> CapturePhase:
    """Demodulate a capture; where the stated model of its frames does not fit, by one that is estimated from them.

    Parameters
    ----------
    capture
        A phase-shifted capture. Of several fringe periods the shortest gives the phase, the others its orders.
    wave
        Waveform as found on the bare plate.

    Raises
    ------
    SessionError
        The capture states no phase shifts.
    PhaseError
        The frames hold no phase, or contradict the stated periods.
    """
    if not capture.phase_shifts_rad:
        raise SessionError(
            [f"capture {capture.name!r}: no phase shifts; state steps_deg under [phase] or in the capture"]
        )
    adapted = adapted_set(capture, shortest_period(capture), wave)
    if not adapted.map.valid.any():
        raise PhaseError(
            f"capture {capture.name!r}: no pixel carries fringes ({why_masked(adapted.map)}). Check projector, focus "
            "and exposure, and that the frames are those of a phase-shifted set."
        )
    return CapturePhase(capture, adapted, _orders(capture, adapted))


def shortest_period(capture: Capture) -> int:
    """Return the number of the set with the shortest fringes, which carries the phase."""
    return int(np.argmin(capture.periods)) if capture.periods else 0


def adapted_set(capture: Capture, period: int, wave: Waveform | None) -> Adapted:
    """Demodulate one of a capture's sets."""
    frames = frames_of(capture, period=period)
    rules = _RASTER_RULES if capture.axes else ADAPTATION_RULES
    return demodulate_adapted(frames, capture.phase_shifts_rad, white_level=capture.white_level, wave=wave, rules=rules)


def _orders(capture: Capture, main: Adapted) -> FringeOrders | None:
    """Decide orders by the capture's Gray code or further periods, where it has them."""
    try:
        if capture.gray_paths:
            return orders_by_gray(main.map, capture.read_gray())
        return _orders_of_periods(capture, main) if len(capture.periods) > 1 else None
    except PhaseError as error:
        raise PhaseError(f"capture {capture.name!r}: {error}") from error


def _orders_of_periods(capture: Capture, main: Adapted) -> FringeOrders:
    shortest = shortest_period(capture)
    # Few wide fringes do not show their own shape: it is that of the narrow ones, from the same projector.
    maps = [main.map if k == shortest else adapted_set(capture, k, main.wave).map for k in range(len(capture.periods))]
    return decide_orders([m.phase for m in maps], [m.sigma for m in maps], capture.periods)


def frames_of(capture: Capture, *, period: int | None = None) -> NDArray[np.generic]:
    """Return the frames of one fringe period, by default the shortest: as taken, or the mean of the repeats."""
    period = shortest_period(capture) if period is None else period
    if capture.repeat < 2:
        return capture.read_set(period=period)
    sets = np.stack([capture.read_set(repeat=k, period=period) for k in range(capture.repeat)])
    return mean_of_repeats(sets, white_level=capture.white_level)


def why_masked(phase_map: PhaseMap) -> str:
    """List why pixels carry no phase, with their shares."""
    shares = {name: share for name, share in phase_map.shares().items() if name != "valid" and share > 0}
    return ", ".join(f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in shares.items())
