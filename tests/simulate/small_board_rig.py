"""The shipped rig for boards with small pictures, few poses and few frames."""

from fringecal.session.toml_text import to_toml
from fringecal.simulate import load_raster_rig

POSES = ["pose-01", "pose-02", "pose-05", "pose-06", "pose-11", "pose-13"]
SURFACES = ["plate", "block"]
TARGET = {
    "format": 1, "kind": "chessboard", "name": "board", "certificate": "virtual", "columns": 7, "rows": 5,
    "square_mm": {"value": 22.0, "u": 0.002},
}  # fmt: skip


def small_board_rig(surfaces=SURFACES):
    rig = load_raster_rig("dlp-small").at(
        camera={"width_px": 200, "height_px": 160, "focal_px": 380.0, "principal_offset_px": (1.0, -0.6)},
        projector={"columns": 320, "rows": 180, "focal_px": 480.0, "centre_px": (161.0, 93.0)},
        fringes={"fringes": (1.0, 14.0)},
        noise={"read_levels": 0.7},
    )
    poses = [
        rig.capture_named(name).model_copy(update={"target": TARGET, "sheet_mm": (200.0, 150.0)}) for name in POSES
    ]
    others = [rig.capture_named(name).model_copy(update={"position_mm": (0.0, 0.0, 600.0)}) for name in surfaces]
    return rig.model_copy(update={"capture": (*poses, *others)})


def rig_file(rig) -> str:
    """Give the rig as a file that `fringecal simulate` takes."""
    return to_toml({"format": 1, "kind": "raster", **rig.model_dump(mode="json", exclude_none=True)})
