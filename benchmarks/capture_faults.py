"""Faults put into captures of drawn rigs and objects: which are noticed, which are named, and what they do to heights.

Run: python benchmarks/capture_faults.py [--from N] [--cases N] [--seed S] [--fault WORDS] [--clean N] [--every]. Each
case is a rig with an object (`object_population`); its calibration is exact and knows the bare plate by a capture of
its own. Every fault is put in at three strengths. Harm is the share of valid pixels that are off by more than 3 U where
the exit code is 0 and no cause is named, less that of the same capture without the fault. Clean captures have honest
nuisances: another exposure, lamp, ambient light and noise.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pandas as pd

from fringecal.errors import FringecalError
from fringecal.phase import PlateLook, demodulate, estimate_waveform
from fringecal.session import capture_of_arrays, session_of_captures
from fringecal.simulate import render
from fringecal.simulate.scene.scene import Scene
from fringecal.workflows.reconstruct import Measurement, measurement_causes, measurement_checks, reconstruct
from object_population import Case, draw_case

type Array = np.ndarray
type Draw = np.random.Generator

BEYOND_U = 6.0  # 3 U with k = 2
USUAL = 0.003  # share of pixels beyond 3 U that a capture has without a fault


@dataclass(frozen=True)
class Shot:
    """A capture to be spoilt: its frames, the case behind it, and a bare plate's frames."""

    frames: Array
    case: Case
    plate: Array
    rng: Draw

    def one(self) -> int:
        return int(self.rng.integers(len(self.frames)))

    def along(self) -> tuple[float, float]:
        """Unit vector along the fringes."""
        model, camera = self.case.calibration.model, self.case.calibration.camera
        u, v = camera.centre_px
        phase = [float(_plate_phase(camera, model, u + a, v + b)) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        slope = np.array([phase[0] - phase[1], phase[2] - phase[3]])
        slope /= np.hypot(*slope)
        return float(-slope[1]), float(slope[0])

    def redrawn(self, raised: Array | float = 0.0, shifts: Array | None = None) -> Array:
        """The same scene with its surface raised, or with other phase shifts: light and noise as seen."""
        usual = self.case.phase_shifts_rad
        steps = usual if shifts is None else shifts
        seen, truth, model = (
            demodulate(self.frames, usual, max_residual=np.inf),
            self.case.frames,
            self.case.calibration.model,
        )
        change = model.phase(truth.x, truth.y, truth.z + raised) - model.phase(truth.x, truth.y, truth.z)
        phase = np.where(np.isfinite(seen.phase), seen.phase, 0.0)
        light = np.where(truth.lit & np.isfinite(seen.phase), seen.modulation, 0)
        before, after = (light * np.cos(p + s[:, None, None]) for p, s in ((phase, usual), (phase + change, steps)))
        return grey(self.frames + after - before)


def _plate_phase(camera, model, u, v):
    rays = camera.rays(np.array([u]), np.array([v]))
    return model.phase(rays.ax, rays.ay, 0.0)[0]


def grey(values: Array) -> Array:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def warped(frame: Array, matrix: Array) -> Array:
    size = frame.shape[::-1]
    return cv2.warpAffine(frame, np.asarray(matrix, float), size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def shifted(frame: Array, du: float, dv: float) -> Array:
    return warped(frame, [[1, 0, du], [0, 1, dv]])


def _each(frames: Array, change: Callable[[int, Array], Array]) -> Array:
    return np.stack([change(k, frame) for k, frame in enumerate(frames)])


def _only(frames: Array, k: int, frame: Array) -> Array:
    out = frames.copy()
    out[k] = frame
    return out


def _direction(rng: Draw) -> Array:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def one_frame_moved(shot: Shot, px: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, shifted(shot.frames[k], *(px * _direction(shot.rng))))


def _blob(shot: Shot, radius: float = 0.12) -> Array:
    height, width = shot.frames.shape[1:]
    v, u = np.mgrid[:height, :width]
    at = shot.rng.uniform(0.2, 0.8, 2) * (height, width)
    return np.exp(-((v - at[0]) ** 2 + (u - at[1]) ** 2) / (radius * width) ** 2)


def reflection(shot: Shot, levels: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, grey(shot.frames[k] + levels * _blob(shot)))


def vibration(shot: Shot, px: float) -> Array:
    way = _direction(shot.rng)
    return _each(shot.frames, lambda k, f: shifted(f, *(px * np.sin(2.1 * k + 1) * way)))


def torn(shot: Shot, share: float) -> Array:
    k, rows = shot.one(), _rows(shot, share)
    return _only(shot.frames, k, np.concatenate([
        shot.frames[k][: rows.start], shot.frames[k - 1][rows], shot.frames[k][rows.stop :]
    ]))  # fmt: skip


def _rows(shot: Shot, share: float) -> slice:
    height = shot.frames.shape[1]
    rows = max(2, int(share * height))
    top = int(shot.rng.integers(0, height - rows))
    return slice(top, top + rows)


def camera_along(shot: Shot, px: float) -> Array:
    du, dv = np.array(shot.along()) * px * shot.rng.choice([-1, 1])
    return _each(shot.frames, lambda _, f: shifted(f, du, dv))


def camera_across(shot: Shot, px: float) -> Array:
    a, b = shot.along()
    return _each(shot.frames, lambda _, f: shifted(f, -b * px, a * px))


def jpeg(shot: Shot, quality: float) -> Array:
    flags = [cv2.IMWRITE_JPEG_QUALITY, int(quality)]
    return _each(shot.frames, lambda _, f: cv2.imdecode(cv2.imencode(".jpg", f, flags)[1], cv2.IMREAD_GRAYSCALE))


def rows_dropped(shot: Shot, rows: float) -> Array:
    n, top = int(rows), int(shot.rng.integers(40, shot.frames.shape[1] - 60))
    f = shot.frames
    return np.concatenate([f[:, :top], f[:, top + n :], np.repeat(f[:, -1:], n, axis=1)], axis=1)


def defocus(shot: Shot, px: float) -> Array:
    return _each(shot.frames, lambda _, f: cv2.GaussianBlur(f, (0, 0), px))


def listed_further(shot: Shot, places: float) -> Array:
    n = len(shot.frames)
    return shot.frames[::-1] if places > 2 else np.roll(shot.frames, -(int(places) % n or 1), axis=0)


def plate_higher(shot: Shot, mm: float) -> Array:
    return shot.redrawn(mm)


def mirrored(shot: Shot, way: float) -> Array:
    return (shot.frames[:, :, ::-1], shot.frames[:, ::-1], shot.frames[:, ::-1, ::-1])[int(way)].copy()


def turned(shot: Shot, deg: float) -> Array:
    height, width = shot.frames.shape[1:]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), deg, 1.0)
    return _each(shot.frames, lambda _, f: warped(f, matrix))


