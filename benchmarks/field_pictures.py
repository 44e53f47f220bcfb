"""Pictures of all the kinds that come from the field, drawn with their truth: right, refused, or silently wrong.

    python benchmarks/field_pictures.py [--each 20] [--seed 0] [--kind WORDS]

Kinds: millimetre paper, Gray code with blurred edges, absolute phase by periods, dots (also enlarged twofold, with
specks), ChArUco boards of OpenCV before 4.6, coloured rulings, uneven scans, foreign frames, corrections of steps and
brightness, breaks of a laser line. Refused with a reason is not wrong; wrong is a result that the truth contradicts and
nothing said. Odd seeds are for the last word, and looked at once.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.camera import examine_distortion
from fringecal.cli.shared.pictures import read_channels
from fringecal.detect import find_charuco, find_dot_grid, find_grid
from fringecal.detect.fringes.line_breaks import line_breaks
from fringecal.errors import FringecalError
from fringecal.phase import demodulate, demodulate_adapted, diagnose
from gray_edges import MIN_DECIDED, MIN_RIGHT, gray_set
from gray_edges import rates as gray_rates
from millimetre_paper import judged as paper_judged
from millimetre_paper import paper
from period_pieces import period_set
from period_pieces import rates as period_rates

type Array = NDArray[np.float64]
type Picture = NDArray[np.uint8]
type Draw = np.random.Generator
type Verdict = tuple[str, str]

FINER = 4  # samples of a drawn picture for each pixel along either side
NEAR_PX = 0.5  # of a crossing, a corner or a dot to its true place
STEPS = ((0, 120, 240), (0, 90, 180, 270), (0, 72, 144, 216, 288), tuple(range(0, 360, 45)))
INKS = {"red": (250, 90, 90), "orange": (250, 165, 60), "green": (80, 220, 90), "blue": (70, 110, 250),
        "pale red": (250, 215, 215), "pale green": (215, 245, 220)}  # fmt: skip


def grey(values: Array) -> Picture:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def homography(rng: Draw, shape: tuple[int, int], px: float, turn_deg: float, tilt: float) -> Array:
    """Picture from plate in units of the pattern's pitch: `px` pixels for one in the middle, turned and tilted."""
    turn = np.deg2rad(rng.uniform(-turn_deg, turn_deg))
    lean = rng.uniform(-tilt, tilt, 2) * px / max(shape)
    at = (shape[1] - 1) / 2 + rng.uniform(-0.5, 0.5) * px, (shape[0] - 1) / 2 + rng.uniform(-0.5, 0.5) * px
    place = np.array(
        [[px * np.cos(turn), -px * np.sin(turn), 0], [px * np.sin(turn), px * np.cos(turn), 0], [*lean, 1]]
    )
    return np.array([[1, 0, at[0]], [0, 1, at[1]], [0, 0, 1.0]]) @ place


def mapped(matrix: Array, x: Array, y: Array) -> tuple[Array, Array]:
    u, v, w = np.tensordot(matrix, np.stack([x, y, np.ones_like(x)]), 1)
    return u / w, v / w


