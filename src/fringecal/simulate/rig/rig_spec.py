"""What a virtual rig is: one document with a camera, a projector, its steps, its light and its noise."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from fringecal.errors import FringecalError
from fringecal.guarded import first_few, quoted, shortened

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
Tilt = Annotated[float, Field(gt=-45, lt=45)]
Point = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Power = Annotated[int, Field(ge=0, le=3)]
Pair = tuple[FiniteFloat, FiniteFloat]

# Where neither the rig nor the command says when: one moment, so that the same seed gives the same bytes.
CAPTURED = datetime(2008, 1, 1, 12, tzinfo=UTC)
CAPTURE_KINDS = Literal["grid", "board", "reference", "strips", "artefact", "object"]


class Part(BaseModel):
    """A part of a rig document: frozen, and nothing in it is unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class CameraSpec(Part):
    """The camera: a pinhole or a telecentric lens above the plate.

    `tilt_deg` is where the camera stands as seen from the plate's origin, in degrees off the normal
    toward +x and toward +y; its optical axis looks back. `scale_mm_per_px` is the mean of the
    scales along u and v at the image centre, from which the focal length follows. `distortion` is
    Brown's k1, k2, p1, p2, k3 in OpenCV's normalised coordinates (a telecentric lens has none of
    these: there the half diagonal of the picture is 1). `gamma` is that of the sensor's response.
    """

    kind: Literal["pinhole", "telecentric"] = "pinhole"
    width_px: Annotated[int, Field(ge=8, le=20000)] = 640
    height_px: Annotated[int, Field(ge=8, le=20000)] = 600
    bits: Annotated[int, Field(ge=8, le=16)] = 8
    scale_mm_per_px: Positive
    height_mm: Positive
    tilt_deg: tuple[Tilt, Tilt] = (0.0, 0.0)
    principal_offset_px: Pair = (0.0, 0.0)
    distortion: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = (0.0,) * 5
    vignetting: Fraction = 0.0
    defocus_px: NotNegative = 0.0
    gamma: Positive = 1.0

    @property
    def white_level(self) -> int:
        """Largest grey level of the sensor."""
        return (1 << self.bits) - 1


class ProjectorSpec(Part):
    """The projector: a pinhole with one slide.

    Its axis goes from `position_mm` to the plate point `aim_mm`. The slide is turned so that phase
    rises toward `across_deg` on the plate at the origin (from +x toward +y) and ruled so that the
    period there, across the fringes, is `pitch_mm`. `distortion` holds k1, k2: the ray with tangents
    (p, q) to the axis comes from the slide point (p, q) (1 + k1 r^2 + k2 r^4), as a camera's would
    arrive there. `gamma` bends the slide's transmission; `defocus_mm` is the standard deviation of
    its Gaussian blur on the plate at the origin.
    """

    position_mm: Point
    aim_mm: Pair = (0.0, 0.0)
    across_deg: FiniteFloat = 90.0
    pitch_mm: Positive
    phase_at_origin_rad: FiniteFloat = 0.0
    profile: Literal["sinusoidal", "square"] = "sinusoidal"
    contrast: Annotated[float, Field(ge=0, le=1)] = 0.9
    gamma: Positive = 1.0
    distortion: Pair = (0.0, 0.0)
    defocus_mm: NotNegative = 0.0

    @model_validator(mode="after")
    def _above_the_plate(self) -> Self:
        if self.position_mm[2] <= 0:
            raise ValueError(f"position_mm: z = {self.position_mm[2]:g}; the projector must stand above the plate")
        return self


class StepsSpec(Part):
    """Phase shifts: what the session states, and what the mirror truly did.

    True step of frame n at pixel (u, v), in degrees: nominal + error + tilt_u (u - uc) / width
    + tilt_v (v - vc) / height: a mirror turned by hand moves near and far fringes by different amounts.
    """

    nominal_deg: tuple[FiniteFloat, ...] = (0.0, 120.0, 240.0)
    error_deg: tuple[FiniteFloat, ...] = ()
    tilt_deg: tuple[Pair, ...] = ()

    @model_validator(mode="after")
    def _one_per_frame(self) -> Self:
        for name in ("error_deg", "tilt_deg"):
            found = len(getattr(self, name))
            if found not in (0, len(self.nominal_deg)):
                raise ValueError(
                    f"{name}: {found} values for {len(self.nominal_deg)} phase shifts; give none or one each"
                )
        return self


class LightSpec(Part):
    """Light on the plate and exposure.

    `mid_grey` is the share of the white level at which the plate is seen at the origin in the middle
    of a fringe, ambient light included; `ambient` is ambient over projected light there. `shading`
    turns Lambert's cosine and the inverse square on. `room_grey` and `room_gradient` (relative change
    over the field along u and v) hold for pictures taken by room light; `flicker` is the lamp's
    relative standard deviation from frame to frame.
    """

    mid_grey: Annotated[float, Field(gt=0, le=1)] = 0.45
    ambient: NotNegative = 0.05
    shading: bool = True
    room_grey: Annotated[float, Field(gt=0, le=1)] = 0.8
    room_gradient: Pair = (0.0, 0.0)
    flicker: NotNegative = 0.0