def rescaled(shot: Shot, percent: float) -> Array:
    height, width = shot.frames.shape[1:]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 0.0, 1 + percent / 100)
    return _each(shot.frames, lambda _, f: warped(f, matrix))


def flicker(shot: Shot, percent: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, grey(shot.frames[k] * (1 + percent / 100)))


def jitter_of_lines(shot: Shot, px: float) -> Array:
    k = shot.one()
    frame = shot.frames[k].copy()
    for row in np.flatnonzero(shot.rng.random(len(frame)) < 0.1):
        frame[row] = np.roll(frame[row], int(px))
    return _only(shot.frames, k, frame)


def one_frame_blurred(shot: Shot, px: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, cv2.GaussianBlur(shot.frames[k], (0, 0), px))


def overexposed(shot: Shot, gain: float) -> Array:
    return grey(shot.frames * gain)


def other_gamma(shot: Shot, gamma: float) -> Array:
    return grey(255 * (shot.frames / 255) ** gamma)


def wrong_step(shot: Shot, deg: float) -> Array:
    shifts = shot.case.phase_shifts_rad.copy()
    shifts[1 + shot.rng.integers(len(shifts) - 1)] += np.radians(deg)
    return shot.redrawn(shifts=shifts)


def drift(shot: Shot, px: float) -> Array:
    way = _direction(shot.rng) * px
    return _each(shot.frames, lambda k, f: shifted(f, *(k * way)))


def ambient(shot: Shot, levels: float) -> Array:
    return grey(shot.frames.astype(float) + levels)


def gradient_in_one(shot: Shot, levels: float) -> Array:
    k, width = shot.one(), shot.frames.shape[2]
    return _only(shot.frames, k, grey(shot.frames[k] + levels * np.linspace(0, 1, width)))


def missing_rows(shot: Shot, share: float) -> Array:
    k = shot.one()
    frame = shot.frames[k].copy()
    frame[_rows(shot, share)] = 0
    return _only(shot.frames, k, frame)


def frame_doubled(shot: Shot, back: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, shot.frames[(k + int(back)) % len(shot.frames)])


def frames_swapped(shot: Shot, back: float) -> Array:
    order = np.arange(len(shot.frames))
    i = shot.one()
    j = (i + int(back)) % len(order)
    if i == j:
        j = (i + 1) % len(order)
    order[[i, j]] = order[[j, i]]
    return shot.frames[order]


def shadow_in_one(shot: Shot, share: float) -> Array:
    k = shot.one()
    return _only(shot.frames, k, grey(shot.frames[k] * (1 - share * _blob(shot))))


def plate_tilted(shot: Shot, mm: float) -> Array:
    truth = shot.case.frames
    return shot.redrawn(mm * (truth.x / np.ptp(truth.x)))


