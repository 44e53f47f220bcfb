"""The twelve kinds of target, format 1: frozen values that refuse to contradict themselves.

Common to all: lengths in mm, angles in degrees; `width_mm` runs along x (across strips, ridges and
steps), `length_mm` along y, heights along z from the plate. What the numbers mean in space is in
`fringecal.targets.geometry`.
"""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    StringConstraints,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from fringecal.targets.aruco import check_dictionary
from fringecal.targets.quantity import HOW_TO_STATE, Positive, Positives, Quantity, Scalar

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, strict=True)]
Count = Annotated[int, Field(strict=True, ge=1)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
REFERENCE_DEGC = 20.0
"""Temperature at which lengths are stated (ISO 1:2022)."""
AtLeastTwo = Annotated[int, Field(strict=True, ge=2)]


class Artefact(BaseModel):
    """What every target states: a name and where its numbers come from.

    What several lengths have in common is stated beside them: `instrument_u_mm` is the standard uncertainty of the
    calibration of the `instrument` that they were measured with, which no u of theirs then contains. Lengths hold at
    20 degC; with `expansion_per_K` they are used as they are at `temperature_degC`, or at the session's.
    `thermal_rel_u` is what temperature adds to all of them, relative.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    name: Text
    certificate: Text
    instrument: Text | None = None
    instrument_u_mm: NotNegative = 0.0
    expansion_per_K: Scalar | None = None  # noqa: N815 -- the unit is written so
    temperature_degC: Scalar | None = None  # noqa: N815
    thermal_rel_u: NotNegative = 0.0

    @model_serializer(mode="wrap")
    def _without_what_is_not_stated(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # What an older file could not state is left out where it is not stated: equal targets stay equal.
        return {key: value for key, value in write(self).items() if key not in _OPTIONAL or value not in (None, 0.0)}

    def warmed(self, temperature_degC: float | None, u_degC: float) -> Self:  # noqa: N803 -- as above
        """Return the target with its lengths as they are at its own temperature, or at one that is given.

        Parameters
        ----------
        temperature_degC, u_degC
            Temperature where the target states none; None leaves the lengths as they are.

        Notes
        -----
        ``L = L20 (1 + alpha (t - 20))``, ``u^2(L) / L^2 = alpha^2 u^2(t) + (t - 20)^2 u^2(alpha)`` (ISO 1).
        """
        own = self.temperature_degC
        degrees, u_degrees = (temperature_degC, u_degC) if own is None else (own.value, own.us[0])
        if self.expansion_per_K is None or degrees is None:
            return self
        alpha, over = self.expansion_per_K, degrees - REFERENCE_DEGC
        lengths = {name: getattr(self, name) for name in type(self).model_fields if name.endswith("_mm")}
        changes: dict[str, Any] = {
            name: length.scaled(1 + alpha.value * over)
            for name, length in lengths.items()
            if isinstance(length, Quantity)
        }
        added = math.hypot(self.thermal_rel_u, alpha.value * u_degrees, alpha.us[0] * over)
        return self.model_copy(
            update=changes | {"expansion_per_K": None, "temperature_degC": None, "thermal_rel_u": added}
        )


_OPTIONAL = frozenset(set(Artefact.model_fields) - {"format", "name", "certificate"})


def _must_be_below(smaller: Quantity, larger: Quantity | None, what: str) -> None:
    """Refuse a dimension that does not fit into another; a missing other has its own fault."""
    if larger is not None and max(smaller.values) >= min(larger.values):
        raise ValueError(f"{max(smaller.values):g} must be smaller than {what} {min(larger.values):g}")


def _one_per(quantity: Quantity, count: int | None, items: str) -> None:
    """Refuse a list whose length is not the count of items; one number stands for all."""
    found = len(quantity.values)
    if count is not None and found not in (1, count):
        raise ValueError(f"{found} values for {count} {items}; give one value or {count}")


class LineGrid(Artefact):
    """Straight lines at one pitch in two directions: grid paper, millimetre paper, ruled glass.

    `lines` counts the vertical and the horizontal lines; leave it out where the picture shows a part.
    Every `heavy_every`-th line is heavier, `heavy_width_mm` wide.
    """

    kind: Literal["line-grid"] = "line-grid"
    pitch_mm: Positive
    line_width_mm: Positive | None = None
    polarity: Literal["dark", "light"] = "dark"
    lines: tuple[AtLeastTwo, AtLeastTwo] | None = None
    heavy_every: AtLeastTwo | None = None
    heavy_width_mm: Positive | None = None

    @field_validator("line_width_mm", "heavy_width_mm")
    @classmethod
    def _width_below_pitch(cls, width: Scalar | None, info: ValidationInfo) -> Scalar | None:
        if width is not None:
            _must_be_below(width, info.data.get("pitch_mm"), "pitch_mm")
        return width

    @field_validator("heavy_width_mm")
    @classmethod
    def _heavy_has_period(cls, width: Scalar | None, info: ValidationInfo) -> Scalar | None:
        if width is not None and "heavy_every" in info.data and info.data["heavy_every"] is None:
            raise ValueError("heavy_width_mm without heavy_every; state which lines are heavy, or leave both out")
        return width


class Chessboard(Artefact):
    """A chessboard, counted by its inner corners: 9 x 6 corners are 10 x 7 squares."""

    kind: Literal["chessboard"] = "chessboard"
    columns: AtLeastTwo
    rows: AtLeastTwo
    square_mm: Positive


class Charuco(Artefact):
    """A chessboard with ArUco markers in its white squares; `squares` counts columns and rows of squares."""

    kind: Literal["charuco"] = "charuco"
    squares: tuple[AtLeastTwo, AtLeastTwo]
    square_mm: Positive
    marker_mm: Positive
    dictionary: Text

    @field_validator("marker_mm")
    @classmethod
    def _marker_in_square(cls, marker: Scalar, info: ValidationInfo) -> Scalar:
        _must_be_below(marker, info.data.get("square_mm"), "square_mm")
        return marker

    @field_validator("dictionary")
    @classmethod
    def _dictionary_is_known(cls, dictionary: str, info: ValidationInfo) -> str:
        columns, rows = info.data.get("squares", (0, 0))
        check_dictionary(dictionary, columns * rows // 2)
        return dictionary


class Dots(Artefact):
    """Round dots, `columns` in each of `rows` rows.

    Symmetric: `pitch_mm` is the spacing both ways. Asymmetric, as OpenCV counts it: rows are one
    pitch apart, dots within a row two, and every second row is moved by one pitch.
    """

    kind: Literal["dots"] = "dots"
    columns: AtLeastTwo
    rows: AtLeastTwo
    pitch_mm: Positive
    asymmetric: bool = False
    diameter_mm: Positive

    @field_validator("diameter_mm")
    @classmethod
    def _dots_apart(cls, diameter: Scalar, info: ValidationInfo) -> Scalar:
        pitch = info.data.get("pitch_mm")
        nearest = math.sqrt(2) if info.data.get("asymmetric") else 1.0
        if pitch is not None and diameter.value >= nearest * pitch.value:
            raise ValueError(f"dots of {diameter.value:g} overlap at {nearest * pitch.value:g} between centres")
        return diameter


class Flat(Artefact):
    """A flat: the reference plate, or a plate whose top lies `height_mm` above it.

    `flatness_mm` is the largest distance of the surface from its best plane, 0 where only its
    uncertainty is known. Without a size the flat fills the picture.
    """

    kind: Literal["flat"] = "flat"
    flatness_mm: Scalar
    width_mm: Positive | None = None
    length_mm: Positive | None = None
    height_mm: Positive | None = None

    @field_validator("flatness_mm")
    @classmethod
    def _not_negative(cls, flatness: Scalar) -> Scalar:
        if flatness.value < 0:
            raise ValueError(f"flatness cannot be negative, found {flatness.value:g}")
        return flatness


_OF_STRIPS = ("paint_mm", "seating_mm", "depth_mm", "parallelism_mm")


class Strips(Artefact):
    """Parallel strips of known height on the plate, from low x to high x.

    Without `instrument_u_mm` the u of `height_mm` counts as common to the whole set; with it, as each strip's own. What
    is added to a strip's height after it was measured: `paint_mm`, common to all, and `seating_mm`, the gap under each
    strip, whose u is each strip's own. `depth_mm` is how far below its surface a translucent strip seems to be.
    `parallelism_mm` is the largest difference of height between the ends of a strip.
    """

    kind: Literal["strips"] = "strips"
    count: Count
    width_mm: Positives
    gap_mm: Positives | None = Field(default=None, validate_default=True)
    height_mm: Positives
    length_mm: Positives
    paint_mm: Scalar | None = None
    seating_mm: Scalar | None = None
    depth_mm: Scalar | None = None
    parallelism_mm: Scalar | None = None

    @field_validator("width_mm", "height_mm", "length_mm")
    @classmethod
    def _per_strip(cls, quantity: Quantity, info: ValidationInfo) -> Quantity:
        _one_per(quantity, info.data.get("count"), "strips")
        return quantity

    @model_serializer(mode="wrap")
    def _without_what_is_not_stated(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        optional = {*_OPTIONAL, *_OF_STRIPS}
        return {key: value for key, value in write(self).items() if key not in optional or value not in (None, 0.0)}

    @property
    def added_mm(self) -> float:
        """What a strip seems higher than its certificate says: paint and gap under it, less the depth of its light."""
        paint, gap, depth = (
            0.0 if one is None else one.value for one in (self.paint_mm, self.seating_mm, self.depth_mm)
        )
        return paint + gap - depth

    @property
    def added_u_mm(self) -> float:
        """Standard uncertainty of `added_mm`."""
        stated = (self.paint_mm, self.seating_mm, self.depth_mm)
        return math.hypot(*(one.us[0] for one in stated if one is not None))

    @field_validator("gap_mm")
    @classmethod
    def _between_strips(cls, gap: Quantity | None, info: ValidationInfo) -> Quantity | None:
        count = info.data.get("count", 1)
        if gap is None and count > 1:
            raise ValueError(f"is missing; {count} strips have {count - 1} gaps. {HOW_TO_STATE}")
        if gap is not None and count > 1:
            _one_per(gap, count - 1, "gaps")
        return gap


class Zigzag(Artefact):
    """Equal angle bars side by side, feet touching: two legs of `leg_mm` meet at `apex_deg` on each ridge."""

    kind: Literal["zigzag"] = "zigzag"
    count: Count
    leg_mm: Positive
    apex_deg: Positive
    length_mm: Positive
    ridge_radius_mm: Positive | None = None

    @field_validator("apex_deg")
    @classmethod
    def _apex_below_flat(cls, apex: Scalar) -> Scalar:
        if apex.value >= 180:
            raise ValueError(f"the angle between the legs must be below 180, found {apex.value:g}")
        return apex

    @field_validator("ridge_radius_mm")
    @classmethod
    def _radius_leaves_flanks(cls, radius: Scalar | None, info: ValidationInfo) -> Scalar | None:
        leg, apex = info.data.get("leg_mm"), info.data.get("apex_deg")
        if radius is None or leg is None or apex is None:
            return radius
        largest_mm = leg.value * math.tan(math.radians(apex.value) / 2)
        if radius.value >= largest_mm:
            raise ValueError(f"a radius of {radius.value:g} leaves no flank; it must be below {largest_mm:.4g}")
        return radius


class Steps(Artefact):
    """A block of adjoining steps from low x to high x, each `width_mm` wide, heights from the plate."""

    kind: Literal["steps"] = "steps"
    heights_mm: Positives
    width_mm: Positives
    length_mm: Positive

    @field_validator("width_mm")
    @classmethod
    def _per_step(cls, width: Quantity, info: ValidationInfo) -> Quantity:
        heights = info.data.get("heights_mm")
        _one_per(width, len(heights.values) if heights is not None else None, "steps")
        return width


class Wedge(Artefact):
    """A wedge that rises along x from the plate at `angle_deg` over `width_mm`."""

    kind: Literal["wedge"] = "wedge"
    angle_deg: Positive
    width_mm: Positive
    length_mm: Positive

    @field_validator("angle_deg")
    @classmethod
    def _below_upright(cls, angle: Scalar) -> Scalar:
        if angle.value >= 90:
            raise ValueError(f"the slope must be below 90, found {angle.value:g}")
        return angle


class Box(Artefact):
    """A rectangular block on the plate."""

    kind: Literal["box"] = "box"
    width_mm: Positive
    length_mm: Positive
    height_mm: Positive


class Sphere(Artefact):
    """A sphere that touches the plate."""

    kind: Literal["sphere"] = "sphere"
    diameter_mm: Positive


class BallBar(Artefact):
    """Two spheres that touch the plate, side by side in x, with `spacing_mm` between their centres."""

    kind: Literal["ball-bar"] = "ball-bar"
    diameters_mm: Positives
    spacing_mm: Positive

    @field_validator("diameters_mm")
    @classmethod
    def _two_balls(cls, diameters: Quantity) -> Quantity:
        _one_per(diameters, 2, "balls")
        return diameters

    @field_validator("spacing_mm")
    @classmethod
    def _balls_apart(cls, spacing: Scalar, info: ValidationInfo) -> Scalar:
        diameters = info.data.get("diameters_mm")
        if diameters is None:
            return spacing
        sum_of_radii = float(diameters.array(2).mean())
        if spacing.value < sum_of_radii:
            raise ValueError(f"balls overlap: {spacing.value:g} between centres, radii sum to {sum_of_radii:g}")
        return spacing


Target = Annotated[
    LineGrid | Chessboard | Charuco | Dots | Flat | Strips | Zigzag | Steps | Wedge | Box | Sphere | BallBar,
    Field(discriminator="kind"),
]

KINDS: dict[str, type[Artefact]] = {
    kind.model_fields["kind"].default: kind
    for kind in (
        LineGrid,
        Chessboard,
        Charuco,
        Dots,
        Flat,
        Strips,
        Zigzag,
        Steps,
        Wedge,
        Box,
        Sphere,
        BallBar,
    )
}
