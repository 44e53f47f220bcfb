"""Draw the pictures of the procedures: `python docs/draw_procedures.py`. Virtual rigs and closed forms, seeded."""

import io
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Arc
from PIL import Image

from fringecal.report.style import AMBER, BLUE, GREEN, GREY, INK, ORANGE, styled
from fringecal.simulate import RigSpec, load_rig
from fringecal.simulate.rig.rig_spec import CaptureSpec
from fringecal.simulate.sessions import take

OUT = Path(__file__).parents[1] / "procedures" / "pictures"
IMAGES = Path(__file__).parent / "images"
SMALL = {"width_px": 360, "height_px": 280, "scale_mm_per_px": 1.2}
COLOURS = 64  # of a picture in the repository: few enough for a small file
SMALL_SHEET = {
    "format": 1,
    "kind": "line-grid",
    "name": "a small sheet",
    "certificate": "drawn",
    "polarity": "dark",
    "pitch_mm": {"value": 10.0, "u": 0.006},
    "line_width_mm": {"value": 0.9, "u": 0.1},
    "lines": [20, 16],
}
DPI, GAP_PX, TITLE_PX = 80, 8, 24


def small(**sections: object) -> RigSpec:
    """The thesis's rig with a small picture, and some sections changed."""
    camera = SMALL | dict(sections.pop("camera", {}))
    return load_rig("thesis").at(camera=camera, **sections)


def frame(rig: RigSpec, name: str, **changes: object) -> np.ndarray:
    """First frame of one of the rig's captures, some of its keys changed."""
    capture = CaptureSpec.model_validate(rig.capture_named(name).model_dump() | changes)
    return take(rig, capture, seed=1).frames[0]


def pictures(*shown: tuple[str, np.ndarray, bool], columns: int = 2) -> Figure:
    """Pictures in rows, pixel by pixel, each with its title and whether it is good."""
    height, width = shown[0][1].shape
    rows = -(-len(shown) // columns)
    across, down = columns * (width + GAP_PX) + GAP_PX, rows * (height + TITLE_PX + GAP_PX)
    figure = Figure(figsize=(across / DPI, down / DPI))
    for place, (title, grey, good) in enumerate(shown):
        row, column = divmod(place, columns)
        left, top = GAP_PX + column * (width + GAP_PX), TITLE_PX + row * (height + TITLE_PX + GAP_PX)
        # Not drawn by matplotlib's axes of any other size: lines and fringes would beat with the pixels.
        axes = figure.add_axes((left / across, 1 - (top + height) / down, width / across, height / down))
        axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="none")
        colour = GREEN if good else ORANGE
        axes.set_title(f"{'good' if good else 'bad'}: {title}", color=colour, fontweight="bold", fontsize=10)
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set(visible=True, color=colour, linewidth=2)
    return figure


@styled
def scale_and_distortion() -> Figure:
    rig = small()
    bent = small(camera={"distortion": (-2.5, 0.0, 0.0, 0.0, 0.0)})
    sheet = frame(rig, "grid")
    v, u = np.indices(sheet.shape)
    glare = 255 * np.exp(-((u - 250) ** 2 + (v - 90) ** 2) / 60**2)
    return pictures(
        ("lines to the edge, sharp and evenly lit", sheet, True),
        ("bent by the lens, which the camera model takes out", frame(bent, "grid"), True),
        ("glare hides the lines", np.minimum(sheet + glare, 255), False),
        ("the sheet leaves half of the picture free", frame(rig, "grid", target=SMALL_SHEET), False),
    )


@styled
def commissioning() -> Figure:
    rig = small()
    bright = small(light=rig.light.model_dump() | {"mid_grey": 0.85})
    return pictures(
        ("1 grid, by room light", frame(rig, "grid"), True),
        ("2 bare plate, evenly lit fringes", frame(rig, "reference"), True),
        ("3 strips: fringes break at them", frame(rig, "strips"), True),
        ("fringes touch white", frame(bright, "strips"), False),
    )


@styled
def projection_angle() -> Figure:
    rig = small(projector={"pitch_mm": 16.0})
    fine = small(projector={"pitch_mm": 5.0})
    lit = rig.at(light=rig.light.model_dump() | {"mid_grey": 0.6, "ambient": 6.0})
    return pictures(
        ("strips across the fringes", frame(rig, "strips"), True),
        ("strips along the fringes", frame(rig, "strips", direction="rows"), False),
        ("fringes below 6 px", frame(fine, "strips"), False),
        ("room light: weak fringes", frame(lit, "strips"), False),
    )


