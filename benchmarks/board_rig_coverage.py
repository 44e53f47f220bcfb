"""How often the 95 % intervals of a rig that was calibrated by a board in poses hold the truth.

Rigs are drawn wide: a camera of 1 to 5 Mpx 250 to 1500 mm away, a projector of either raster at 10 to 45 deg to it,
lenses that bend in both, 6 to 25 poses, a print whose scale, stretch and flatness are drawn from their stated
uncertainties, corners and phases with noise, the ripple that a response curve leaves; a quarter of the projectors have
fringes along one axis. Pictures are made by OpenCV's projection, not by the package's. Each rig is calibrated, and then
measures points throughout its volume, the length between two of them, and a ball.

    python benchmarks/board_rig_coverage.py --cases 500 --seed 1

prints the share of intervals that hold, with its own standard uncertainty: points of one rig share its errors, so that
rigs count and not points.
"""

import argparse
import time
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.polynomial import legendre

from fringecal.errors import FitError
from fringecal.projector import BoardPose, BoardRig, BoardStatement, fit_board_rig, rig_points
from fringecal.uncertainty import coverage_factor

POINTS = 6  # measured in each rig
FORM_TERMS = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
HARMONIC = 3  # of the phase, at which three steps leave the response's ripple


@dataclass(frozen=True)
class Device:
    """A pinhole with Brown's terms (k1, k2, p1, p2, k3), seen by OpenCV."""

    size: tuple[int, int]
    matrix: np.ndarray
    terms: np.ndarray

    def see(
        self, points: np.ndarray, rotation: np.ndarray | None = None, shift: np.ndarray | None = None
    ) -> np.ndarray:
        turn = np.zeros(3) if rotation is None else cv2.Rodrigues(rotation)[0]
        move = np.zeros(3) if shift is None else shift
        return cv2.projectPoints(points, turn, move, self.matrix, self.terms)[0].reshape(-1, 2)


