"""Are faults of a board rig's captures named, and nothing of clean ones?

The rigs are those of `board_rig_coverage.py`. Every fault is put into such rigs in turn: a print stretched by
0.3 to 2 %, a camera or a projector whose focus moves from pose to pose by 0.2 to 1 %, three poses or poses alike, one
pose whose points are numbered otherwise in the projector, a frame that a scaler or a keystone correction changes.

    python benchmarks/board_rig_faults.py --cases 50 --seed 1

prints how often each is named, how often a rig is named for something else as well, and what is said of clean ones.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from board_rig_coverage import Drawn, DrawnBoard, capture, draw_board, draw_rig
from fringecal.errors import FitError
from fringecal.projector import BoardPose, RigFaultKind, fit_board_rig, rig_faults

Rng = np.random.Generator
FAULTS = ("clean", "stretch", "camera focus", "projector focus", "few", "alike", "numbering", "scaler", "keystone")
EXPECTED = {
    "clean": set(),
    "stretch": {RigFaultKind.STRETCHED_PRINT},
    "camera focus": {RigFaultKind.FOCUS_CHANGED},
    "projector focus": {RigFaultKind.FOCUS_CHANGED},
    "few": {RigFaultKind.POSES_TOO_FEW, RigFaultKind.POSES_ALIKE},
    "alike": {RigFaultKind.POSES_ALIKE},
    "numbering": {RigFaultKind.NUMBERED_OTHERWISE},
    "scaler": {RigFaultKind.FRAME_SCALED},
    "keystone": {RigFaultKind.FRAME_SCALED},
}


def zoomed(device, factor: float):
    matrix = device.matrix.copy()
    matrix[[0, 1], [0, 1]] *= factor
    return replace(device, matrix=matrix)


def warped(pose: BoardPose, homography: np.ndarray) -> BoardPose:
    """The frame's pixels of what the raster lights: where the frame was changed on its way to the raster."""
    known = np.isfinite(pose.projector_px).all(axis=1)
    lit = pose.projector_px.copy()
    lit[known] = cv2.perspectiveTransform(lit[None, known], homography)[0]
    return replace(pose, projector_px=lit)


def keystone(rng: Rng, size: tuple[int, int]) -> np.ndarray:
    """A trapezium whose upper edge is shorter by 10 to 30 %, on one side more than on the other."""
    w, h = size
    left, right = rng.uniform(0.05, 0.15, 2) * w
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    return cv2.getPerspectiveTransform(np.array([[left, 0], [w - right, 0], [w, h], [0, h]], np.float32), corners)


def captured(rng: Rng, fault: str, rig: Drawn, board: DrawnBoard, count: int) -> list[BoardPose]:
    """Poses with a fault in them."""
    if fault == "stretch":
        true = board.true * [1 + rng.choice([-1, 1]) * rng.uniform(0.003, 0.02), 1, 1]
        return [capture(rng, rig, replace(board, true=true), k) for k in range(count)]
    if fault in ("camera focus", "projector focus"):
        device, size, found = fault.split()[0], rng.uniform(0.002, 0.01), []
        for k in range(count):
            moved = replace(rig, **{device: zoomed(getattr(rig, device), 1 + size * rng.standard_normal())})
            found.append(capture(rng, moved, board, k))
        return found
    if fault == "few":
        return [capture(rng, rig, board, k) for k in range(3)]
    if fault == "alike":
        return alike(rng, rig, board, count)
    poses = [capture(rng, rig, board, k) for k in range(count)]
    if fault == "numbering":
        k = int(rng.integers(count))
        order = np.arange(len(board.nominal))[::-1]
        poses[k] = replace(poses[k], projector_px=poses[k].projector_px[order], read_at_camera=False)
    if fault == "scaler":
        factor = rng.choice([1.125, 0.9, 1.0667, 0.9375])
        poses = [replace(p, projector_px=p.projector_px * [1.0, factor]) for p in poses]
    if fault == "keystone":
        matrix = keystone(rng, rig.projector.size)
        poses = [warped(p, matrix) for p in poses]
    return poses


def alike(rng: Rng, rig: Drawn, board: DrawnBoard, count: int) -> list[BoardPose]:
    """Poses within some degrees of one another, all at one distance."""
    import board_rig_coverage as drawn

    usual = drawn.draw_pose

    def near(rng: Rng, rig: Drawn, board: DrawnBoard):
        small = cv2.Rodrigues(np.radians(rng.normal(0, 2, 3)))[0] @ cv2.Rodrigues(np.radians([8.0, 0, 0]))[0]
        place = np.array([*rng.uniform(-0.1, 0.1, 2) * rig.field, rig.distance])
        return small, place - small @ board.nominal.mean(axis=0)

    drawn.draw_pose = near
    try:
        return [capture(rng, rig, board, k) for k in range(count)]
    finally:
        drawn.draw_pose = usual


def run(cases: int, seed: int, faults: tuple[str, ...], *, verbose: bool) -> None:
    for fault in faults:
        named, others, said = 0, 0, {}
        for case in range(cases):
            rng = np.random.default_rng([seed, FAULTS.index(fault), case])
            rig = draw_rig(rng)
            if fault in ("scaler", "keystone", "numbering"):
                rig = replace(rig, axes=2)
            board = draw_board(rng, rig.field)
            poses = captured(rng, fault, rig, board, int(rng.integers(7, 26)))
            aspect = 2.0 if rig.projector.size == (912, 1140) else 1.0
            try:
                fit = fit_board_rig(
                    poses, rig.camera.size, rig.projector.size, board=board.statement, projector_aspect=aspect
                )
                found = rig_faults(fit, projector_aspect=aspect)
                kinds = {one.kind for one in found}
            except FitError as error:
                found, kinds = (error,), {"refused"}
            hit = bool(kinds & EXPECTED[fault]) or ("refused" in kinds and fault in ("few", "alike"))
            named += hit
            others += bool(kinds - EXPECTED[fault] - {"refused"})
            for kind in kinds:
                said[str(getattr(kind, "value", kind))] = said.get(str(getattr(kind, "value", kind)), 0) + 1
            if verbose and (not hit or kinds - EXPECTED[fault]) and (fault != "clean" or kinds):
                print("   ", case, len(poses), rig.axes, [str(getattr(f, "message", f))[:110] for f in found])
        print(f"{fault:16s} named {named}/{cases}, other names too {others}/{cases}: {said}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--faults", nargs="*", default=FAULTS)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    run(options.cases, options.seed, tuple(options.faults), verbose=options.verbose)


if __name__ == "__main__":
    main()