@styled
def verification_on_angle_bars() -> Figure:
    rig = small()
    dim = rig.at(light=rig.light.model_dump() | {"mid_grey": 0.14, "ambient": 0.03})
    return pictures(
        ("ridges from top to bottom, towards the lamp", frame(rig, "bars"), True),
        ("ridges across the light: far flanks in shadow", frame(dim, "bars", direction="rows"), False),
    )


@styled
def measuring_an_object() -> Figure:
    rig = small()
    dark = rig.at(light=rig.light.model_dump() | {"mid_grey": 0.05})
    return pictures(
        ("plate all around, fringes run on", frame(rig, "leaf"), True),
        ("too dark: noise hides the fringes", frame(dark, "leaf"), False),
    )


@styled
def periodic_audit() -> Figure:
    """What a move of each part leaves behind in the plate's phase, by the virtual rig's own light."""
    rig = small()
    still = take(rig, rig.capture_named("reference"), seed=1).phase
    lower = 1480.0
    moves = {
        "camera 20 mm lower": rig.at(
            camera={"height_mm": lower, "scale_mm_per_px": SMALL["scale_mm_per_px"] * lower / rig.camera.height_mm}
        ),
        "lamp 20 mm to the side": rig.at(projector={"position_mm": (20.0, 1222.0, 1000.0)}),
        "lamp 20 mm higher": rig.at(projector={"position_mm": (0.0, 1222.0, 1020.0)}),
        "slide's pitch 0.5 % larger": rig.at(projector={"pitch_mm": 8.04}),
    }
    figure = Figure(figsize=(9.4, 6.6), layout="constrained")
    for place, (title, after) in enumerate(moves.items(), start=1):
        change = take(after, after.capture_named("reference"), seed=1).phase - still
        change -= change[change.shape[0] // 2, change.shape[1] // 2]
        axes = figure.add_subplot(2, 2, place)
        largest = float(np.abs(change).max())
        image = axes.imshow(change, cmap="RdBu_r", vmin=-largest, vmax=largest)
        bar = figure.colorbar(image, ax=axes)
        bar.set_label("change of phase / rad")
        axes.set_title(title)
        axes.set_xticks([])
        axes.set_yticks([])
    return figure


@styled
def choosing_pitch_and_angle() -> Figure:
    """u(z) = p u(phi) / (2 pi tan a) with a blurred modulation, and the share of one degree of the angle."""
    figure = Figure(figsize=(9.4, 3.4), layout="constrained")
    noise, angle = figure.subplots(1, 2)
    pitch_px = np.linspace(3, 40, 300)
    scale_mm, modulation, sigma, blur_px = 0.734, 90.0, 1.0, 1.0
    for degrees, colour in ((30, AMBER), (45, BLUE), (60, GREEN)):
        contrast = np.exp(-2 * (np.pi * blur_px / pitch_px) ** 2)
        u_phi = np.sqrt(2 / 3) * sigma / (modulation * contrast)
        u_um = 1000 * pitch_px * scale_mm * u_phi / (2 * np.pi * np.tan(np.radians(degrees)))
        noise.plot(pitch_px, u_um, color=colour, label=f"{degrees} deg")
    noise.axvline(6, color=GREY, linestyle=":")
    noise.text(6.4, 2, "6 px", color=INK)
    noise.set(ylim=(0, 60), xlabel="pitch / px", ylabel="noise of height u(z) / µm", title="noise, blur of 1 px")
    noise.legend(title="angle")
    degrees = np.linspace(15, 75, 300)
    angle.plot(degrees, 100 * np.radians(1) * 2 / np.sin(2 * np.radians(degrees)), color=BLUE)
    angle.set(xlabel="projection angle / deg", ylabel="height per degree of angle / %", title="error of one degree")
    angle.set_ylim(0, None)
    return figure


@styled
def when_a_check_fails() -> Figure:
    """Errors of three-step phase: exact for one darker frame, a wrong step, and gamma."""
    phi = np.linspace(0, 4 * np.pi, 1200)
    steps = np.radians([0.0, 120.0, 240.0])

    def error(frames: np.ndarray) -> np.ndarray:
        found = np.arctan2(-np.sin(steps) @ frames, np.cos(steps) @ frames)
        return np.degrees(np.angle(np.exp(1j * (found - phi))))

    ideal = 130 + 100 * np.cos(phi + steps[:, None])
    darker = ideal * np.array([[1.0], [0.97], [1.0]])
    uneven = 130 + 100 * np.cos(phi + (steps * 123 / 120)[:, None])
    gamma = (ideal / 255) ** 1.2
    figure = Figure(figsize=(9.4, 2.9), layout="constrained")
    shown = (
        ("one frame 3 % darker: once", darker),
        ("steps of 123 deg: twice", uneven),
        ("gamma 1.2: three times", gamma),
    )
    for axes, (title, frames) in zip(figure.subplots(1, 3, sharey=True), shown, strict=True):
        ripple = error(frames)
        axes.plot(phi / (2 * np.pi), ripple - ripple.mean(), color=ORANGE)
        axes.axhline(0, color=GREY, linewidth=0.8)
        axes.set(title=title, xlabel="fringes")
    figure.axes[0].set_ylabel("phase error / deg")
    return figure


@styled
def plate_frame() -> Figure:
    """The plate frame in the picture and from the side, with what a session states of camera and projector."""
    figure = Figure(figsize=(9.4, 4.2), layout="constrained")
    seen, side = figure.subplots(1, 2, width_ratios=(1, 1.15))
    for y in np.arange(-160, 161, 16):
        seen.axhspan(y, y + 8, color=GREY, alpha=0.25, linewidth=0)
    arrow = {"arrowstyle": "-|>", "color": BLUE, "linewidth": 1.5}
    for tip, name in (((110, 0), "x, as u"), ((0, 110), "y, against v")):
        seen.annotate("", xy=tip, xytext=(0, 0), arrowprops=arrow)
        seen.text(tip[0] + 4, tip[1] + 8, name, color=BLUE)
    seen.plot(0, 0, "o", color=BLUE)
    seen.text(6, -22, "origin: what the middle\nof the picture sees", color=INK, va="top")
    seen.text(-215, 132, "pixel (0, 0)", color=INK)
    seen.set(xlim=(-220, 220), ylim=(-160, 160), title="the picture, and the plate in it", xticks=[], yticks=[])
    seen.set_aspect("equal")
    camera, lamp = (0, 1500), (1222, 1000)
    side.axhline(0, color=INK, linewidth=3)
    side.text(-440, -110, "plate, z = 0", color=INK)
    for place, name in ((camera, "camera: height_mm,\nentrance pupil"), (lamp, "projector:\nposition_mm")):
        side.plot([0, place[0]], [0, place[1]], color=ORANGE if place is lamp else GREEN)
        side.plot(*place, "s", color=INK)
        side.text(place[0] + 40, place[1] + 40, name, color=INK)
    side.plot([lamp[0], lamp[0]], [0, lamp[1]], color=GREY, linestyle=":")
    side.text(lamp[0] + 30, 480, "z = 1000 mm", color=INK)
    side.plot([0, lamp[0]], [-40, -40], color=GREY, linestyle=":")
    side.text(500, -110, "y = 1222 mm", color=INK)
    side.add_patch(Arc((0, 0), 900, 900, theta1=np.degrees(np.arctan2(lamp[1], lamp[0])), theta2=90, color=BLUE))
    side.text(40, 560, "projection\nangle 50.7 deg", color=BLUE)
    side.set(xlim=(-460, 1700), ylim=(-160, 1750), title="from the side (x toward the reader)", xticks=[], yticks=[])
    side.set_aspect("equal")
    for axes in (seen, side):
        axes.spines[:].set_visible(axes is seen)
    return figure


def reduced(picture: Image.Image) -> Image.Image:
    """Few colours; a picture that is nearly all grey keeps true greys, beside the two colours of the frames."""
    rgb = np.asarray(picture, dtype=int)
    if np.mean(np.ptp(rgb, axis=-1) < 8) < 0.9 or np.mean(rgb.min(axis=-1) > 250) > 0.5:
        return picture.quantize(COLOURS, dither=Image.Dither.NONE)
    shares = np.linspace(0, 1, 8)[:, None]
    tints = [255 + shares * (255 * np.array(to_rgb(colour)) - 255) for colour in (GREEN, ORANGE)]
    greys = np.repeat(np.linspace(0, 255, 24)[:, None], 3, axis=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(np.vstack([greys, *tints])).astype(np.uint8).tobytes())
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


def main() -> None:
    OUT.mkdir(exist_ok=True)
    for draw in (
        scale_and_distortion, commissioning, projection_angle, verification_on_angle_bars, measuring_an_object,
        periodic_audit, choosing_pitch_and_angle, when_a_check_fails, plate_frame,
    ):  # fmt: skip
        stream = io.BytesIO()
        draw().savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
        picture = reduced(Image.open(stream).convert("RGB"))
        place = IMAGES if draw is plate_frame else OUT
        picture.save(place / f"{draw.__name__.replace('_', '-')}.png", optimize=True)


if __name__ == "__main__":
    main()
