"""A study: many random virtual rigs commissioned, and what was found held against what is true."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringecal.calibration import Calibrated
from fringecal.errors import FringecalError
from fringecal.projector import RigCalibration
from fringecal.records import (
    PROCESSOR,
    Comparison,
    EstimateRecord,
    RigResult,
    StudyRecord,
    open_study,
    read_rigs,
    software_versions,
    write_rig,
)
from fringecal.session import temporary_session
from fringecal.simulate import RigSpec, SimulatedSession, build_camera, build_projector, phase_at, ray, truth_of
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission import calibrate_session
from fringecal.workflows.shared import RIM
from fringecal.workflows.study.drawn_rigs import DrawnRig, draw_rig

HEIGHTS_MM = (5.0, 15.0, 30.0)  # of check points: just above the strips', and up to ten times it

#: Where heights are checked, as shares of the picture's width and height.
PLACES = {
    "centre": (0.5, 0.5),
    "top left": (RIM, RIM),
    "top right": (1 - RIM, RIM),
    "bottom left": (RIM, 1 - RIM),
    "bottom right": (1 - RIM, 1 - RIM),
}

type Progress = Callable[[str], None]


@dataclass(frozen=True)
class StudyPlan:
    """What decides the results of a study.

    Parameters
    ----------
    seed
        Of the study; each rig has a stream of its own, so that neither order nor workers matter.
    rig
        One rig for the whole study, of which only the errors are drawn; every rig another by default.
    heights_mm
        Heights of the check points.
    """

    seed: int = 0
    rig: RigSpec | None = None
    heights_mm: tuple[float, ...] = HEIGHTS_MM

    def record(self) -> StudyRecord:
        """Return what a folder of results must agree with."""
        name = "" if self.rig is None else self.rig.name
        versions = {key: version for key, version in software_versions().items() if key != PROCESSOR}
        return StudyRecord(seed=self.seed, rig=name, heights_mm=self.heights_mm, software=versions)


type Compute = Callable[[StudyPlan, list[int]], Iterable[RigResult]]


def run_study(
    plan: StudyPlan, rigs: int, folder: Path, compute: Compute, *, progress: Progress = lambda _: None
) -> tuple[RigResult, ...]:
    """Compute what is missing of a study, keep each result as it comes, and return all results by number.

    Parameters
    ----------
    plan
        The study.
    rigs
        How many rigs.
    folder
        Where results are kept; those that stand there are not computed again.
    compute
        Yields the results of given rigs in any order: `study_workers.local_pool` or `study_workers.cluster`.
    progress
        Called with a short sentence as rigs come in.

    Raises
    ------
    RecordError
        The folder holds another study, or a result that cannot be read.
    """
    open_study(folder, plan.record())
    done = read_rigs(folder, range(rigs))
    missing = [number for number in range(rigs) if number not in done]
    progress(f"{len(done)} of {rigs} rigs stand in {folder}")
    for result in compute(plan, missing):
        # A cluster that lost a worker may deliver a rig twice; it is the same result.
        if result.number not in done:
            write_rig(folder, result)
            done[result.number] = result
            progress(f"{len(done)} of {rigs} rigs")
    return tuple(done[number] for number in sorted(done))


def examine_rig(plan: StudyPlan, number: int) -> RigResult:
    """Draw one rig, take its pictures, commission it and compare; a refusal is a result, with its reason."""
    drawn = draw_rig(number, seed=plan.seed, spec=plan.rig)
    taken = drawn.session()
    try:
        with temporary_session(taken.document, taken.frames, extra_files=taken.files) as session:
            found = calibrate_session(session).result
    except FringecalError as error:
        return RigResult(number=number, refused=f"{type(error).__name__}: {error}")
    rows = compare(found, drawn, taken, heights_mm=plan.heights_mm)
    quantities = (Comparison(name=name, true=true, found=EstimateRecord.of(found)) for name, found, true in rows)
    return RigResult(number=number, quantities=tuple(quantities))


def compare(
    found: Calibrated, drawn: DrawnRig, taken: SimulatedSession, *, heights_mm: Iterable[float] = HEIGHTS_MM
) -> Iterator[tuple[str, Estimate, float]]:
    """Yield name, estimate and truth of scale, angle at the origin, and heights at check points.

    A height is checked without a picture: the phase that the true rig gives a point at this height on a pixel's true
    ray goes into the calibrated model. It tells what the calibration errs by; the noise of a single pixel, which
    averages out, takes no part.
    """
    truth = truth_of(drawn.spec)
    yield "scale", found.camera.scales["mean"], (truth.scale_h + truth.scale_v) / 2
    yield "angle at the origin", found.origin.angle, truth.angle_origin_deg
    # Frames whose first step is off show all phases off alike, an object's as the plate's: it is not an error.
    plate = next(capture.name for capture in drawn.spec.capture if capture.kind == "reference")
    offset = float(np.nanmean(found.plate.unwrapped_rad - taken.captures[plate].phase))
    for z in heights_mm:
        for place, share in PLACES.items():
            yield f"{z:g} mm, {place}", _height(found.rig, drawn.spec, share, z, offset), z


def _height(
    calibration: RigCalibration, spec: RigSpec, share: tuple[float, float], z_mm: float, offset_rad: float
) -> Estimate:
    u, v = share[0] * (spec.camera.width_px - 1), share[1] * (spec.camera.height_px - 1)
    ax, ay, bx, by = ray(build_camera(spec.camera), u, v)
    phase = phase_at(build_projector(spec.projector), ax + bx * z_mm, ay + by * z_mm, z_mm) + offset_rad

    def height(moved: RigCalibration) -> float:
        return float(moved.model.height(np.array(phase), moved.camera.rays(u, v)))

    return calibration.budget(height, unit="mm", label=f"height {z_mm:g} mm").result