def few_bits(shot: Shot, bits: float) -> Array:
    step = 2 ** (8 - int(bits))
    return (shot.frames // step * step + step // 2).astype(np.uint8)


def bursts(shot: Shot, share: float) -> Array:
    k = shot.one()
    hit = shot.rng.random(shot.frames[k].shape) < share
    return _only(shot.frames, k, np.where(hit, 255, shot.frames[k]).astype(np.uint8))


def moved_midway(shot: Shot, px: float) -> Array:
    du, dv = _direction(shot.rng) * px
    first = 1 + int(shot.rng.integers(len(shot.frames) - 1))
    return _each(shot.frames, lambda k, f: shifted(f, du, dv) if k >= first else f)


def smoothed(shot: Shot, side: float) -> Array:
    return _each(shot.frames, lambda _, f: cv2.medianBlur(f, int(side)))


def rows_of_plate(shot: Shot, share: float) -> Array:
    k, rows = shot.one(), _rows(shot, share)
    frame = shot.frames[k].copy()
    frame[rows] = shot.plate[k][rows]
    return _only(shot.frames, k, frame)


def rolling(shot: Shot, px: float) -> Array:
    du, dv = _direction(shot.rng) * px
    half = shot.frames.shape[1] // 2
    return _each(shot.frames, lambda _, f: np.concatenate([f[:half], shifted(f, du, dv)[half:]]))


def halo(shot: Shot, levels: float) -> Array:
    return grey(shot.frames + levels * _blob(shot, 0.3))


TABLE: dict[str, tuple[Callable[[Shot, float], Array], tuple[float, float, float]]] = {
    "one frame moved, px": (one_frame_moved, (0.5, 2, 4)),
    "reflection in one frame, levels": (reflection, (10, 30, 80)),
    "vibration, px": (vibration, (0.2, 0.5, 1)),
    "torn frame, share of rows": (torn, (0.03, 0.1, 0.3)),
    "camera along the fringes, px": (camera_along, (1, 3, 10)),
    "JPEG, quality": (jpeg, (60, 25, 5)),
    "rows dropped": (rows_dropped, (1, 3, 10)),
    "defocus, px": (defocus, (0.7, 1.5, 3)),
    "listed further, places": (listed_further, (1, 2, 3)),
    "plate higher, mm": (plate_higher, (0.15, 0.5, 1.0)),
    "mirrored or turned": (mirrored, (0, 1, 2)),
    "camera across the fringes, px": (camera_across, (0.5, 2, 8)),
    "picture turned, deg": (turned, (0.1, 0.3, 1.0)),
    "picture rescaled, %": (rescaled, (0.1, 0.4, 1.5)),
    "flicker, %": (flicker, (3, 10, 30)),
    "jitter of lines, px": (jitter_of_lines, (1, 2, 4)),
    "one frame blurred, px": (one_frame_blurred, (1, 2, 4)),
    "overexposed, gain": (overexposed, (1.3, 1.7, 2.2)),
    "other gamma": (other_gamma, (0.9, 0.75, 0.6)),
    "wrong phase shift, deg": (wrong_step, (3, 10, 25)),
    "drift, px a frame": (drift, (0.1, 0.4, 1.0)),
    "ambient light, levels": (ambient, (10, 30, 60)),
    "gradient in one frame, levels": (gradient_in_one, (5, 15, 40)),
    "missing rows, share": (missing_rows, (0.01, 0.05, 0.2)),
    "frame doubled": (frame_doubled, (1, 2, 1)),
    "frames swapped": (frames_swapped, (1, 2, 1)),
    "shadow in one frame, share": (shadow_in_one, (0.1, 0.3, 0.8)),
    "plate tilted, mm": (plate_tilted, (0.2, 0.8, 2.5)),
    "few bits": (few_bits, (5, 4, 3)),
    "bursts in one frame, share": (bursts, (0.001, 0.01, 0.05)),
    "moved midway, px": (moved_midway, (0.5, 2, 5)),
    "smoothed, side": (smoothed, (3, 5, 9)),
    "rows of the plate's frame, share": (rows_of_plate, (0.05, 0.15, 0.4)),
    "lower half moved, px": (rolling, (1, 3, 8)),
    "halo in all frames, levels": (halo, (10, 30, 80)),
}


def drawn(number: int, seed: int) -> Shot:
    """Draw a case, take its bare plate twice, and let the calibration know the first."""
    case = draw_case(number, seed=seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, 1)))
    plates = [render(case.spec, Scene(), seed=int(rng.integers(2**31))).frames for _ in range(2)]
    look = PlateLook.of(demodulate(plates[0], case.phase_shifts_rad))
    look = replace(look, phase_shifts_rad=tuple(map(float, case.phase_shifts_rad)))
    wave = estimate_waveform(plates[0], case.phase_shifts_rad)
    return Shot(
        case.frames.frames, replace(case, calibration=replace(case.calibration, look=look, wave=wave)), plates[1], rng
    )


