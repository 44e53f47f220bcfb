"""Numbers of an artefact that lies in any pose in a calibrated volume: none of them refers to a plate."""

import math
from collections.abc import Sequence
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.targets import Artefact, BallBar, Flat, Sphere, Steps
from fringecal.uncertainty import Estimate, Influence
from fringecal.verification.forms.fitted_forms import fit_plane, flatness
from fringecal.verification.forms.probes import (
    _BALL_FORMS,
    _CAP_NOTE,
    _LINE,
    CAP_DEG,
    Numbers,
    Probe,
    _ball_numbers,
    _from_planes,
    _from_spheres,
    _slope_u,
    ball_bar_probe,
)
from fringecal.verification.forms.volume_search import PointPicture, find_balls, find_levels, find_plane
from fringecal.verification.zigzag.zigzag_shape import Floats

_LEAST_ACROSS_PX = 50.0  # of a ball: of smaller ones a pixel sees a patch that bends, and is lit unevenly
_BOWS = ("bow along columns", "bow along rows", "twist")


@singledispatch
def volume_probe(target: Artefact, seen: PointPicture) -> Probe:  # noqa: ARG001
    """Find an artefact in a picture of points, and say what is to be computed from it.

    Parameters
    ----------
    target
        `Flat`, `Steps`, `Sphere` or `BallBar`.
    seen
        The picture of points, z toward the camera.

    Raises
    ------
    FitError
        The points do not show the artefact, or it is of another kind.
    """
    raise FitError(
        f"a target of kind {getattr(target, 'kind', '?')!r} is not judged in a volume; use flat, steps, sphere or "
        "ball-bar"
    )


@volume_probe.register
def _(target: Flat, seen: PointPicture) -> Probe:
    plane = find_plane(seen)
    own = (target.flatness_mm.value + target.flatness_mm.u) / math.sqrt(3)
    references = {"flatness": target.flatness_mm.estimate("flatness", "mm")}
    references |= {name: Estimate(0.0, own, "mm", "flatness") for name in _BOWS}

    def numbers(groups: Sequence[Floats]) -> Numbers:
        (flat,) = groups
        error, fit = flatness(flat)
        found = {
            "flatness": error.value_mm,
            "flatness, 95 % of the points": flatness(flat, definition="iso10360-13")[0].value_mm,
            "rms from the plane": float(np.std(fit.residual_mm)),
        }
        return found | dict(zip(_BOWS, map(float, bows_of(flat)), strict=True))

    forms = frozenset({"flatness", "flatness, 95 % of the points", "rms from the plane"})
    note = (
        "bow and twist: height in the middle of a quadratic surface over the plane of its ends, from the middle's side"
    )
    return Probe((plane,), numbers, references, _from_planes, forms, notes=(note,))


def bows_of(points: Floats) -> Floats:
    """Return bow along x, bow along y, and twist of a nearly plane surface, mm, (3,).

    Parameters
    ----------
    points
        (n, 3), mm, z toward the observer.

    Notes
    -----
    `h = c + a xi + b eta - B_x xi^2 - B_y eta^2 + T xi eta`, h the distance from the plane of best fit, xi and eta from
    -1 to 1 over the points along x and y.

    Examples
    --------
    >>> x, y = (axis.ravel() for axis in np.mgrid[-50:51:5, -30:31:5].astype(float))
    >>> (bows_of(np.column_stack([x, y, 0.2 - 0.02 * (x / 50) ** 2])).round(5) + 0.0).tolist()
    [0.02, 0.0, 0.0]
    """
    fit = fit_plane(points)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    xi, eta = ((points[:, :2] - (low + high) / 2) / np.maximum((high - low) / 2, 1e-12)).T
    terms = np.column_stack([np.ones_like(xi), xi, eta, -xi * xi, -eta * eta, xi * eta])
    return np.asarray(np.linalg.lstsq(terms, fit.residual_mm, rcond=None)[0][3:])


def _small(caps: Sequence[NDArray[np.intp]]) -> tuple[str, ...]:
    """Name balls that few pixels see."""
    share = math.sin(math.radians(CAP_DEG))  # of a ball's width that its cap covers
    across = min(math.sqrt(4 * cap.size / math.pi) / share for cap in caps)
    if across > _LEAST_ACROSS_PX:
        return ()
    return (
        f"a ball is about {across:.0f} px across; below {_LEAST_ACROSS_PX:g} px each pixel sees a patch that bends "
        "and is lit unevenly, which moves a size by more than its u states: use a larger ball, or go nearer",
    )


@volume_probe.register
def _(target: Sphere, seen: PointPicture) -> Probe:
    diameter = target.diameter_mm.value
    caps = find_balls(seen, (diameter,))
    references = {"size": target.diameter_mm.estimate("diameter", "mm")}
    notes = (_CAP_NOTE, *_small(caps))
    residuals = _from_spheres((diameter,))
    return Probe(caps, lambda groups: _ball_numbers(groups[0]), references, residuals, _BALL_FORMS, notes=notes)


@volume_probe.register
def _(target: BallBar, seen: PointPicture) -> Probe:
    diameters = tuple(map(float, target.diameters_mm.array(2)))
    caps = find_balls(seen, diameters)
    return ball_bar_probe(target, caps, (_CAP_NOTE, *_small(caps)))


@volume_probe.register
def _(target: Steps, seen: PointPicture) -> Probe:
    nominal = target.heights_mm.array(len(target.heights_mm.values))
    own = target.heights_mm.u_array(nominal.size)
    base, tops = find_levels(seen, nominal)
    order = sorted(tops, key=lambda k: float(nominal[k]))
    first = order.pop(0) if base is None else None
    level, u_level = (0.0, 0.0) if first is None else (float(nominal[first]), float(own[first]))
    over = "" if first is None else f" over that of {nominal[first]:g} mm"
    references = {
        f"step of {nominal[k]:g} mm{over}": Estimate(
            float(nominal[k]) - level, math.hypot(float(own[k]), u_level), "mm", influence=Influence.STEP_HEIGHT
        )
        for k in order
    }
    names, certified = tuple(references), np.array([one.value for one in references.values()])

    def numbers(groups: Sequence[Floats]) -> Numbers:
        plane = fit_plane(groups[0])
        heights = np.array([float(np.median((g - plane.point_mm) @ plane.normal)) for g in groups[1:]])
        x, y = np.append(0.0, certified), np.append(0.0, heights)
        slope, offset = np.polyfit(x, y, 1)
        found = dict(zip(names, map(float, heights), strict=True))
        return found | {
            "amplification coefficient": float(slope),
            _LINE: float(np.max(np.abs(y - slope * x - offset))),
        }

    references["amplification coefficient"] = Estimate(1.0, _slope_u(certified, references), "1", "step heights")
    ground = tops[first] if base is None and first is not None else base
    assert ground is not None
    groups = (ground, *(tops[k] for k in order))
    missed = tuple(f"the step of {h:g} mm is not to be seen" for k, h in enumerate(nominal) if k not in tops)
    aside = () if first is None else ("what the block stands on is not to be seen: steps are counted from the lowest",)
    units = {"amplification coefficient": "1"}
    return Probe(groups, numbers, references, _from_planes, frozenset({_LINE}), units, (*missed, *aside))