def on_pattern(matrix: Array, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Place on the pattern under every sample of a picture."""
    v, u = (np.mgrid[: shape[0] * FINER, : shape[1] * FINER] + 0.5) / FINER - 0.5
    return mapped(np.linalg.inv(matrix), u, v)


def photographed(rng: Draw, cover: Array, ink: float, ground: float, shape: tuple[int, int]) -> Array:
    """Light of a pattern that covers its ground so far: blurred, shaded, with noise."""
    light = ndimage.gaussian_filter(ground + (ink - ground) * cover, FINER * rng.uniform(0.3, 1.0))
    light = light.reshape(shape[0], FINER, shape[1], FINER).mean(axis=(1, 3))
    y, x = np.mgrid[: shape[0], : shape[1]]
    light *= 1 + rng.uniform(-0.2, 0.2) * (x / shape[1] - 0.5) + rng.uniform(-0.2, 0.2) * (y / shape[0] - 0.5)
    return light + rng.normal(0, rng.uniform(0.5, 3), shape)


def millimetre_paper(rng: Draw) -> Verdict:
    return paper_judged(paper(int(rng.integers(2**31))))


def gray_code(rng: Draw) -> Verdict:
    right, decided = gray_rates(gray_set(int(rng.integers(2**31))))
    words = f"{right:.3%} right, {decided:.1%} decided"
    return ("wrong" if right < MIN_RIGHT else "right" if decided >= MIN_DECIDED else "refused"), words


def periods(rng: Draw) -> Verdict:
    decided, wrong, words = period_rates(period_set(int(rng.integers(2**31))), stated=False)
    return ("wrong" if wrong > 1 - MIN_RIGHT else "right" if decided > 0.5 else "refused"), f"{wrong:.2%}: {words}"


def dots(rng: Draw) -> Verdict:
    """Draw a board of dots, dark or light, some hidden under specks; it may be enlarged twofold."""
    shape, px = (480, 640), float(rng.uniform(16, 44))
    columns, rows = int(min(rng.integers(7, 24), 560 // px)), int(min(rng.integers(6, 18), 420 // px))
    matrix = homography(rng, shape, px, 12, 0.15)
    x, y = on_pattern(matrix, shape)
    col, row = x + (columns - 1) / 2, y + (rows - 1) / 2
    radius = rng.uniform(0.16, 0.34)
    inside = (np.rint(col) >= 0) & (np.rint(col) < columns) & (np.rint(row) >= 0) & (np.rint(row) < rows)
    off = (radius - np.hypot(col - np.rint(col), row - np.rint(row))) * px * FINER
    cover = np.where(inside, np.clip(off + 0.5, 0, 1), 0)
    dark = rng.uniform() < 0.6
    ink, ground = (rng.uniform(20, 90), rng.uniform(160, 235))[:: 1 if dark else -1]
    picture = photographed(rng, cover, ink, ground, shape)
    for _ in range(int(rng.integers(0, 300))):  # dust and noise of the print, smaller than the dots
        v, u = rng.integers(2, shape[0] - 2), rng.integers(2, shape[1] - 2)
        picture[v : v + 2, u : u + 2] += rng.choice([-1, 1]) * rng.uniform(20, 90)
    picture = grey(picture)
    at = np.stack(np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2), -1).reshape(
        -1, 2
    )
    u, v = mapped(matrix, *at.T)
    if rng.uniform() < 0.4:
        picture, u, v = cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), 2 * u + 0.5, 2 * v + 0.5
    found = find_dot_grid(picture)
    return _of_points(found.u_px, found.v_px, u, v, picture.shape, margin=2 * radius * px, least=0.95)


def _of_points(
    u: Array, v: Array, true_u: Array, true_v: Array, shape: tuple[int, int], *, margin: float, least: float
) -> Verdict:
    """Judge found points: each at a true one, and nearly all that are wholly in the picture found."""
    apart = np.hypot(u[:, None] - true_u, v[:, None] - true_v)
    stray = float(np.mean(apart.min(axis=1) > NEAR_PX))
    whole = (true_u > margin) & (true_v > margin) & (true_u < shape[1] - margin) & (true_v < shape[0] - margin)
    seen = float(np.mean(apart.min(axis=0)[whole] < NEAR_PX))
    words = f"{len(u)} of {whole.sum()} found, {stray:.1%} stray, {seen:.1%} of the true ones"
    return ("wrong" if stray > 0.01 else "right" if seen >= least else "wrong"), words


def charuco(rng: Draw) -> Verdict:
    """Draw a board as OpenCV before 4.6 printed it, or as later versions do, part of it beyond the picture."""
    squares = int(rng.integers(5, 10)), int(rng.integers(2, 6)) * 2
    kind = str(rng.choice(["DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250"]))
    board = cv2.aruco.CharucoBoard(squares, 1.0, 0.72, cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, kind)))
    board.setLegacyPattern(bool(rng.uniform() < 0.7))
    sheet = board.generateImage((squares[0] * 80, squares[1] * 80))
    shape, px = (480, 640), float(rng.uniform(34, 56))
    matrix = homography(rng, shape, px, 25, 0.2)
    to_sheet = np.array([[1 / 80, 0, 0.5 / 80 - squares[0] / 2], [0, 1 / 80, 0.5 / 80 - squares[1] / 2], [0, 0, 1]])
    picture = _seen_from_afar(sheet, matrix @ to_sheet, shape)
    light = ndimage.gaussian_filter(picture * rng.uniform(0.5, 0.9) + 15, rng.uniform(0.5, 1.0))
    picture = grey(light + rng.normal(0, rng.uniform(0.5, 3), shape))
    found = find_charuco(picture, squares, marker_part=0.72, dictionary=kind)
    row, column = np.nonzero(np.isfinite(found).all(axis=2))
    u, v = mapped(matrix, column + 1 - squares[0] / 2, row + 1 - squares[1] / 2)
    off = np.hypot(found[row, column, 0] - u, found[row, column, 1] - v)
    return ("right" if (off < NEAR_PX).all() else "wrong"), f"{len(off)} corners, off by {off.max():.2f} px at most"


def _seen_from_afar(sheet: Picture, to_picture: Array, shape: tuple[int, int]) -> Array:
    """Average what each pixel sees of a sheet: sampled at its middle alone, edges would lie off by a quarter pixel."""
    finer = np.array([[FINER, 0, (FINER - 1) / 2], [0, FINER, (FINER - 1) / 2], [0, 0, 1]])
    size = shape[1] * FINER, shape[0] * FINER
    drawn = cv2.warpPerspective(sheet.astype(np.float32), finer @ to_picture, size, borderValue=235)
    return drawn.reshape(shape[0], FINER, shape[1], FINER).mean(axis=(1, 3), dtype=float)


def colour_ruling(rng: Draw) -> Verdict:
    """Draw a ruling in one ink on white paper; the channel is left to be chosen."""
    shape, px, name = (360, 480), float(rng.uniform(12, 30)), str(rng.choice(list(INKS)))
    matrix = homography(rng, shape, px, 10, 0.12)
    x, y = on_pattern(matrix, shape)
    width = rng.uniform(1.2, 2.6) / px / 2
    off = np.minimum(np.abs(x - np.rint(x)), np.abs(y - np.rint(y)))
    cover = np.clip((width - off) * px * FINER + 0.5, 0, 1)
    layers = [photographed(np.random.default_rng(k), cover, ink, 245, shape) for k, ink in enumerate(INKS[name])]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ruling.png"
        cv2.imwrite(str(path), np.stack([grey(one) for one in layers[::-1]], axis=-1))
        found = _best_of(path)
    u, v = found.u_px, found.v_px
    col, row = mapped(np.linalg.inv(matrix), u, v)
    off = np.hypot(*mapped(matrix, np.rint(col), np.rint(row)) - np.stack([u, v]))
    steps = _steps(found.row, found.column, np.rint(row), np.rint(col))
    verdict = "right" if (off < NEAR_PX).mean() > 0.99 and steps else "wrong"
    return (
        verdict,
        f"{name}: {len(u)} crossings, {np.mean(off < NEAR_PX):.1%} in place, indices {'' if steps else 'not '}right",
    )


def _best_of(path: Path):  # noqa: ANN202 -- a GridDetection
    """Detect as `fringecal grid` does: the channel with most crossings."""
    found, refused = [], None
    for _, (picture,) in read_channels([path], None)[:3]:
        try:
            found.append(find_grid(picture))
        except FringecalError as error:
            refused = error
    if not found:
        raise refused or FringecalError("no channel")
    return max(found, key=lambda grid: len(grid.u_px))


def _steps(row: Array, column: Array, true_row: Array, true_column: Array) -> bool:
    """Whether found indices are the true ones but for their origin."""
    return all(len(np.unique(np.rint(a - b))) == 1 for a, b in ((row, true_row), (column, true_column)))


def uneven_scan(rng: Draw) -> Verdict:
    """Draw a flatbed scan of a ruling whose lines stand off by 0.02 to 0.5 mm: there is no lens in a scanner."""
    shape, px_per_mm, pitch = (560, 720), float(rng.uniform(4, 8)), float(rng.uniform(3, 6))
    rms, likeness = float(np.exp(rng.uniform(np.log(0.02), np.log(0.35)))), float(rng.uniform(0, 0.95))
    turn = np.deg2rad(rng.uniform(-3, 3))
    v, u = (np.mgrid[: shape[0] * FINER, : shape[1] * FINER] + 0.5) / FINER / px_per_mm
    x, y = u * np.cos(turn) - v * np.sin(turn) + 500, u * np.sin(turn) + v * np.cos(turn) + 500
    near = [_distance(rng, at, pitch, rms, likeness) for at in (x, y)]
    width = rng.uniform(0.15, 0.4) / 2
    cover = np.clip((width - np.minimum(*near)) * px_per_mm * FINER + 0.5, 0, 1)
    picture = grey(photographed(rng, cover, rng.uniform(60, 150), rng.uniform(200, 240), shape))
    test = examine_distortion(find_grid(picture))
    words = f"{test.verdict}, {test.max_px.value:.2f} px; lines off by {rms:.2f} mm"
    return ("right" if test.verdict == "none" else "wrong"), words


def _distance(rng: Draw, at: Array, pitch: float, rms: float, likeness: float) -> Array:
    """Distance to the nearest of uneven lines, each somewhat like the one before."""
    first = int(at.min() // pitch) - 2
    count = int(np.ptp(at) // pitch) + 5
    errors = rng.normal(size=count)
    for k in range(1, count):
        errors[k] = likeness * errors[k - 1] + np.sqrt(1 - likeness**2) * errors[k]
    lines = (first + np.arange(count)) * pitch + np.clip(rms * errors, -pitch / 4, pitch / 4)
    nearest = np.clip(np.searchsorted(lines, at), 1, count - 1)
    return np.minimum(np.abs(at - lines[nearest - 1]), np.abs(at - lines[nearest]))


def fringes(rng: Draw) -> tuple[Array, Array, Array]:
    """Draw a set over a curved, textured surface as real numbers, its phase shifts in rad, and its true phase."""
    shape = 240, 320
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    period, turn = rng.uniform(9, 30), rng.uniform(0, np.pi)
    phase = 2 * np.pi * (u * np.cos(turn) + v * np.sin(turn)) / period
    phase += rng.uniform(0, 3) * np.exp(-(((u - 160) / 60) ** 2) - ((v - 120) / 50) ** 2)
    rough = ndimage.gaussian_filter(rng.normal(size=shape), rng.uniform(0.7, 3))
    texture = np.clip(1 + rng.uniform(0, 0.15) * rough / rough.std(), 0.3, 1.3)
    steps = np.deg2rad(STEPS[int(rng.integers(len(STEPS)))])
    depth = rng.uniform(0.5, 0.9)
    return 90 * texture * (1 + depth * np.cos(phase + steps[:, None, None])), steps, phase


def foreign_frame(rng: Draw) -> Verdict:
    """Put a frame of another period, another scene, or a photograph into a set; it must be named."""
    frames, steps, _ = fringes(rng)
    k, kind = int(rng.integers(len(frames))), int(rng.integers(3))
    other = fringes(rng)[0][0]
    rough = ndimage.gaussian_filter(rng.normal(size=other.shape), 6)
    frames[k] = (other, 90 + 40 * rough / rough.std(), np.roll(other, 40, axis=1)[::-1])[kind]
    found = diagnose(grey(frames + rng.normal(0, rng.uniform(0.5, 2), frames.shape)), steps)
    named = [one.kind.value for one in found.findings]
    fatal = any(one.kind.fatal for one in found.findings)
    return ("right" if fatal else "wrong"), f"frame {k + 1} of {len(frames)}: {', '.join(named) or 'nothing'}"


def corrections(rng: Draw) -> Verdict:
    """Give frames another brightness, contrast and wrong steps, or none of it: no correction may make phase worse."""
    frames, steps, phase = fringes(rng)
    spoilt = rng.uniform() < 0.6
    gain = 1 + (rng.uniform(-0.1, 0.1, len(frames)) if spoilt else 0.0) * np.ones(len(frames))
    off = np.deg2rad(rng.uniform(-6, 6, len(frames))) * spoilt
    off -= off.mean()
    light = frames.mean(axis=0)
    wave = light + (frames.max(axis=0) - light) * np.cos(phase + (steps + off)[:, None, None])
    taken = grey(gain[:, None, None] * wave + rng.normal(0, rng.uniform(0.5, 2), frames.shape))
    errors = []
    for found in (demodulate(taken, steps), demodulate_adapted(taken, steps).map):
        step = np.angle(np.exp(1j * (found.phase.astype(float) - phase)))
        step = step[np.isfinite(step)]
        errors.append(float(np.sqrt(np.mean(np.angle(np.exp(1j * (step - np.angle(np.exp(1j * step).mean())))) ** 2))))
    verdict = "right" if errors[1] <= errors[0] * 1.05 + 0.002 else "wrong"
    return verdict, f"{len(steps)} steps, {'spoilt' if spoilt else 'clean'}: {errors[0]:.4f} to {errors[1]:.4f} rad rms"


def laser(rng: Draw) -> Verdict:
    """Draw a laser line over a plate with a block on it, or without; flanks blurred, the ground dark or not."""
    shape = 200, 400
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    shift = float(rng.choice([0.0, rng.uniform(7, 40) * rng.choice([-1, 1])]))
    first, last = 130 + rng.uniform(-40, 20), 250 + rng.uniform(-20, 60)
    flank = rng.uniform(0.5, 6)
    step = 0.5 * (np.tanh((u[0] - first) / flank) - np.tanh((u[0] - last) / flank))
    centre = 95 + rng.uniform(-0.04, 0.04) * (u[0] - 200) + shift * step
    peak, width, noise = rng.uniform(12, 220), rng.uniform(1.3, 4), rng.uniform(0.3, 2)
    picture = rng.uniform(0, 12) + peak * np.exp(-0.5 * ((v - centre) / width) ** 2)
    found = line_breaks(grey(picture + rng.normal(0, noise, shape))).breaks
    words = f"{shift:+.1f} px, peak {peak:.0f}: {[round(one.shift_px, 1) for one in found]}"
    if shift == 0:
        return ("right" if not found else "wrong"), words
    right = len(found) == 1 and abs(found[0].shift_px - shift) < max(0.5, 3 * found[0].sigma_px)
    return ("right" if right else "wrong"), words


KINDS: dict[str, Callable[[Draw], Verdict]] = {
    "millimetre paper": millimetre_paper,
    "Gray code": gray_code,
    "absolute phase": periods,
    "dots": dots,
    "ChArUco": charuco,
    "colour": colour_ruling,
    "uneven scan": uneven_scan,
    "foreign frame": foreign_frame,
    "corrections": corrections,
    "laser line": laser,
}


def drawn(each: int, seed: int, words: str) -> Iterator[dict[str, object]]:
    """Draw and judge pictures of every kind."""
    for k, (name, kind) in enumerate(KINDS.items()):
        for number in range(each) if words in name else ():
            rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(k, number)))
            try:
                verdict, said = kind(rng)
            except FringecalError as error:
                verdict, said = "refused", str(error)
            yield {"kind": name, "number": number, "verdict": verdict, "says": said[:200]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", default="", help="only kinds whose name holds these words")
    chosen = parser.parse_args()
    rows = []
    for one in drawn(chosen.each, chosen.seed, chosen.kind):
        rows.append(one)
        if one["verdict"] != "right":
            print(f"{one['kind']} {one['number']}: {one['verdict']}: {one['says']}", flush=True)
    table = pd.DataFrame(rows)
    print(pd.crosstab(table["kind"], table["verdict"]).to_string())
    print(", ".join(f"{count} {name}" for name, count in table["verdict"].value_counts().items()))
