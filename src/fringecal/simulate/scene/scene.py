"""What lies under a virtual rig: a plate, convex solids, spheres, a height field, a printed pattern."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fringecal.errors import FringecalError
from fringecal.simulate.scene.printed_patterns import BLANK, Pattern

FORM_ORDER = 4  # powers of x and of y in the form of a plate, from 0: bows, twists, and one order more


_NODES = 9  # along each side of a solid, at which the form under it is taken
_PIECE_MM = (
    30.0  # of a long solid on a form: a plate that bends by 0.2 mm over 200 mm leaves 2 micrometres of bend in it
)


@dataclass(frozen=True)
class Form:
    """What a plate that is not flat has over its plane: terms (power of x, power of y, mm) of x and y over a unit."""

    terms: tuple[tuple[int, int, float], ...] = ()
    unit_mm: float = 1.0

    def height(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Return the height over the plane at points of the plate, mm."""
        s, t = np.asarray(x_mm, float) / self.unit_mm, np.asarray(y_mm, float) / self.unit_mm
        return sum((mm * s**i * t**j for i, j, mm in self.terms), np.zeros(np.broadcast(s, t).shape))

    def plane_under(self, corners_mm: np.ndarray) -> np.ndarray:
        """Return the plane (c0, cx, cy) nearest to the form over the bounds of corners (k, 3)."""
        (x0, y0), (x1, y1) = corners_mm[:, :2].min(axis=0), corners_mm[:, :2].max(axis=0)
        x, y = (c.ravel() for c in np.meshgrid(np.linspace(x0, x1, _NODES), np.linspace(y0, y1, _NODES)))
        return np.linalg.lstsq(np.column_stack([np.ones_like(x), x, y]), self.height(x, y), rcond=None)[0]


@dataclass(frozen=True)
class Solid:
    """A convex solid, the intersection of half spaces.

    Parameters
    ----------
    planes
        Shape (m, 4): outward unit normals and distances; inside is ``n.X <= d``, mm.
    corners
        Shape (k, 3): its corners in mm, from which its bounding box is taken.
    albedo
        Reflectance relative to the plate.
    """

    planes: np.ndarray
    corners: np.ndarray
    albedo: float = 1.0

    def placed(self, x_mm: float, y_mm: float, angle_rad: float) -> "Solid":
        """Turn the solid about the plate's normal, then move it."""
        turn, shift = _rotation(angle_rad), np.array([x_mm, y_mm, 0.0])
        normals = self.planes[:, :3] @ turn.T
        distances = self.planes[:, 3] + normals @ shift
        return Solid(np.column_stack([normals, distances]), self.corners @ turn.T + shift, self.albedo)

    def pieces(self, most_mm: float) -> "tuple[Solid, ...]":
        """Cut the solid across x or y, whichever it is longer along, into pieces no longer than so much."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        axis = int(high[1] - low[1] > high[0] - low[0])
        edges = np.linspace(low[axis], high[axis], 1 + max(1, int(np.ceil((high - low)[axis] / most_mm))))
        return tuple(self._piece(axis, a, b) for a, b in zip(edges[:-1], edges[1:], strict=True))

    def _piece(self, axis: int, low: float, high: float) -> "Solid":
        sides = np.zeros((2, 4))
        sides[:, axis], sides[:, 3] = (-1.0, 1.0), (-low, high)
        corners = self.corners.copy()
        corners[:, axis] = np.clip(corners[:, axis], low, high)
        return Solid(np.vstack([self.planes, sides]), corners, self.albedo)

    def sheared(self, plane: np.ndarray) -> "Solid":
        """Raise every point by c0 + cx x + cy y: as good as a turn for slopes of a thousandth."""
        c0, cx, cy = plane
        normals, lift = self.planes[:, :3].copy(), self.planes[:, 2] * c0
        normals[:, :2] -= np.outer(self.planes[:, 2], (cx, cy))
        length = np.linalg.norm(normals, axis=1)
        planes = np.column_stack([normals, self.planes[:, 3] + lift]) / length[:, None]
        rise = c0 + self.corners[:, :2] @ np.array([cx, cy])
        return Solid(planes, self.corners + np.outer(rise, (0.0, 0.0, 1.0)), self.albedo)


@dataclass(frozen=True)
class HeightField:
    """Heights above the plate on a regular grid, bilinear between its nodes and 0 outside of it.

    Parameters
    ----------
    z_mm
        Shape (ny, nx); row 0 is the lowest y. Heights must not be negative; where they are 0, the
        plate is seen.
    step_mm
        Distance between nodes.
    albedo
        Shape (ny, nx): reflectance relative to the plate.
    centre_mm, angle_rad
        Where the middle of the grid lies on the plate, and its turn about the normal.
    """

    z_mm: np.ndarray
    step_mm: float
    albedo: np.ndarray
    centre_mm: tuple[float, float] = (0.0, 0.0)
    angle_rad: float = 0.0

    def __post_init__(self) -> None:
        z = np.asarray(self.z_mm)
        if z.ndim != 2 or min(z.shape) < 2 or not np.all(np.isfinite(z)) or z.min() < 0:
            raise FringecalError(
                f"height field of shape {z.shape}: needs a 2-D array of at least 2 x 2 finite heights >= 0"
            )
        if np.shape(self.albedo) != z.shape:
            raise FringecalError(f"albedo of shape {np.shape(self.albedo)} for heights of shape {z.shape}")
        if self.step_mm <= 0:
            raise FringecalError(f"height field with nodes {self.step_mm:g} mm apart; give a positive step")

    def placed(self, x_mm: float, y_mm: float, angle_rad: float) -> "HeightField":
        """Turn the field about the plate's normal, then move it."""
        centre = _rotation(angle_rad)[:2, :2] @ np.array(self.centre_mm) + (x_mm, y_mm)
        return replace(self, centre_mm=(float(centre[0]), float(centre[1])), angle_rad=self.angle_rad + angle_rad)


