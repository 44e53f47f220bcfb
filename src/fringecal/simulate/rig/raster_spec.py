"""What a virtual rig of camera and raster projector is: one document in the camera's own frame."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, Field, FiniteFloat, model_validator

from fringecal.errors import FringecalError
from fringecal.simulate.rig.rig_spec import (
    CAPTURED,
    Fraction,
    NoiseSpec,
    NotNegative,
    Pair,
    Part,
    PlateSpec,
    Point,
    Positive,
    SurfaceSpec,
    checked,
)

Five = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
Nine = tuple[
    FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat
]
Side = Annotated[int, Field(ge=8, le=20000)]
RASTER_KINDS = Literal["board", "reference", "artefact", "object"]


class RasterCameraSpec(Part):
    """The camera: a pinhole at the origin that looks along z; x runs right and y down in its picture.

    `focal_px` holds for columns and rows; `distortion` is Brown's k1, k2, p1, p2, k3 in OpenCV's order.
    """

    width_px: Side = 640
    height_px: Side = 512
    bits: Annotated[int, Field(ge=8, le=16)] = 8
    focal_px: Positive
    principal_offset_px: Pair = (0.0, 0.0)
    distortion: Five = (0.0,) * 5
    vignetting: Fraction = 0.0
    defocus_px: NotNegative = 0.0
    gamma: Positive = 1.0

    @property
    def white_level(self) -> int:
        """Largest grey level of the sensor."""
        return (1 << self.bits) - 1


class RasterProjectorSpec(Part):
    """The projector: a raster behind a lens, seen as an inverse camera.

    It stands at `position_mm` of the camera's frame, its axis passes `aim_mm`, and its rows lie along the camera's x
    but for `roll_deg` about the axis. `focal_px` counts columns; a row is `pixel_aspect` times as high as a column is
    wide.
    `centre_px` is where the axis passes the raster (its middle by default), `distortion` Brown's. A pixel of level v
    emits `black + (1 - black) (v / 255)^gamma`; `blur_px` is the standard deviation of its image's blur. On a
    `diamond` raster every second row lies half a column further on, and rows are half a column apart. `frame`, a
    homography by rows, leads from the raster's pixels to those of the frame that is sent: a scaler or a keystone
    correction stands between, where it is not the identity.
    """

    columns: Side = 640
    rows: Side = 360
    position_mm: Point
    aim_mm: Point
    roll_deg: FiniteFloat = 0.0
    focal_px: Positive
    pixel_aspect: Positive = 1.0
    diamond: bool = False
    centre_px: Pair | None = None
    distortion: Five = (0.0,) * 5
    gamma: Positive = 1.0
    black: Fraction = 0.002
    blur_px: NotNegative = 0.5
    frame: Nine = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class FringesSpec(Part):
    """What is projected: numbers of fringes across the raster along each axis, their contrast and phase shifts.

    `zeros_deg` is each period's phase at the first pixel, one of each or one for all; `falling` lists the axes along
    which the phase falls.
    """

    axes: tuple[Literal["u", "v"], ...] = ("u", "v")
    fringes: tuple[Positive, ...] = (1.0, 8.0, 64.0)
    steps_deg: tuple[FiniteFloat, ...] = (0.0, 120.0, 240.0)
    error_deg: tuple[FiniteFloat, ...] = ()
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.95
    zeros_deg: tuple[FiniteFloat, ...] = (0.0,)
    falling: tuple[Literal["u", "v"], ...] = ()

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        if len(self.error_deg) not in (0, len(self.steps_deg)):
            raise ValueError(f"error_deg: {len(self.error_deg)} values for {len(self.steps_deg)} phase shifts")
        if len(self.zeros_deg) not in (1, len(self.fringes)):
            raise ValueError(f"zeros_deg: {len(self.zeros_deg)} values for {len(self.fringes)} periods")
        return self


class RasterLightSpec(Part):
    """Exposure: the share of the white level at which white paper is seen under the projector's white at its aim.

    `ambient` is room light over that; `shading` turns Lambert's cosine and the inverse square on.
    """

    white_grey: Annotated[float, Field(gt=0, le=1)] = 0.85
    ambient: NotNegative = 0.02
    shading: bool = True


class RasterCaptureSpec(Part):
    """One capture: a flat and what lies on it, in any pose before the camera.

    The flat's origin is at `position_mm` of the camera's frame. With no turn it faces the camera, its x to the right
    and its y up in the picture; `turn_deg` turns it about the camera's x, then y, then z, through its origin.
    `sheet_mm` is the size of the flat along its x and y; beyond it is dark. Without, it goes on. A print is longer by
    `stretch`, relative, along its x than it is stated to be.
    """

    name: str
    kind: RASTER_KINDS
    target: str | dict[str, Any] | None = None
    use: Literal["calibration", "verification"] | None = None
    position_mm: Point
    turn_deg: Point = (0.0, 0.0, 0.0)
    sheet_mm: tuple[Positive, Positive] | None = None
    stretch: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.0


class RasterRigSpec(Part):
    """A virtual rig with a raster projector, as one TOML document states it; `kind` tells it from one with a slide."""

    format: Literal[1] = 1
    kind: Literal["raster"] = "raster"
    name: str
    about: str = ""
    captured: AwareDatetime = CAPTURED
    camera: RasterCameraSpec
    projector: RasterProjectorSpec
    fringes: FringesSpec = FringesSpec()
    light: RasterLightSpec = RasterLightSpec()
    noise: NoiseSpec = NoiseSpec()
    surface: SurfaceSpec = SurfaceSpec()
    plate: PlateSpec = PlateSpec()
    capture: tuple[RasterCaptureSpec, ...] = ()

    def at(self, **sections: Mapping[str, Any] | str | list[Any]) -> "RasterRigSpec":
        """Return a copy with some values changed, checked again: one mapping of changes per section."""
        document = self.model_dump()
        for section, changes in sections.items():
            old = document.get(section)
            both = isinstance(old, dict) and isinstance(changes, Mapping)
            document[section] = {**old, **changes} if both else changes  # type: ignore[dict-item]
        return raster_rig_from(document, "changed rig")

    def capture_named(self, name: str) -> RasterCaptureSpec:
        """Find one of the rig's captures by name."""
        for capture in self.capture:
            if capture.name == name:
                return capture
        known = ", ".join(capture.name for capture in self.capture) or "none"
        raise FringecalError(f"rig {self.name}: no capture {name!r}; it has {known}")


def raster_rig_from(document: Mapping[str, Any], where: str) -> RasterRigSpec:
    """Check a rig document and list all of its faults at once."""
    return checked(RasterRigSpec, document, where)
