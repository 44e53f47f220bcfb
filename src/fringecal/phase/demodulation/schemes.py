"""Phase-shifting schemes: which frames are taken, and with what weights they give the phase.

Every scheme here obeys `I_n = A + B cos(phi + delta_n)` and, but for Carre's, is linear: three rows of
weights turn the N grey values of a pixel into `A`, `C = B cos(phi)` and `S = B sin(phi)`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError

MAX_NOISE_GAIN = 10.0
"""Phase shifts that make the phase this many times noisier than N equal phase shifts would are refused."""
_FULL_TURN = 6.3  # radians, rounded as people write them
_SINGULAR = 1e-6  # of the largest singular value: a smaller one is rounding of phase shifts as people state them


@dataclass(frozen=True)
class Scheme:
    """Phase shifts and weights of a linear phase-shifting scheme.

    Parameters
    ----------
    name
        Name as it stands in reports.
    phase_shifts_rad
        Phase shifts delta_n of the N frames, rad.
    weights
        Array (3, N): rows give A, B cos(phi) and B sin(phi) from the N grey values.
    gains, offsets, backgrounds
        Modulation of each frame against the mean, grey levels added to it, and its background against the mean,
        where they are known to differ: `I_n = background_n A + gain_n B cos(phi + delta_n) + offset_n`; empty for
        1, 0, and the gains.
    """

    name: str
    phase_shifts_rad: tuple[float, ...]
    weights: NDArray[np.float64]
    gains: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    backgrounds: tuple[float, ...] = ()

    @property
    def zero(self) -> NDArray[np.float64]:
        """Return what the weights give for the offsets alone, which is to be subtracted, (3,)."""
        return self.weights @ self.offsets if self.offsets else np.zeros(3)

    @property
    def model(self) -> NDArray[np.float64]:
        """Return what A, B cos(phi), B sin(phi) and 1 are multiplied with in each frame, (N, 4)."""
        phase_shifts = np.asarray(self.phase_shifts_rad)
        one = np.ones_like(phase_shifts)
        gains = np.asarray(self.gains or one)
        columns = (
            self.backgrounds or gains,
            gains * np.cos(phase_shifts),
            -gains * np.sin(phase_shifts),
            self.offsets or 0 * one,
        )
        return np.column_stack(columns)

    @property
    def noise_gain(self) -> float:
        """Return rms u(phi) over all phases as a multiple of the optimum `sqrt(2/N) sigma/B`."""
        variance = (self.weights[1:] ** 2).sum() / 2
        return float(np.sqrt(variance * len(self.phase_shifts_rad) / 2))


def least_squares(
    phase_shifts_rad: ArrayLike,
    *,
    name: str | None = None,
    gains: ArrayLike = 1.0,
    offsets: ArrayLike = 0.0,
    backgrounds: ArrayLike | None = None,
) -> Scheme:
    """Build the least-squares scheme for any set of three or more phase shifts.

    Parameters
    ----------
    phase_shifts_rad
        Phase shifts delta_n, rad, (N,), N >= 3; equal spacing is not needed.
    name
        Name for reports; by default the number of phase shifts.
    gains, offsets, backgrounds
        Modulation of each frame against the mean, grey levels added to it, and its background against the mean
        (as the gains if not given), (N,), where they are known, such as `PhaseShiftEstimate.gain_per_frame`.

    Notes
    -----
    With the design matrix `M = [background, gain cos(delta), -gain sin(delta)]` the weights are `(M^T M)^-1 M^T`
    (Greivenkamp, Opt. Eng. 23 (1984) 350, eq. 11).

    Raises
    ------
    PhaseError
        Fewer than three phase shifts, one that is not finite, or phase shifts that do not determine A, B and phi.

    Examples
    --------
    >>> least_squares(np.deg2rad([0, 120, 240])).weights.round(4)
    array([[ 0.3333,  0.3333,  0.3333],
           [ 0.6667, -0.3333, -0.3333],
           [ 0.    , -0.5774,  0.5774]])
    """
    phase_shifts = np.asarray(phase_shifts_rad, dtype=np.float64).ravel()
    _refuse_too_few(phase_shifts)
    bare = Scheme(
        name or f"least squares, {phase_shifts.size} steps",
        tuple(phase_shifts.tolist()),
        np.empty((3, 0)),
        _one_each(gains, phase_shifts, "gains"),
        _one_each(offsets, phase_shifts, "offsets"),
        _one_each(gains if backgrounds is None else backgrounds, phase_shifts, "backgrounds"),
    )
    design = bare.model[:, :3]
    singular = np.linalg.svd(design, compute_uv=False)
    scheme = replace(bare, weights=np.linalg.pinv(design))
    if singular[-1] < _SINGULAR * singular[0] or scheme.noise_gain > MAX_NOISE_GAIN:
        raise PhaseError(
            f"phase shifts of {_in_degrees(phase_shifts)} deg do not determine background, modulation and phase; "
            "needed: at least three phase shifts well spread over a period, such as 0, 120, 240 deg; "
            "check steps_deg (duplicated frames count once)" + _perhaps_radians(phase_shifts)
        )
    return scheme


def _one_each(values: ArrayLike, phase_shifts: NDArray[np.float64], what: str) -> tuple[float, ...]:
    """Return one finite number for each phase shift."""
    found = np.asarray(values, np.float64)
    if found.shape not in ((), phase_shifts.shape) or not np.isfinite(found).all():
        raise PhaseError(
            f"{what} of shape {found.shape} for {phase_shifts.size} phase shifts; needed: one finite number per frame"
        )
    return tuple(np.broadcast_to(found, phase_shifts.shape).tolist())


def _refuse_too_few(phase_shifts: NDArray[np.float64]) -> None:
    """Refuse sets of phase shifts that no weights exist for."""
    if phase_shifts.size < 3:
        raise PhaseError(f"found {phase_shifts.size} phase shifts; at least 3 are needed: take more frames")
    if not np.isfinite(phase_shifts).all():
        raise PhaseError(
            f"phase shifts {phase_shifts.tolist()} rad are not all finite: state every phase shift as a number"
        )


def _perhaps_radians(phase_shifts: NDArray[np.float64]) -> str:
    """Ask, where numbers stated as degrees would make sense as radians."""
    as_stated = np.rad2deg(phase_shifts)
    if np.abs(as_stated).max() > _FULL_TURN or np.ptp(as_stated) < 1:
        return ""
    return f"; {_in_degrees(phase_shifts)} look like radians: state degrees, {_in_degrees(as_stated)}"


def _in_degrees(phase_shifts: NDArray[np.float64]) -> str:
    """Write phase shifts as a person would state them."""
    return ", ".join(f"{step:.6g}" for step in np.rad2deg(phase_shifts))


def buckets(n: int) -> Scheme:
    """Build the N-bucket scheme: N equal phase shifts over one period, the first at 0.

    Examples
    --------
    >>> np.rad2deg(buckets(4).phase_shifts_rad).round(6).tolist()
    [0.0, 90.0, 180.0, 270.0]
    """
    return least_squares(2 * np.pi * np.arange(n) / n, name=f"{n}-bucket")


def _from_rows(name: str, steps_deg: Sequence[float], cosine: Sequence[float], sine: Sequence[float]) -> Scheme:
    """Build a scheme from its published integer coefficients, scaled so that the modulation is right."""
    phase_shifts = np.deg2rad(steps_deg)
    background = np.linalg.pinv(
        np.column_stack([np.ones_like(phase_shifts), np.cos(phase_shifts), -np.sin(phase_shifts)])
    )[0]
    cosine_row = np.asarray(cosine) / np.dot(cosine, np.cos(phase_shifts))
    sine_row = np.asarray(sine) / np.dot(sine, -np.sin(phase_shifts))
    return Scheme(name, tuple(phase_shifts.tolist()), np.stack([background, cosine_row, sine_row]))


_NAMED = {
    "three-120": lambda: least_squares(np.deg2rad([0, 120, 240]), name="three-120"),
    "three-90": lambda: least_squares(np.deg2rad([0, 90, 180]), name="three-90"),
    "four": lambda: least_squares(np.deg2rad([0, 90, 180, 270]), name="four"),
    # Hariharan, Oreb, Eiju, Appl. Opt. 26 (1987) 2504, eq. 9: blind to a linear phase shift error at first order.
    "hariharan-5": lambda: _from_rows("hariharan-5", [-180, -90, 0, 90, 180], [-1, 0, 2, 0, -1], [0, 2, 0, -2, 0]),
    # Schwider et al., Opt. Eng. 32 (1993) 1883: three phase shifts of 90 deg, frames 1-3 and 2-4 added.
    "schwider-4": lambda: _from_rows("schwider-4", [0, 90, 180, 270], [1, 1, -3, 1], [1, -3, 1, 1]),
}


def scheme(name: str) -> Scheme:
    """Return a named scheme.

    Parameters
    ----------
    name
        One of ``three-120``, ``three-90``, ``four``, ``hariharan-5``, ``schwider-4``, or ``N-bucket``
        such as ``8-bucket``. Carre's scheme is not linear and has its own function, `carre`.

    Raises
    ------
    PhaseError
        No scheme of that name.

    Examples
    --------
    >>> scheme("hariharan-5").weights[2].tolist()
    [0.0, 0.5, 0.0, -0.5, 0.0]
    """
    count, dash, kind = name.partition("-")
    if dash and kind == "bucket" and count.isdigit():
        return buckets(int(count))
    if name not in _NAMED:
        known = ", ".join([*_NAMED, "N-bucket"])
        raise PhaseError(f"no phase-shifting scheme is called {name!r}; known: {known}")
    return _NAMED[name]()


def carre(frames: ArrayLike) -> NDArray[np.float64]:
    """Demodulate four frames with equal but unknown phase shifts -3a, -a, a, 3a (Carre 1966).

    Parameters
    ----------
    frames
        Four frames, grey levels, (4, ...).

    Returns
    -------
    numpy.ndarray
        Wrapped phase in (-pi, pi], rad; NaN where the frames admit no phase shift (a negative radicand).

    Notes
    -----
    With `p = I2 - I3` and `q = I1 - I4`: `tan(phi) = sqrt((3p - q)(p + q)) / ((I2 + I3) - (I1 + I4))`,
    the sign of the sine being that of p (Carre, Metrologia 2 (1966) 13). Best near a = 55 deg; at small
    a, or where sin(phi) is small, the root makes noise large.

    Raises
    ------
    PhaseError
        Not four frames.

    Examples
    --------
    >>> a, phase = np.deg2rad(55), 1.0
    >>> frames = 100 + 50 * np.cos(phase + a * np.array([-3, -1, 1, 3]))
    >>> round(float(carre(frames)), 6)
    1.0
    """
    grey = np.asarray(frames, dtype=np.float64)
    if grey.shape[0] != 4:
        raise PhaseError(f"found {grey.shape[0]} frames; Carre's scheme needs exactly 4")
    inner, outer = grey[1] - grey[2], grey[0] - grey[3]
    radicand = (3 * inner - outer) * (inner + outer)
    sine = np.sign(inner) * np.sqrt(np.where(radicand >= 0, radicand, np.nan))
    return np.arctan2(sine, (grey[1] + grey[2]) - (grey[0] + grey[3]))