@dataclass(frozen=True)
class Scene:
    """Everything the camera can see, in the plate frame.

    Parameters
    ----------
    solids, spheres, height_field
        What stands on the plate; a sphere is (x, y, z, radius, albedo) in mm.
    base
        The flat that lies under everything: z = c0 + cx x + cy y, as (c0 in mm, cx, cy); the
        reference plate itself is (0, 0, 0).
    form
        What that flat has over its plane.
    pattern
        What is printed on the flat.
    """

    solids: tuple[Solid, ...] = ()
    spheres: tuple[tuple[float, float, float, float, float], ...] = ()
    height_field: HeightField | None = None
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    form: Form = Form()
    pattern: Pattern = field(default=BLANK)

    def placed(self, x_mm: float = 0.0, y_mm: float = 0.0, angle_deg: float = 0.0) -> "Scene":
        """Turn everything on the plate about the origin, then move it; the flat itself stays."""
        angle = float(np.radians(angle_deg))
        turn = _rotation(angle)
        return replace(
            self,
            solids=tuple(solid.placed(x_mm, y_mm, angle) for solid in self.solids),
            spheres=tuple(_placed_sphere(s, turn, x_mm, y_mm) for s in self.spheres),
            height_field=self.height_field and self.height_field.placed(x_mm, y_mm, angle),
            pattern=self.pattern.placed(x_mm, y_mm, angle),
        )

    def on_form(self, form: Form) -> "Scene":
        """Give the flat a form; solids and spheres lie close on it: long solids bend with it, none rests on a bow."""
        pieces = (piece for solid in self.solids for piece in solid.pieces(_PIECE_MM))
        solids = tuple(piece.sheared(form.plane_under(piece.corners)) for piece in pieces)
        spheres = tuple(
            (x, y, z + float(form.height(np.array(x), np.array(y))), r, a) for x, y, z, r, a in self.spheres
        )
        return replace(self, solids=solids, spheres=spheres, form=form)

    def on_flat(self, height_mm: float, tilt_x_deg: float = 0.0, tilt_y_deg: float = 0.0) -> "Scene":
        """Raise and tilt the flat: it rises toward +x by `tilt_x_deg` and toward +y by `tilt_y_deg`."""
        slopes = np.tan(np.radians([tilt_x_deg, tilt_y_deg]))
        return replace(self, base=(float(height_mm), float(slopes[0]), float(slopes[1])))


def plate() -> Scene:
    """Return the bare reference plate."""
    return Scene()


def together(scenes: Sequence[Scene]) -> Scene:
    """Put the solids and spheres of several scenes on one plate; the first one's other parts stay."""
    return replace(
        scenes[0],
        solids=tuple(solid for scene in scenes for solid in scene.solids),
        spheres=tuple(sphere for scene in scenes for sphere in scene.spheres),
    )


def _rotation(angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _placed_sphere(
    sphere: tuple[float, float, float, float, float], turn: np.ndarray, x_mm: float, y_mm: float
) -> tuple[float, float, float, float, float]:
    x, y, z = turn @ sphere[:3]
    return float(x + x_mm), float(y + y_mm), float(z), sphere[3], sphere[4]
