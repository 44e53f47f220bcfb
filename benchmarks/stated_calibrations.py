"""Calibrations as others make them (OpenCV, a board in poses), good ones and spoiled ones: which are refused, and why.

    python benchmarks/stated_calibrations.py [rigs] [first seed]

Each rig is drawn from its seed: cameras of 1 to 5 Mpx, projectors that throw upward by up to three quarters of their
frame, square pixels or diamonds, distortion in both, 10 to 40 deg between them; a board in 8 to 15 poses, corners found
to 0.05 px in the camera and 0.1 px in the projector. OpenCV calibrates both and their pose, with k3, as its users do.
Then the same with one thing spoiled. Counted is what `fringecal lens` says: refused, or open by another reason than
that no uncertainty is stated.
"""

import sys
from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.projector import StatedPair, pair_doubts

BOARD = (11, 8)
SPOILED = (
    "nothing",
    "print stretched by 8 %",
    "projector's picture scaled by 10 % along rows",
    "centre pinned in the projector",
    "three poses, hardly tilted",
    "lengths in metres",
    "pose inverted",
    "picture half as large as stated",
    "ripple of 3 px in the projector",
)


@dataclass(frozen=True)
class Rig:
    """A drawn rig, and where its board's corners are seen, pose by pose."""

    camera: Lens
    projector: Lens
    board_mm: np.ndarray
    camera_px: list[np.ndarray]
    projector_px: list[np.ndarray]


def drawn_lens(rng: np.random.Generator, size: tuple[int, int], up: float, aspect: float) -> Lens:
    """A lens as they are built: terms by their share at the corner."""
    focal = size[0] * rng.uniform(1.0, 2.2)
    corner = np.hypot(size[0], size[1] / aspect) / 2 / focal
    k1 = rng.uniform(-0.08, 0.04) / corner**2
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) * (0.5 + up)]) + rng.normal(0, 0.01, 2) * size
    return Lens(np.array([focal, focal * aspect, *middle, k1, 0, *rng.normal(0, 3e-4, 2), 0]), np.zeros((9, 9)), *size)


def core(lens: Lens) -> np.ndarray:
    fx, fy, cx, cy = lens.values[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def seen(lens: Lens, points: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, core(lens), lens.values[4:])[0][:, 0]


def drawn_rig(rng: np.random.Generator, poses: int, tilt_deg: float, stretch: float) -> Rig:
    """Draw a rig, and a board before it that both see whole."""
    camera = drawn_lens(rng, [(1280, 1024), (1920, 1200), (2448, 2048)][rng.integers(3)], 0.0, 1.0)
    diamond = rng.random() < 0.25
    size = (912, 1140) if diamond else [(1280, 800), (1920, 1080)][rng.integers(2)]
    projector = drawn_lens(rng, size, rng.choice([0.0, 0.0, rng.uniform(0.3, 0.75)]), 2.0 if diamond else 1.0)
    distance = rng.uniform(400, 1200)
    angle = np.radians(rng.uniform(10, 40)) * rng.choice([-1, 1])
    # The projector looks so that the middle of its frame, not its axis, meets the camera's at the distance.
    frame = projector.unproject(np.array([[(size[0] - 1) / 2, (size[1] - 1) / 2]]))[0]
    turn = Rotation.from_rotvec([0, angle, 0])
    tip = Rotation.from_rotvec(np.cross([0, 0, 1.0], frame / np.linalg.norm(frame)) * 1.0)
    centre = np.array([distance * np.sin(angle), 0, distance * (1 - np.cos(angle))])
    rotation = (tip * turn).as_matrix()
    field = distance * min(camera.height_px / camera["fy_px"], size[1] / projector["fy_px"])
    pitch = 0.75 * field / max(BOARD)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(BOARD[0]) * pitch, np.arange(BOARD[1]) * pitch))
    stated = np.column_stack([x, y, 0 * x])
    real = stated * [stretch, 1, 1]
    camera_px, projector_px = [], []
    for k in range(poses):
        axis = 2 * np.pi * (k / poses + 0.1 * rng.random())
        tilt = np.radians(tilt_deg * rng.uniform(0.7, 1.1))
        away = Rotation.from_rotvec(tilt * np.array([np.cos(axis), np.sin(axis), 0])).apply(real - real.mean(axis=0))
        aside = rng.uniform(-0.12, 0.12, 2) * field
        points = away + [*aside, distance * rng.uniform(0.92, 1.08)]
        camera_px.append(seen(camera, points, np.eye(3), np.zeros(3)) + rng.normal(0, 0.05, (len(points), 2)))
        projector_px.append(
            seen(projector, points, rotation, -rotation @ centre) + rng.normal(0, 0.1, (len(points), 2))
        )
    return Rig(camera, projector, stated, camera_px, projector_px)


