"""The camera as a `.cameramodel` file, which mrcal and its tools read."""

from pathlib import Path

from scipy.spatial.transform import Rotation

from fringecal.camera.plate import PlateCamera
from fringecal.errors import RecordError
from fringecal.records.files import write_text

CAMERAMODEL_FILE = "camera.cameramodel"


def cameramodel_text(camera: PlateCamera) -> str:
    """Return a pinhole camera on the plate as the text of a `.cameramodel` (LENSMODEL_OPENCV5).

    The reference frame is the plate frame in mm; `extrinsics` map it to the camera's frame (Rodrigues
    rotation, translation), as mrcal has it.

    Raises
    ------
    RecordError
        A telecentric camera: the format has no model for parallel rays.
    """
    if camera.telecentric:
        raise RecordError("a telecentric camera cannot be written as a .cameramodel: the format knows pinholes only")
    u0, v0 = camera.centre_px
    focal = camera.focal_px
    lens = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    intrinsics = [focal, focal / camera["aspect"], u0 + camera["cu_px"], v0 + camera["cv_px"], *lens]
    turn = Rotation.from_matrix(camera.rotation).as_rotvec()
    shift = -camera.rotation @ camera.position_mm
    return (
        "# Written by fringecal. Reference frame: the plate, mm, z toward the camera.\n"
        "{\n"
        "    'lensmodel':  'LENSMODEL_OPENCV5',\n"
        f"    'intrinsics': [ {_numbers(intrinsics)} ],\n"
        f"    'extrinsics': [ {_numbers([*turn, *shift])} ],\n"
        f"    'imagersize': [ {camera.width_px}, {camera.height_px} ]\n"
        "}\n"
    )


def write_cameramodel(path: str | Path, camera: PlateCamera) -> Path:
    """Write a camera as a `.cameramodel`, whole or not at all."""
    return write_text(path, cameramodel_text(camera))


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.12g}" for value in values)
