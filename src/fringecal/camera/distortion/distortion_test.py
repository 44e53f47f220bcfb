"""Is there lens distortion? A projective camera against one with radial terms, on one picture of a grid."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from fringecal.camera.distortion.distortion_fit import (
    DERIVATIVE_STEP_U,
    MAX_TERMS,
    POSE,
    Crossings,
    GridFit,
    crossings_of,
    fit_lens_on_grid,
    left_out_u,
    pitches_per_px,
    without_outliers,
)
from fringecal.camera.distortion.straightness import line_points, straightness
from fringecal.camera.distortion.uneven_ruling import SheetTest, examine_ruling
from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect import GridDetection
from fringecal.errors import FitError
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]
Verdict = Literal["none", "barrel", "pincushion"]
Centre = Literal["auto", "image", "free"]

#: Probability of the F-test at which a perfect lens is found to have distortion: the usual 5 %.
SIGNIFICANCE = 0.05
#: Share of distortions of the size of the detection limit that the test finds.
POWER = 0.95
#: Fifty coordinates for the fifteen numbers of the richest fit (pose, three radial terms, centre, tangential terms).
MIN_CROSSINGS = 25
#: A lens that moves points by more than this part of their radius is described from seen to ideal points: three terms
#: then do what five cannot the other way (`docs/camera.md`).
STRONG = 0.08
#: Further terms of a lens, or a centre of its own, must explain more than chance does once in a thousand: superfluous
#: ones make the rim of the picture uncertain.
CHANCE = 0.001
#: Degrees of freedom of four fits that leave out a quarter of the grid each: one goes into their mean.
JACKKNIFE_DOF = 3.0


@dataclass(frozen=True)
class DistortionTest:
    """Answer to "does this lens distort?", with what it rests on.

    Parameters
    ----------
    verdict
        ``"barrel"``, ``"pincushion"``, or ``"none"`` when the F-test at 5 % finds nothing.
    max_px
        Size of the radial displacement at the crossing farthest from the lens's centre, px; the verdict says
        which way.
    radius_px
        Distance of that crossing from the centre.
    detection_limit_px
        Displacement there that would have been found in 95 % of cases.
    f_statistic, p_value
        Of the radial terms together, about the image centre.
    lens
        The fitted lens.
    coefficients
        Estimates of k1, k2 ... (radius in half diagonals), centre and tangential terms that were free.
    points_px, residual_before_px, residual_after_px
        Crossings and observed minus fitted, (n, 2): projective only, and with the lens.
    straightness_before, straightness_after
        One row per line, before and after undistortion (`camera.straightness`).
    pitches_per_px
        Pitches of the grid that one px spans at the image centre, mean of both directions.
    misfit
        Rms of the residuals with the lens over the crossings' own uncertainty; every u is enlarged by it.
    irregular_px
        Rms displacement of the lines from an even ruling, px, where the sheet is told to be uneven; else 0. The verdict
        and the detection limit then rest on the bending of the lines alone (`examine_ruling`).
    """

    verdict: Verdict
    max_px: Estimate
    radius_px: float
    detection_limit_px: float
    f_statistic: float
    p_value: float
    lens: RadialLens
    coefficients: dict[str, Estimate]
    points_px: Array
    residual_before_px: Array
    residual_after_px: Array
    straightness_before: pd.DataFrame
    straightness_after: pd.DataFrame
    pitches_per_px: Estimate
    misfit: float
    irregular_px: float = 0.0

    def scale_at_centre(self, pitch_mm: Estimate) -> Estimate:
        """Scale on the sheet at the image centre, mm/px, with tilt and lens taken into account."""
        value = pitch_mm.value * self.pitches_per_px.value
        relative = math.hypot(self.pitches_per_px.u / self.pitches_per_px.value, pitch_mm.u / pitch_mm.value)
        return Estimate(value, value * relative, "mm/px", "scale at the image centre", self.pitches_per_px.dof)

    @property
    def centre(self) -> tuple[Estimate, Estimate] | None:
        """Centre of distortion (u, v), px; None where the picture does not tell it from the image centre."""
        if "cu" not in self.coefficients:
            return None
        return self.coefficients["cu"], self.coefficients["cv"]


def examine_distortion(
    detection: GridDetection,
    *,
    terms: int = 2,
    centre: Centre = "auto",
    tangential: bool = False,
    perspective: bool = True,
) -> DistortionTest:
    """Test whether radial terms explain the crossings better than a projective camera alone.

    Parameters
    ----------
    detection
        The grid found in the picture.
    terms
        Number of radial terms of the test, 1 to 3; a lens that needs a third one gets it.
    centre
        Centre of distortion at the image centre, free, or (``"auto"``) free where that explains more.
    tangential
        Whether to fit Brown's p1 and p2 too.
    perspective
        Whether the camera may be tilted. Tilt and a shifted centre bend lines almost alike; without
        tilt a free centre is the point through which lines look straight, as other programs report it.

    Raises
    ------
    FitError
        Fewer than 25 crossings, or more than 3 terms.

    Notes
    -----
    F = ((S0 - S1) / q) / (g S1 / (2n - p)) with q the terms beyond the p - q of the projective camera. S are sums of
    squares of residuals that were made independent by the covariance of the crossings (`LineScatter`): they share
    points with their neighbours, and the lines' profile with all. The profile's changes are fitted beside the lens,
    observed to be zero within their u. g is for what is left of correlation (`shared_factor`), from a sheet's waves,
    say. The test keeps the centre at the image centre, because a free one has no meaning without distortion and would
    spoil the distribution of F; the lens that is returned may have its own. The lens's parameters are asked of the
    grid as a whole, so displacements far below one pixel are found.
    """
    if not 1 <= terms <= MAX_TERMS:
        raise FitError(f"{terms} radial terms asked for; 1 to {MAX_TERMS} are possible")
    if len(detection.row) < MIN_CROSSINGS:
        raise FitError(
            f"{len(detection.row)} crossings do not distinguish distortion from noise; {MIN_CROSSINGS} needed"
        )
    asked = _Question(
        POSE if perspective else frozenset(),
        frozenset(f"k{n + 1}" for n in range(terms)),
        frozenset({"p1", "p2"}) if tangential else frozenset(),
        centre,
    )
    crossings = crossings_of(detection)
    answer = _answer(crossings, asked)
    kept = without_outliers(crossings, answer.lens)
    if len(kept.points) < len(crossings.points):
        crossings, answer = kept, _answer(kept, asked)
    return _report(detection, crossings, answer)


@dataclass(frozen=True)
class _Question:
    """What is free: pose, radial terms of the test, what else of the lens, and where its centre lies."""

    pose: frozenset[str]
    radial: frozenset[str]
    others: frozenset[str]
    centre: Centre


@dataclass(frozen=True)
class _Answer:
    """The fits that the test compares, and the lens that says most."""

    plain: GridFit
    distorted: GridFit
    lens: GridFit


def _answer(crossings: Crossings, asked: _Question) -> _Answer:
    inverse = _is_strong(crossings, asked.pose | asked.radial)
    plain = fit_lens_on_grid(crossings, asked.pose)
    distorted = fit_lens_on_grid(crossings, asked.pose | asked.radial, inverse=inverse)
    lens = distorted
    steps = [asked.others, frozenset({"cu", "cv"}) if asked.centre == "free" else frozenset()]
    for added in filter(None, steps):
        lens = fit_lens_on_grid(crossings, lens.free | added, inverse=inverse, start=lens)
    if _f_test(plain, distorted)[1] < SIGNIFICANCE:
        # A centre has no effect without distortion; a third term matters only where two do not suffice.
        # A shifted centre is, but for its higher terms, what p1 and p2 describe: never both.
        steps = [frozenset({"cu", "cv"})] if asked.centre == "auto" and not asked.others else []
        for added in (*steps, frozenset(f"k{n + 1}" for n in range(MAX_TERMS))):
            lens = _better_of(lens, crossings, added)
    return _Answer(plain, distorted, lens)


def _is_strong(crossings: Crossings, free: frozenset[str]) -> bool:
    """Return whether the lens moves the outermost crossing by a large part of its radius."""
    lens = fit_lens_on_grid(crossings, free, inverse=True).lens
    outermost = _outermost(crossings, lens)
    return abs(float(lens.outward_px(outermost)[0])) > STRONG * float(np.hypot(*(outermost[0] - lens.centre_px)))


def _better_of(plain: GridFit, crossings: Crossings, added: frozenset[str]) -> GridFit:
    """Let further parameters in if they explain more than chance does, and are determined."""
    if added <= plain.free:
        return plain
    richer = fit_lens_on_grid(crossings, plain.free | added, inverse=plain.lens.inverse, start=plain)
    return richer if richer.covariance is not None and _f_test(plain, richer)[1] < CHANCE else plain


def _f_test(plain: GridFit, full: GridFit) -> tuple[float, float]:
    """F and its probability under chance, with what neighbouring crossings share."""
    before, after = plain.result, full.result
    extra = before.nfree - after.nfree
    statistic = (before.chisqr - after.chisqr) / extra / (full.shared * after.chisqr / after.nfree)
    return float(statistic), float(stats.f.sf(statistic, extra, after.nfree))


def _report(detection: GridDetection, crossings: Crossings, answer: _Answer) -> DistortionTest:
    """Put both fits side by side."""
    statistic, p_value = _f_test(answer.plain, answer.distorted)
    largest, radius = _largest_displacement(crossings, answer.lens)
    tested, _ = _largest_displacement(crossings, answer.distorted)
    verdict: Verdict = "none"
    if p_value < SIGNIFICANCE:
        verdict = "barrel" if tested.value < 0 else "pincushion"
    limit = float(stats.norm.ppf(1 - SIGNIFICANCE / 2) + stats.norm.ppf(POWER)) * tested.u
    distorted = line_points(detection)
    ends = np.cumsum([len(points) for points in distorted])
    straightened = np.split(answer.lens.lens.undistort(np.concatenate(distorted)), ends[:-1]) if distorted else []
    before, after = straightness(detection), straightness(detection, moved=straightened)
    lens, coefficients = answer.lens.lens, _coefficients(crossings, answer.lens)
    sheet = examine_ruling(crossings, answer.plain, len([name for name in answer.distorted.free if name[0] == "k"]))
    uneven = sheet.p_irregular < CHANCE and not lens.inverse
    if uneven:
        limit *= sheet.u_bent_px / tested.u
        bent = RadialLens(crossings.middle, crossings.half_diagonal, _three(sheet.terms), (0.0, 0.0), inverse=False)
        by_bending = straightness(detection, moved=[bent.undistort(points) for points in distorted])
        if _rms_px(by_bending) < _rms_px(after):  # the other lens takes the sheet's error for its own
            lens, after, coefficients = bent, by_bending, {one.label: one for one in sheet.terms}
            largest = replace(largest, value=sheet.bent_px, u=sheet.u_bent_px)
        verdict = _of_bent_lines(sheet, straighter=_rms_px(after) < _rms_px(before))
        limit = max(limit, _unconfirmed_px(sheet) if verdict == "none" else 0.0)
    return DistortionTest(
        verdict,
        replace(largest, value=abs(largest.value)),
        radius,
        limit,
        statistic,
        p_value,
        lens,
        coefficients,
        crossings.points,
        answer.plain.residual_px,
        answer.lens.residual_px,
        before,
        after,
        Estimate(*pitches_per_px(crossings, answer.lens), "1/px", "pitches per px", answer.lens.result.nfree),
        math.sqrt(answer.lens.result.redchi),
        sheet.irregular_px if uneven else 0.0,
    )


def _of_bent_lines(sheet: SheetTest, *, straighter: bool) -> Verdict:
    """Return the verdict of an unevenly ruled sheet: a lens bends lines, and they are straighter without it."""
    if sheet.p_lens >= SIGNIFICANCE or not (sheet.repeats and straighter):
        return "none"
    return "barrel" if sheet.bent_px < 0 else "pincushion"


def _unconfirmed_px(sheet: SheetTest) -> float:
    """Return up to which size lines are bent that no lens is confirmed by: of smaller lenses nothing can be said."""
    if sheet.p_lens >= SIGNIFICANCE:
        return 0.0
    return abs(sheet.bent_px) + float(stats.norm.ppf(POWER)) * sheet.u_bent_px


def _three(terms: tuple[Estimate, ...]) -> tuple[float, ...]:
    """Return radial terms as a lens takes them."""
    return tuple([*(one.value for one in terms), 0.0, 0.0, 0.0][:MAX_TERMS])


def _rms_px(table: pd.DataFrame) -> float:
    """Root mean square distance from straight over the points of all lines, px."""
    return float(np.sqrt((table["points"] * table["rms_px"] ** 2).sum() / max(table["points"].sum(), 1)))


def _outermost(crossings: Crossings, lens: RadialLens) -> Array:
    """Crossing (1, 2), px, farthest from the lens's centre."""
    distance = np.hypot(*(crossings.points - lens.centre_px).T)
    return crossings.points[[int(np.argmax(distance))]]