def calibrated(rig: Rig, *, pinned: bool = False) -> StatedPair:
    """What OpenCV makes of the corners."""
    board = [rig.board_mm.astype(np.float32)] * len(rig.camera_px)
    lenses, errors = [], {}
    for who, lens, pixels in (("camera", rig.camera, rig.camera_px), ("projector", rig.projector, rig.projector_px)):
        guess = core(lens)
        guess[:2, 2] = (lens.width_px - 1) / 2, (lens.height_px - 1) / 2
        flags = cv2.CALIB_USE_INTRINSIC_GUESS | (cv2.CALIB_FIX_PRINCIPAL_POINT if pinned and who == "projector" else 0)
        corners = [each.astype(np.float32) for each in pixels]
        size = (lens.width_px, lens.height_px)
        error, matrix, terms, _, _ = cv2.calibrateCamera(board, corners, size, guess, np.zeros(5), flags=flags)
        values = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(terms)[:5]])
        lenses.append(Lens(values, np.zeros((9, 9)), *size, covariance_known=False))
        errors[who] = float(error)
    camera, projector = ([each.astype(np.float32) for each in pixels] for pixels in (rig.camera_px, rig.projector_px))
    found = cv2.stereoCalibrate(
        board, camera, projector, core(lenses[0]), lenses[0].values[4:], core(lenses[1]), lenses[1].values[4:],
        (rig.camera.width_px, rig.camera.height_px), flags=cv2.CALIB_FIX_INTRINSIC,
    )  # fmt: skip
    return StatedPair(lenses[0], lenses[1], found[5], np.ravel(found[6]), "OpenCV", errors)


def stated(seed: int, spoiled: str) -> StatedPair:
    """Return the calibration of a seed with one thing spoiled."""
    rng = np.random.default_rng(seed)
    few = spoiled == "three poses, hardly tilted"
    count = 3 if few else int(rng.integers(8, 16))
    rig = drawn_rig(rng, count, 4.0 if few else 28.0, 1.08 if spoiled == "print stretched by 8 %" else 1.0)
    if spoiled == "projector's picture scaled by 10 % along rows":
        rig = replace(rig, projector_px=[each * [1, 1.1] for each in rig.projector_px])
    if spoiled == "ripple of 3 px in the projector":
        rig = replace(rig, projector_px=[each + 3 * np.sin(2 * np.pi * each / 24) for each in rig.projector_px])
    pair = calibrated(rig, pinned=spoiled == "centre pinned in the projector")
    if spoiled == "lengths in metres":
        return replace(pair, shift_mm=pair.shift_mm / 1000)
    if spoiled == "pose inverted":
        return pair.reversed()
    if spoiled == "picture half as large as stated":
        return replace(
            pair, camera=replace(pair.camera, width_px=pair.camera.width_px * 2, height_px=2 * pair.camera.height_px)
        )
    return pair


def corner_error_px(found: Lens, truth: Lens) -> float:
    """How far off the picture's corners are, once the camera is turned to fit the middle of its field."""
    width, height = found.width_px, found.height_px
    grid = np.linspace(0.3, 0.7, 7)
    middle = np.stack(np.meshgrid(grid * width, grid * height), axis=-1).reshape(-1, 2)
    corners = np.array([[0.0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]])
    rays, theirs = truth.unproject(middle), found.unproject(middle)
    turn = Rotation.align_vectors(*(each / np.linalg.norm(each, axis=1, keepdims=True) for each in (rays, theirs)))[0]
    return float(np.abs(truth.project(turn.apply(found.unproject(corners))) - corners).max())


def corners_of(rigs: int, first: int) -> None:
    """Print how far off the corners of good calibrations are, by what is said of their distortion."""
    errors: dict[str, list[float]] = {"not named": [], "distortion's terms": [], "distortion folds": []}
    for seed in range(first, first + 2 * rigs, 2):
        rng = np.random.default_rng(seed)
        rig = drawn_rig(rng, int(rng.integers(8, 16)), 28.0, 1.0)
        pair = calibrated(rig)
        names = {(one.subject, one.name) for one in pair_doubts(pair)}
        for who, found, truth in (("camera", pair.camera, rig.camera), ("projector", pair.projector, rig.projector)):
            key = next(
                (name for name in ("distortion folds", "distortion's terms") if (who, name) in names), "not named"
            )
            errors[key].append(corner_error_px(found, truth))
    for key, values in errors.items():
        known = [value for value in values if np.isfinite(value)]
        middle = f"{np.median(known):.1f} px" if known else "-"
        none = len(values) - len(known)
        print(f"{key:20s} {len(values):4d} lenses: corners off by {middle} (median), no ray there in {none}")


def main(rigs: int = 40, first: int = 1) -> None:
    """Print, for each way of spoiling, how many calibrations are refused or left open, and the reasons."""
    for spoiled in SPOILED:
        refused = opened = failed = 0
        names = Counter[str]()
        for seed in range(first, first + 2 * rigs, 2):
            try:
                doubts = [one for one in pair_doubts(stated(seed, spoiled)) if one.name != "no uncertainty"]
            except cv2.error:
                failed += 1
                continue
            refused += any(one.refused for one in doubts)
            opened += bool(doubts) and not any(one.refused for one in doubts)
            names.update({f"{one.subject} {one.name}{'!' if one.refused else ''}" for one in doubts})
        common = ", ".join(f"{name} {count}" for name, count in names.most_common(4))
        print(f"{spoiled:46s} {rigs - failed:3d}: {refused:3d} refused, {opened:3d} open; {common}")
    corners_of(rigs, first)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