@dataclass(frozen=True)
class Drawn:
    """A rig and what it measures with: devices, pose of the projector, noise."""

    camera: Device
    projector: Device
    rotation: np.ndarray
    shift: np.ndarray
    distance: float
    field: float
    corner_px: float
    noise_px: float
    ripple_px: float
    period_px: float
    ripple_phase: float
    axes: int

    def light(self, points: np.ndarray) -> np.ndarray:
        return self.projector.see(points, self.rotation, self.shift)

    def read(self, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Projector coordinates by phase: with noise and the response's ripple."""
        lit = self.light(points)
        ripple = self.ripple_px * np.sin(HARMONIC * 2 * np.pi * lit / (self.period_px * self.rows) + self.ripple_phase)
        found = lit + (ripple + self.noise_px * rng.standard_normal(lit.shape)) * self.rows
        return found if self.axes == 2 else found * [1.0, np.nan]

    @property
    def rows(self) -> np.ndarray:
        """Scatter of columns and rows over that of columns: fringes along both axes have one width on the board."""
        return np.array([1.0, round(float(self.projector.matrix[1, 1] / self.projector.matrix[0, 0]))])

    @property
    def u_px(self) -> float:
        return float(np.hypot(self.noise_px, self.ripple_px / np.sqrt(2)))


def draw_terms(rng: np.random.Generator, corner: float) -> np.ndarray:
    """Brown's terms that move a corner of the picture by up to some per cent of its radius."""
    k1, k2, k3 = rng.normal(0, [0.02, 0.005, 0.002]) / corner ** np.array([2, 4, 6])
    p1, p2 = rng.normal(0, 0.001, 2) / corner
    return np.array([k1, k2, p1, p2, k3])


def draw_device(
    rng: np.random.Generator, size: tuple[int, int], aspect: float, offset: float, field: float, away: float
):
    fx = size[0] * away / field
    cx, cy = (
        (size[0] - 1) / 2 + rng.normal(0, 0.01 * size[0]),
        (size[1] - 1) / 2 + offset * size[1] + rng.normal(0, 0.01 * size[1]),
    )
    matrix = np.array([[fx, 0, cx], [0, fx * aspect, cy], [0, 0, 1]])
    corner = np.hypot(size[0] / fx, size[1] / (fx * aspect)) / 2
    return Device(size, matrix, draw_terms(rng, corner))


def draw_rig(rng: np.random.Generator) -> Drawn:
    camera_size = [(1280, 1024), (1920, 1200), (2448, 2048)][rng.integers(3)]
    distance = float(np.exp(rng.uniform(np.log(250), np.log(1500))))
    field = distance * rng.uniform(0.25, 0.7)
    camera = draw_device(rng, camera_size, rng.normal(1, 3e-4), 0.0, field, distance)
    diamond = rng.random() < 0.4
    size, aspect = ((912, 1140), 2.0) if diamond else ((1920, 1080), 1.0)
    offset = rng.choice([0.0, 0.5]) if not diamond else 0.0  # a projector's lens is often shifted to throw upward
    away = distance * rng.uniform(0.7, 1.3)
    projector = draw_device(rng, size, aspect * rng.normal(1, 1e-3), offset, rng.uniform(1.0, 1.6) * field, away)
    side, angle = rng.choice([-1.0, 1.0]), np.radians(rng.uniform(10, 45))
    rotation = look_at(side * angle, rng)
    centre_of_field = np.array([0, 0, distance])
    # The frame's middle looks at the middle of the volume.
    middle = np.linalg.inv(projector.matrix) @ [(size[0] - 1) / 2, (size[1] - 1) / 2, 1]
    shift = away * middle / np.linalg.norm(middle) - rotation @ centre_of_field
    period = rng.uniform(16, 40)
    per_rad = period / (2 * np.pi)
    return Drawn(
        camera, projector, rotation, shift, distance, field,
        float(np.exp(rng.uniform(np.log(0.02), np.log(0.1)))),
        per_rad * rng.uniform(0.005, 0.03), per_rad * rng.uniform(0, 0.03), period, rng.uniform(0, 2 * np.pi),
        1 if rng.random() < 0.25 else 2,
    )  # fmt: skip


def look_at(angle: float, rng: np.random.Generator) -> np.ndarray:
    """Rotation of a projector that stands at an angle in the horizontal plane, roughly upright."""
    tilt = np.radians(rng.normal(0, 3, 2))
    around = cv2.Rodrigues(np.array([0, angle, 0]))[0]
    return cv2.Rodrigues(np.array([tilt[0], 0, tilt[1]]))[0] @ around


@dataclass(frozen=True)
class DrawnBoard:
    """A board: nominal points, true points with warp, and what is stated of it."""

    nominal: np.ndarray
    true: np.ndarray
    statement: BoardStatement


def draw_board(rng: np.random.Generator, field: float) -> DrawnBoard:
    columns, rows = int(rng.integers(9, 15)), int(rng.integers(7, 11))
    pitch = field * rng.uniform(0.5, 0.85) / columns
    x, y = (g.ravel() for g in np.meshgrid(np.arange(columns) * pitch, np.arange(rows) * pitch))
    nominal = np.column_stack([x, y, np.zeros(len(x))])
    scale_u, stretch_u = np.exp(rng.uniform(np.log(2e-5), np.log(5e-4), 2))
    flat_u = field * np.exp(rng.uniform(np.log(5e-5), np.log(5e-4)))
    scale, stretch = scale_u * rng.standard_normal(), stretch_u * rng.standard_normal()
    grid = np.zeros((4, 4))
    for i, j in FORM_TERMS:
        grid[i, j] = rng.standard_normal() * np.sqrt((2 * i + 1) * (2 * j + 1))
    lift = flat_u / np.sqrt(len(FORM_TERMS)) * legendre.legval2d(2 * x / x.max() - 1, 2 * y / y.max() - 1, grid)
    true = nominal * [1 + scale + stretch / 2, 1 + scale - stretch / 2, 1]
    true[:, 2] = lift
    return DrawnBoard(nominal, true, BoardStatement(float(scale_u), float(stretch_u), float(flat_u)))


def draw_pose(rng: np.random.Generator, rig: Drawn, board: DrawnBoard) -> tuple[np.ndarray, np.ndarray]:
    axis = rng.uniform(0, 2 * np.pi)
    tilt = np.radians(rng.uniform(5, 40))
    turn = (
        cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0]))[0]
        @ cv2.Rodrigues(np.array([0, 0, rng.choice([0, np.pi / 2, np.pi]) + rng.normal(0, 0.2)]))[0]
    )
    z = rig.distance + rng.uniform(-0.2, 0.2) * rig.field
    place = np.array([*rng.uniform(-0.25, 0.25, 2) * rig.field, z])
    place[1] *= rig.camera.size[1] / rig.camera.size[0]
    return turn, place - turn @ board.nominal.mean(axis=0)