def _largest_displacement(crossings: Crossings, fitted: GridFit) -> tuple[Estimate, float]:
    """Signed radial displacement at the outermost crossing, px, with u, and its distance from the centre."""
    covariance = fitted.covariance
    if covariance is None:
        raise FitError("the grid does not determine the distortion; photograph more of it, or use fewer terms")
    place = _outermost(crossings, fitted.lens)
    value = float(fitted.lens.outward_px(place)[0])
    u_all = np.sqrt(np.diag(covariance))
    gradient = np.zeros(len(u_all))
    for i, name in enumerate(fitted.result.var_names):
        if name in fitted.free - POSE:
            moved = fitted.lens_with(name, DERIVATIVE_STEP_U * u_all[i], crossings)
            gradient[i] = (float(moved.outward_px(place)[0]) - value) / (DERIVATIVE_STEP_U * u_all[i])
    u = math.sqrt(max(0.0, float(gradient @ covariance @ gradient)))
    radius = float(np.hypot(*(place[0] - fitted.lens.centre_px)))
    return Estimate(value, u, "px", "largest displacement", fitted.result.nfree), radius


def _coefficients(crossings: Crossings, fitted: GridFit) -> dict[str, Estimate]:
    """Estimates of the lens's free parameters; the centre in px of the picture.

    Of a free centre, u is at least what four fits that leave out a quarter of the grid each say.
    """
    left_out = left_out_u(crossings, fitted) if "cu" in fitted.free else {}
    found = {}
    for i, name in enumerate(fitted.result.var_names):
        if name not in fitted.free - POSE:
            continue
        value, unit, dof = fitted.result.params[name].value, "", float(fitted.result.nfree)
        u = math.sqrt(fitted.covariance[i, i]) if fitted.covariance is not None else math.nan
        if left_out.get(name, 0.0) > u:
            u, dof = left_out[name], JACKKNIFE_DOF
        if name in ("cu", "cv"):
            middle = crossings.middle[0 if name == "cu" else 1]
            value, u, unit = middle + value * crossings.half_diagonal, u * crossings.half_diagonal, "px"
        found[name] = Estimate(float(value), float(u), unit, name, dof)
    return found