def nuisances(shot: Shot) -> Array:
    """Give a capture another exposure, some more ambient light and more noise."""
    rng = shot.rng
    brighter = shot.frames * rng.uniform(0.9, 1.05) + rng.uniform(-1, 2)
    return grey(brighter + rng.uniform(0, 1.5) * rng.standard_normal(shot.frames.shape))


def measured(shot: Shot, frames: Array) -> tuple[Measurement | None, str]:
    """Measure frames as `fringecal reconstruct` does; None and the refusal where it refuses."""
    steps = tuple(np.degrees(shot.case.phase_shifts_rad))
    try:
        capture = capture_of_arrays("object", "object", frames, phase_shifts_deg=steps)
        return reconstruct(session_of_captures([capture], rig="drawn"), "object", shot.case.calibration), ""
    except FringecalError as error:
        return None, str(error)


def judged(shot: Shot, frames: Array) -> dict[str, object]:
    """What is said of a capture, and how many of its pixels are off."""
    found, refusal = measured(shot, frames)
    if found is None:
        return {"exit": 1, "named": True, "beyond": 0.0, "valid": 0.0, "says": refusal[-160:]}
    checks, causes = measurement_checks(found), measurement_causes(found)
    failed = [check.name for check in checks if check.decision == "fail"]
    truth, surface = shot.case.frames, found.surface
    valid = surface.mask & truth.lit
    off = np.abs(surface.z - truth.z)[valid] > BEYOND_U * surface.u_z[valid]
    says = "; ".join(causes) + f" [{', '.join(failed)}]"
    return {
        "exit": 3 if failed else 0,
        "named": bool(causes),
        "beyond": float(off.mean()) if off.size else 0.0,
        "valid": float(valid.mean()),
        "says": says,
    }


def rows_of(number: int, seed: int, words: str) -> list[dict[str, object]]:
    """All faults at all strengths in one case."""
    shot = drawn(number, seed)
    usual = judged(shot, shot.frames)
    rows = [{"case": number, "kind": shot.case.kind, "fault": "none", "strength": 0.0} | usual | {"harm": 0.0}]
    for name, (change, strengths) in TABLE.items():
        if words in name:
            for strength in strengths:
                one = judged(shot, change(shot, strength))
                quiet = one["exit"] == 0 and not one["named"]
                harm = max(one["beyond"] - usual["beyond"], 0.0) if quiet else 0.0
                rows.append(
                    {"case": number, "kind": shot.case.kind, "fault": name, "strength": strength} | one | {"harm": harm}
                )
    return rows


def clean_rows(number: int, seed: int) -> dict[str, object]:
    """One clean capture with honest nuisances."""
    shot = drawn(number, seed)
    return {"case": number, "kind": shot.case.kind} | judged(shot, nuisances(shot))


def table_of(rows: pd.DataFrame) -> pd.DataFrame:
    """Rates of every fault and strength."""
    faults = rows[rows.fault != "none"]
    return faults.groupby(["fault", "strength"], sort=False).agg(
        cases=("case", "size"),
        noticed=("exit", lambda e: float((e != 0).mean())),
        named=("named", "mean"),
        quiet_and_off=("harm", lambda h: int((h > USUAL).sum())),
        worst=("harm", "max"),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0, help="odd seeds are for the last word, and looked at once")
    parser.add_argument("--fault", default="", help="only faults whose name holds these words")
    parser.add_argument("--clean", type=int, default=0, help="so many clean captures instead of faults")
    parser.add_argument("--every", action="store_true", help="print every capture")
    chosen = parser.parse_args()
    pd.set_option("display.width", 250, "display.max_colwidth", 170, "display.max_rows", None)
    if chosen.clean:
        clean = pd.DataFrame([clean_rows(n, chosen.seed) for n in range(chosen.first, chosen.first + chosen.clean)])
        spoken = clean[(clean.exit == 3) | (clean.named & (clean.exit == 0))]
        print(spoken.to_string(index=False) if len(spoken) else "none named")
        print(f"false names: {len(spoken)} of {len(clean)} clean captures; refused: {(clean.exit == 1).sum()}")
    else:
        cases = range(chosen.first, chosen.first + chosen.cases)
        rows = pd.DataFrame([row for n in cases for row in rows_of(n, chosen.seed, chosen.fault)])
        if chosen.every:
            print(rows.to_string(index=False))
        print(table_of(rows).to_string(float_format="{:.3f}".format))
        print(f"off by more than 3 U, exit 0, nothing named: {(rows.harm > USUAL).sum()} of {len(rows)}")
