"""Height models side by side on virtual rigs: error, pictures needed, seconds.

Run: python benchmarks/height_models.py [--rig thesis ...]. The rig model is fitted to grid, plate and strips as
`fringecal commission` does; the pixelwise laws to five raised flats that the simulator draws. All of them then
read the same angle bars, and are judged by the simulator's truth at every pixel that shows a bar.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from fringecal.projector.height_models import height_model
from fringecal.projector.pixelwise import LAWS, fit_pixelwise
from fringecal.reconstruct.object_phase import absolute_phase
from fringecal.session import Session, load_session, write_session
from fringecal.simulate import RigSpec, load_rig, simulate_session
from fringecal.workflows.commission import CalibratedSession, calibrate_session
from fringecal.workflows.shared.capture_phase import phase_of_capture

FLATS_MM = (6.0, 12.0, 18.0, 24.0, 30.0)
PARTS = ("grid", "reference", "strips", "bars")


def flat_capture(height: float) -> dict:
    target = {
        "format": 1, "kind": "flat", "name": f"flat {height:g}", "certificate": "drawn",
        "flatness_mm": {"value": 0.0, "u": 0.0}, "height_mm": {"value": height, "u": 0.005},
    }  # fmt: skip
    return {"name": f"flat{height:g}", "kind": "artefact", "target": target}


def session_of(rig: RigSpec, folder: Path) -> tuple[Session, np.ndarray]:
    captures = [c.model_dump() for c in rig.capture if c.name in PARTS]
    taken = simulate_session(rig.at(capture=[*captures, *map(flat_capture, FLATS_MM)]), seed=2008)
    files = {name: data for name, data in taken.files.items() if "truth" not in name}
    write_session(folder, taken.document, taken.frames, extra_files=files)
    return load_session(folder), taken.captures["bars"].z


def flat_steps(session: Session, found: CalibratedSession) -> np.ndarray:
    """Unwrapped phase of every flat over the plate's, its order taken from the rig: the flats' best case."""
    rays = found.result.rig.camera.pixel_rays()
    steps = []
    for height in FLATS_MM:
        phase = phase_of_capture(session.named(f"flat{height:g}")).map
        expected = found.result.rig.model.phase(*rays.at(height), height)
        lack = np.angle(np.exp(1j * (phase.phase - expected)))
        steps.append(np.where(phase.valid, expected + lack - found.result.plate.unwrapped_rad, np.nan))
    return np.stack(steps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rig", nargs="*", default=["thesis", "harder"])
    for name in parser.parse_args().rig:
        with tempfile.TemporaryDirectory() as folder:
            compare(name, *session_of(load_rig(name), Path(folder) / "session"))


def compare(name: str, session: Session, truth: np.ndarray) -> None:
    start = time.process_time()
    found = calibrate_session(session)
    commissioned = time.process_time() - start
    rays = found.result.rig.camera.pixel_rays()
    bars = absolute_phase(phase_of_capture(session.named("bars")).map, found.result.rig)
    phase_rad = bars.difference_rad + found.result.rig.model.phase(rays.ax, rays.ay, 0.0)
    inside = (truth > 1.0) & (truth < 27.0) & np.isfinite(phase_rad)
    # A pixel that straddles a ridge, a valley or an end sees two surfaces.
    inside &= np.hypot(*np.gradient(truth)) < 1.5
    shifted = len(session.named("bars").phase_shifts_rad)
    rows = {m: (height_model(found.result.rig, m).height, 1 + 2 * shifted, commissioned)
            for m in ("constant-angle", "column-angle", "projective")}  # fmt: skip
    start = time.process_time()
    flats = flat_steps(session, found)
    demodulated = time.process_time() - start
    for law in LAWS:
        start = time.process_time()
        model = fit_pixelwise(flats, FLATS_MM, law=law)
        seconds = demodulated + time.process_time() - start
        pictures = shifted * (1 + len(FLATS_MM))
        rows[f"{law}, 5 flats"] = (_of(model.height, found), pictures, seconds)
        rows[f"{law}, 5 flats, smooth"] = (_of(model.smoothed(5).height, found), pictures, seconds)
    print(f"\n{name}: {np.count_nonzero(inside)} pixels of the bars, full height 28.28 mm")
    print(f"{'model':30s} {'median':>8s} {'68 %':>8s} {'99 %':>8s} mm  pictures  CPU s fit  CPU s read")
    for label, (height, pictures, fit_seconds) in rows.items():
        start = time.process_time()
        z = height(phase_rad, rays)
        read = time.process_time() - start
        error = (z - truth)[inside]
        error = error[np.isfinite(error)]
        middle, size = np.median(error), np.quantile(abs(error), [0.68, 0.99])
        print(f"{label:30s} {middle:+8.4f} {size[0]:8.4f} {size[1]:8.4f}     "
              f"{pictures:8d}  {fit_seconds:9.2f}  {read:10.3f}")  # fmt: skip


def _of(height, found):  # type: ignore[no-untyped-def]
    return lambda phase, _: height(phase - found.result.plate.unwrapped_rad)


if __name__ == "__main__":
    main()