def inside(points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return ((points > 2) & (points < np.array(size) - 3)).all(axis=1)


@dataclass(frozen=True)
class Spoilt:
    """What else is wrong: share of corners found elsewhere, of coordinates a fringe off, of poses in the glare."""

    corners: float = 0.0
    orders: float = 0.0
    glare: float = 0.0


def spoil(rng: np.random.Generator, pose: BoardPose, rig: Drawn, spoilt: Spoilt) -> BoardPose:
    """Put wrong corners, wrong orders and glare into a pose."""
    n = len(pose.board_mm)
    wrong = (rng.random(n) < spoilt.corners)[:, None] * rng.normal(0, 3.0, (n, 2))
    order = (rng.random((n, 2)) < spoilt.orders) * rig.period_px * rng.choice([-1, 1], (n, 2)) * rig.rows
    glare = (rng.random() < spoilt.glare) * 5 * rig.u_px * rng.standard_normal((n, 2)) * rig.rows
    return replace(pose, camera_px=pose.camera_px + wrong, projector_px=pose.projector_px + order + glare)


def capture(rng: np.random.Generator, rig: Drawn, board: DrawnBoard, k: int) -> BoardPose:
    """One pose: corners with an error, and the projector's coordinate of the board where the corner was found."""
    while True:
        turn, shift = draw_pose(rng, rig, board)
        points = board.true @ turn.T + shift
        corners = rig.camera.see(points)
        both = inside(corners, rig.camera.size) & inside(rig.light(points), rig.projector.size)
        if both.sum() >= 0.5 * len(points):
            break
    error = rig.corner_px * rng.standard_normal(corners.shape)
    # The error slides the place on the board along its surface: by the slope of the projection there.
    slope = np.stack([(rig.camera.see(points + turn[:, i] * 1e-3) - corners) / 1e-3 for i in (0, 1)], axis=2)
    slid = points + np.linalg.solve(slope, error[..., None])[..., 0] @ turn[:, :2].T
    seen, lit = np.where(both[:, None], corners + error, np.nan), np.where(both[:, None], rig.read(slid, rng), np.nan)
    return BoardPose(board.nominal, seen, lit, name=str(k))


@dataclass
class Tally:
    """Intervals that held, by quantity: rig by rig."""

    held: dict[str, list[float]]

    def add(self, name: str, values: np.ndarray) -> None:
        self.held.setdefault(name, []).append(float(np.mean(values)))


def measure(rng: np.random.Generator, rig: Drawn, fit: BoardRig, tally: Tally, ratios: dict[str, list[float]]) -> None:
    k = coverage_factor(fit.dof)
    truth = places(rng, rig)
    found = points_of(rng, rig, fit, truth)
    error = found.points_mm - truth
    for i, axis in enumerate("xyz"):
        tally.add(axis, np.abs(error[:, i]) <= k * found.u_mm[:, i])
        ratios.setdefault(axis, []).append(float(error[0, i] / found.u_mm[0, i]))
    joint = found.joint_covariance(fit)
    arm = found.points_mm[1] - found.points_mm[0]
    length = np.linalg.norm(arm)
    gradient = np.zeros(len(joint))
    gradient[:3], gradient[3:6] = -arm / length, arm / length
    off, u = length - np.linalg.norm(truth[1] - truth[0]), np.sqrt(gradient @ joint @ gradient)
    tally.add("length", np.array([abs(off) <= k * u]))
    ratios.setdefault("length", []).append(float(off / u))
    off, u = radius_error(rng, rig, fit)
    tally.add("radius", np.array([abs(off) <= k * u]))
    ratios.setdefault("radius", []).append(float(off / u))


def places(rng: np.random.Generator, rig: Drawn) -> np.ndarray:
    """Points throughout the volume that both devices see."""
    found: list[np.ndarray] = []
    while len(found) < POINTS:
        z = rig.distance + rng.uniform(-0.2, 0.2) * rig.field
        point = np.array([*rng.uniform(-0.4, 0.4, 2) * rig.field, z])
        point[1] *= rig.camera.size[1] / rig.camera.size[0]
        if (
            inside(rig.camera.see(point[None]), rig.camera.size)[0]
            and inside(rig.light(point[None]), rig.projector.size)[0]
        ):
            found.append(point)
    return np.stack(found)


def points_of(rng: np.random.Generator, rig: Drawn, fit: BoardRig, truth: np.ndarray):
    return rig_points(fit, rig.camera.see(truth), rig.read(truth, rng), projector_u_px=rig.u_px * rig.rows[None])


def radius_error(rng: np.random.Generator, rig: Drawn, fit: BoardRig) -> tuple[float, float]:
    """Error and u of the radius of a ball somewhere in the volume, by its visible cap."""
    radius = 0.08 * rig.field
    while True:
        centre = places(rng, rig)[0]
        away = -centre / np.linalg.norm(centre)
        spread = rng.standard_normal((600, 3))
        spread /= np.linalg.norm(spread, axis=1, keepdims=True)
        cap = centre + radius * spread[spread @ away > 0.5]
        if inside(rig.camera.see(cap), rig.camera.size).all() and inside(rig.light(cap), rig.projector.size).all():
            break
    found = points_of(rng, rig, fit, cap)
    at = centre
    for _ in range(6):
        arm = found.points_mm - at
        length = np.linalg.norm(arm, axis=1)
        design = np.column_stack([arm / length[:, None], np.ones(len(arm))])
        solved = np.linalg.lstsq(design, length, rcond=None)[0]
        at = at + solved[:3]
    by_point = np.linalg.pinv(design)[3][:, None] * design[:, :3]
    by_rig = np.einsum("ni,nim->m", by_point, found.by_rig)
    own = np.einsum("ni,nij,nj->", by_point, found.random_mm2, by_point)
    return float(solved[3] - radius), float(np.sqrt(by_rig @ fit.covariance @ by_rig + own))


def run(cases: int, seed: int, spoilt: Spoilt, *, verbose: bool = False) -> Tally:
    tally, ratios, refused, took, failed = Tally({}), {}, 0, 0.0, []
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        rig = draw_rig(rng)
        board = draw_board(rng, rig.field)
        poses = [capture(rng, rig, board, k) for k in range(int(rng.integers(6, 26)))]
        if spoilt != Spoilt():
            poses = [spoil(rng, pose, rig, spoilt) for pose in poses]
        start = time.perf_counter()
        try:
            fit = fit_board_rig(
                poses, rig.camera.size, rig.projector.size, board=board.statement,
                projector_aspect=2.0 if rig.projector.size == (912, 1140) else 1.0,
            )  # fmt: skip
        except FitError as error:
            refused += 1
            failed.append((case, str(error)[:80]))
            continue
        took += time.perf_counter() - start
        if verbose:
            print(
                case,
                len(poses),
                rig.axes,
                f"s {fit.rig.camera_s_px / rig.corner_px:.3f} {fit.rig.projector_s_px / rig.u_px:.3f}",
                end=" ",
            )
        measure(rng, rig, fit.rig, tally, ratios)
        if verbose:
            print({q: round(r[-1], 1) for q, r in ratios.items()})
    print(
        f"seed {seed}: {cases} rigs, {refused} refused, {1e3 * took / max(cases - refused, 1):.0f} ms a solve",
        failed[:5],
    )
    for name, shares in tally.held.items():
        ratio = np.array(ratios[name])
        print(
            f"  {name:7s} {100 * np.mean(shares):5.1f} % +- {100 * np.std(shares) / np.sqrt(len(shares)):.1f}"
            f"   error / u: sd {ratio.std():.2f}, robust {1.4826 * np.median(np.abs(ratio)):.2f},"
            f" largest {np.abs(ratio).max():.1f}"
        )
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument(
        "--spoilt", action="store_true", help="2 % wrong corners, 1 % wrong orders, a fifth in the glare"
    )
    options = parser.parse_args()
    spoilt = Spoilt(0.02, 0.01, 0.2) if options.spoilt else Spoilt()
    run(options.cases, options.seed, spoilt, verbose=options.verbose)


if __name__ == "__main__":
    main()