class NoiseSpec(Part):
    """Sensor noise in grey levels: variance = read^2 + gain * grey level."""

    read_levels: NotNegative = 1.0
    gain: NotNegative = 0.0


class SurfaceSpec(Part):
    """Unevenness of the painted surfaces: relative standard deviations of a smooth and of a fine texture."""

    seed: Annotated[int, Field(ge=0)] = 2008
    smooth: Fraction = 0.0
    smooth_mm: Positive = 40.0
    speckle: Fraction = 0.0
    speckle_mm: Positive = 0.5


class PlateSpec(Part):
    """A reference plate that is not flat.

    `form` lists terms (power of x, power of y, mm): the plate's height over z = 0 is the sum of mm (x / unit)^i
    (y / unit)^j, powers up to 3. The sheets and solids that lie on it follow it.
    """

    form: tuple[tuple[Power, Power, FiniteFloat], ...] = ()
    unit_mm: Positive = 100.0


class StatedSpec(Part):
    """Standard uncertainties with which a session states what was measured by hand beforehand.

    With `artefact_seed` the true sizes of all artefacts are drawn about the stated ones, each within its own u; without
    it they are as stated. The session's seed does not change them: an audit finds the same strips again.
    """

    camera_height_u_mm: NotNegative = 5.0
    projector_position_u_mm: NotNegative = 3.0
    artefact_seed: Annotated[int, Field(ge=0)] | None = None


class CaptureSpec(Part):
    """One capture of a session: what lies on the plate, where, and how it is turned.

    `direction` says along what ridges or strips run: the columns of the picture (along y) or its rows;
    `rotation_deg` is added to it. `object` without a target is the pleated leaf. `dirt` counts dark
    specks of 0.2 to 1 mm radius on a printed sheet. `repeat` takes the whole set so often, each time with
    noise and flicker of its own.
    """

    name: str
    kind: CAPTURE_KINDS
    target: str | dict[str, Any] | None = None
    use: Literal["calibration", "verification"] | None = None
    position_mm: Pair = (0.0, 0.0)
    direction: Literal["columns", "rows"] = "columns"
    rotation_deg: FiniteFloat = 0.0
    dirt: Annotated[int, Field(ge=0)] = 0
    repeat: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _only_sets_are_repeated(self) -> "CaptureSpec":
        if self.repeat > 1 and self.kind in ("grid", "board"):
            raise ValueError(f"repeat = {self.repeat}: a capture of kind {self.kind!r} is one picture")
        return self


class RigSpec(Part):
    """A virtual rig, as one TOML document states it."""

    format: Literal[1] = 1
    name: str
    about: str = ""
    captured: AwareDatetime = CAPTURED
    camera: CameraSpec
    projector: ProjectorSpec
    steps: StepsSpec = StepsSpec()
    light: LightSpec = LightSpec()
    noise: NoiseSpec = NoiseSpec()
    surface: SurfaceSpec = SurfaceSpec()
    plate: PlateSpec = PlateSpec()
    stated: StatedSpec = StatedSpec()
    capture: tuple[CaptureSpec, ...] = ()

    def at(self, **sections: Mapping[str, Any] | str) -> "RigSpec":
        """Return a copy with some values changed, checked again.

        Parameters
        ----------
        sections
            One mapping of changed values per section, or a text for `name` and `about`.

        Examples
        --------
        >>> rig = RigSpec(
        ...     name="r",
        ...     camera={"scale_mm_per_px": 0.5, "height_mm": 1000.0},
        ...     projector={"position_mm": (0.0, 900.0, 900.0), "pitch_mm": 8.0},
        ... )
        >>> rig.at(projector={"pitch_mm": 7.0}).projector.pitch_mm
        7.0
        """
        document = self.model_dump()
        for section, changes in sections.items():
            old = document.get(section)
            both = isinstance(old, dict) and isinstance(changes, Mapping)
            document[section] = {**old, **changes} if both else changes  # type: ignore[dict-item]
        return rig_from(document, "changed rig")

    def capture_named(self, name: str) -> CaptureSpec:
        """Find one of the rig's captures by name."""
        for capture in self.capture:
            if capture.name == name:
                return capture
        known = ", ".join(capture.name for capture in self.capture) or "none"
        raise FringecalError(f"rig {self.name}: no capture {name!r}; it has {known}")


def rig_from(document: Mapping[str, Any], where: str) -> RigSpec:
    """Check a rig document and list all of its faults at once."""
    return checked(RigSpec, document, where)


def checked[Spec: BaseModel](kind: type[Spec], document: Mapping[str, Any], where: str) -> Spec:
    """Check a document against its kind of rig and list all of its faults at once."""
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        faults = [
            f"{shortened('.'.join(map(str, e['loc'])))}: {shortened(e['msg'])} (found {quoted(e['input'])})"
            for e in error.errors()
        ]
        raise FringecalError(f"{where} cannot be used:\n  " + "\n  ".join(first_few(faults))) from None
