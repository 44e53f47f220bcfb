"""What to measure next: how far one more artefact would bring down the uncertainty of heights.

The same joint fit is made once more with the artefact added as it would show in this rig: phase from the fitted
model, scatter as the strips have it, its height known as stated. The covariance that comes out is the prediction.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import CameraFit
from fringecal.numerics import DRAW_SEED
from fringecal.projector.forecast import HeightForecast, forecast_height
from fringecal.projector.joint_fit import RigFit
from fringecal.projector.rig_calibration import Observations, RigCalibration, calibrate_rig
from fringecal.projector.sampling import pick_points
from fringecal.uncertainty import Estimate, Influence

Array = NDArray[np.float64]

HEIGHTS_MM = (5.0, 20.0, 50.0)  # asked for by default: near the strips' own, and well above it
_POINTS = 2_000  # of a surface; the covariance comes from blocks of pixels, so that more only take longer
_FIELD = 0.9  # share of the picture's sides that a flat or strips reach: a bench leaves a rim
_WORTH = 0.9  # uncertainty after over before; a fall by less than a tenth is not worth another artefact


@dataclass(frozen=True)
class Proposal:
    """An artefact that could be measured beside plate and strips.

    Parameters
    ----------
    name
        What it is, as it stands in sentences.
    heights_mm, u_mm
        Heights of its tops and the standard uncertainty of each.
    extent
        Share of the picture's sides that it covers, in the middle of the picture.
    """

    name: str
    heights_mm: tuple[float, ...]
    u_mm: float
    extent: float


#: What a bench has at hand; u, mm, is that of a good micrometer.
PROPOSALS = (
    Proposal("a step block of 30 mm", (30.0,), 0.005, 0.15),
    Proposal("strips of 10 mm over the field", (10.0,), 0.005, _FIELD),
    Proposal("a second flat, 20 mm high, over the field", (20.0,), 0.010, _FIELD),
)


@dataclass(frozen=True)
class Gain:
    """What one proposal would do: standard uncertainties in mm (rms over the field) by height, before and after."""

    proposal: Proposal
    before_mm: dict[float, float]
    after_mm: dict[float, float]

    def ratio(self, z_mm: float) -> float:
        """Return uncertainty after over uncertainty before."""
        return self.after_mm[z_mm] / max(self.before_mm[z_mm], 1e-300)


@dataclass(frozen=True)
class Advice:
    """Forecasts by height, and what each proposal would gain, the best first."""

    forecasts: tuple[HeightForecast, ...]
    gains: tuple[Gain, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Say plainly how good heights are, why not better, and what to measure next."""
        return (*(_forecast_sentence(f) for f in self.forecasts), _next_sentence(self.gains, self.forecasts))


def advise(
    observations: Observations,
    camera_fit: CameraFit,
    fit: RigFit,
    *,
    heights_mm: Sequence[float] = HEIGHTS_MM,
    proposals: Sequence[Proposal] = PROPOSALS,
    noise_rad: float = 0.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Advice:
    """Forecast heights, and judge what one more artefact would buy.

    Parameters
    ----------
    observations, camera_fit, fit
        What the rig was fitted to, its camera, and the fit.
    heights_mm
        Heights of interest.
    proposals
        Artefacts to judge.
    noise_rad
        Noise of the phase in one pixel.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    FitError
        The observations do not determine the rig.
    """
    few = observations.thinned(_POINTS)
    top = max(h.value for h in observations.height_mm)

    def forecasts(observed: Observations) -> tuple[RigCalibration, tuple[HeightForecast, ...]]:
        rig, _ = calibrate_rig(observed, camera_fit, projector_near=fit.model.projector_mm)
        return rig, tuple(forecast_height(rig, z, noise_rad=noise_rad, known_to_mm=top) for z in heights_mm)

    rig, now = forecasts(few)
    gains = []
    for proposal in proposals:
        progress(f"what {proposal.name} would buy")
        _, then = forecasts(few.joined(proposed(proposal, rig, fit)))
        before, after = ({f.z_mm: f.rms_mm for f in each} for each in (now, then))
        gains.append(Gain(proposal, before, after))
    return Advice(now, tuple(sorted(gains, key=lambda g: np.mean([g.ratio(z) for z in heights_mm]))))


def proposed(proposal: Proposal, rig: RigCalibration, fit: RigFit, *, seed: int = DRAW_SEED) -> Observations:
    """Return what a proposed artefact would add to the observations of this rig, its noise drawn with a seed."""
    camera, rng = rig.camera, np.random.default_rng(seed)
    inside = np.zeros((camera.height_px, camera.width_px), bool)
    rows, columns = (slice(*_middle(n, proposal.extent)) for n in inside.shape)
    inside[rows, columns] = True
    u, v, cluster = pick_points(inside, _POINTS)
    rays, scatter = camera.rays(u, v), _scatter(fit)
    _, block = np.unique(cluster, return_inverse=True)
    made = []
    for height in proposal.heights_mm:
        waves = scatter[0] * rng.standard_normal(block.max() + 1)[block]
        phase = rig.model.phase(*rays.at(height), height) + waves + scatter[1] * rng.standard_normal(u.size)
        known = Estimate(height, proposal.u_mm, "mm", influence=Influence.ADDED_HEIGHT)
        made.append(Observations((u,), (v,), (phase,), (cluster,), (known,)))
    whole = made[0]
    for part in made[1:]:
        whole = whole.joined(part)
    return whole


def _middle(size: int, share: float) -> tuple[int, int]:
    half = max(1, round(share * size / 2))
    return size // 2 - half, size // 2 + half


def _scatter(fit: RigFit) -> tuple[float, float]:
    """Standard deviations of the plate's residuals: of what neighbours share, and of single pixels (rough split)."""
    residual = fit.residuals[0][np.isfinite(fit.residuals[0])]
    single = float(np.std(np.diff(residual)) / math.sqrt(2))
    return math.sqrt(max(float(np.var(residual)) - single**2, 0.0)), single


def _forecast_sentence(forecast: HeightForecast) -> str:
    dominant = forecast.dominant
    due = "" if dominant is None else f"; {100 * dominant[1]:.0f} % of its variance comes from: {dominant[0].text}"
    return (
        f"A height of {forecast.z_mm:g} mm has a standard uncertainty of {forecast.rms_mm:.2g} mm over the field "
        f"({float(forecast.u_mm.min()):.2g} to {float(forecast.u_mm.max()):.2g} mm; a single pixel's noise adds "
        f"{float(np.median(forecast.noise_mm)):.2g} mm){due}."
    )


def _next_sentence(gains: Sequence[Gain], forecasts: Sequence[HeightForecast]) -> str:
    if not gains:
        return "No further artefact was judged."
    best, z = gains[0], forecasts[len(forecasts) // 2].z_mm
    if best.ratio(z) > _WORTH:
        return (
            f"To measure next: none of the artefacts that were judged reduces it much; {best.proposal.name} would "
            f"bring {z:g} mm from {best.before_mm[z]:.2g} to {best.after_mm[z]:.2g} mm only. What is left is the "
            "camera's scale."
        )
    others = "; ".join(f"{g.proposal.name}: {g.after_mm[z]:.2g} mm" for g in gains[1:])
    return (
        f"To measure next: {best.proposal.name}, known to {best.proposal.u_mm:g} mm, would bring the standard "
        f"uncertainty of {z:g} mm from {best.before_mm[z]:.2g} to {best.after_mm[z]:.2g} mm"
        + (f" ({others})." if others else ".")
    )
