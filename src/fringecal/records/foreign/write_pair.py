"""A camera and a projector written as other programs read them, each file whole or not at all."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.projector import StatedPair
from fringecal.records.exports.cameramodel import model_text
from fringecal.records.files import write_bytes, write_text
from fringecal.records.foreign.bouguet import bouguet_entries
from fringecal.records.foreign.named_values import MM_PER_M

Array = NDArray[np.float64]

_IN_CAMERA = "Reference frame: the camera's, mm, x right, y down, z forward."
_MATLAB_TEXT = 116  # bytes of a MATLAB file's first words


def write_pair(folder: str | Path, pair: StatedPair) -> tuple[Path, ...]:
    """Write a pair in every format that others read.

    `camera.cameramodel` and `projector.cameramodel` (mrcal, the camera as reference frame, mm), `stereo.yml` (OpenCV),
    `slstudio.xml`, `caliInfo.yml` (SLMaster), `Calib_Results_stereo.mat` (Bouguet), and `camera.yaml` with
    `projector.yaml` (ROS, metres, rectified).

    Parameters
    ----------
    folder, pair
        Where, and what.
    """
    folder = Path(folder)
    camera, projector = camera_info_texts(pair)
    return (
        write_text(folder / "camera.cameramodel", device_text(pair, "camera")),
        write_text(folder / "projector.cameramodel", device_text(pair, "projector")),
        write_text(folder / "stereo.yml", stereo_text(pair)),
        write_text(folder / "slstudio.xml", slstudio_text(pair)),
        write_text(folder / "caliInfo.yml", slmaster_text(pair)),
        write_bytes(folder / "Calib_Results_stereo.mat", bouguet_bytes(pair)),
        write_text(folder / "camera.yaml", camera),
        write_text(folder / "projector.yaml", projector),
    )


def device_text(pair: StatedPair, who: str) -> str:
    """Return camera or projector as the text of a `.cameramodel`, with pose, valid region and covariance."""
    lens = pair.camera if who == "camera" else pair.projector
    turn = Rotation.from_matrix(pair.rotation).as_rotvec()
    pose = np.zeros(6) if who == "camera" else np.concatenate([turn, pair.shift_mm])
    return model_text(lens, pose, _IN_CAMERA, region=pair.valid_px.get(who))


def stereo_text(pair: StatedPair) -> str:
    """Return OpenCV's YAML, by the names of its own sample of stereo calibration."""
    (m1, d1), (m2, d2) = _matrices(pair.camera), _matrices(pair.projector)
    named = {"camera_matrix1": m1, "distortion_coefficients1": d1, "camera_matrix2": m2, "distortion_coefficients2": d2}
    sizes = {
        "image_width": pair.camera.width_px,
        "image_height": pair.camera.height_px,
        "projector_width": pair.projector.width_px,
        "projector_height": pair.projector.height_px,
    }
    return _yaml(named | {"R": pair.rotation, "T": pair.shift_mm[:, None]}, sizes)


def slmaster_text(pair: StatedPair) -> str:
    """Return SLMaster's `caliInfo.yml` of a camera and a projector."""
    (m1, d1), (m4, d4) = _matrices(pair.camera), _matrices(pair.projector)
    size = np.array([[pair.camera.width_px], [pair.camera.height_px]], dtype=float)
    named = {"M1": m1, "D1": d1, "S": size, "M4": m4, "D4": d4, "Rlp": pair.rotation, "Tlp": pair.shift_mm[:, None]}
    return _yaml(named, {})


def slstudio_text(pair: StatedPair) -> str:
    """Return SLStudio's XML; reprojection errors that are not known are written as 0, as SLStudio itself does."""
    (kc, dc), (kp, dp) = _matrices(pair.camera), _matrices(pair.projector)
    named = {"Kc": kc, "kc": dc.T, "Kp": kp, "kp": dp.T, "Rp": pair.rotation, "Tp": pair.shift_mm[:, None]}
    values = {f"{short}_error": pair.errors_px.get(who, 0.0) for short, who in _SLSTUDIO_ERRORS}
    sizes = {
        "frameWidth": pair.camera.width_px,
        "frameHeight": pair.camera.height_px,
        "screenResX": pair.projector.width_px,
        "screenResY": pair.projector.height_px,
    }
    matrices = "".join(
        f'<{name} type_id="opencv-matrix">\n  <rows>{matrix.shape[0]}</rows>\n  <cols>{matrix.shape[1]}</cols>\n'
        f"  <dt>d</dt>\n  <data>\n    {_numbers(matrix, ' ')}</data></{name}>\n"
        for name, matrix in named.items()
    )
    rest = "".join(f"<{name}>{value:.17g}</{name}>\n" for name, value in (values | sizes).items())
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{matrices}{rest}</opencv_storage>\n'


_SLSTUDIO_ERRORS = (("cam", "camera"), ("proj", "projector"), ("stereo", "pair"))


def bouguet_bytes(pair: StatedPair) -> bytes:
    """Return `Calib_Results_stereo.mat`, camera left and projector right, for MATLAB's level 5."""
    stream = io.BytesIO()
    savemat(stream, bouguet_entries(pair))
    # The file's first words hold the time of writing and the system: neither belongs in a result.
    return b"MATLAB 5.0 MAT-file, written by fringecal".ljust(_MATLAB_TEXT) + stream.getvalue()[_MATLAB_TEXT:]


def camera_info_texts(pair: StatedPair) -> tuple[str, str]:
    """Return ROS's camera_info of both devices: rectified so that the projector is shifted along x, in metres."""
    turns = _rectifying(pair)
    focal = float(pair.camera["fy_px"])
    texts = []
    for lens, turn, shift, name in (
        (pair.camera, turns[0], 0.0, "camera"),
        (pair.projector, turns[1], float((turns[1] @ pair.shift_mm)[0]) / MM_PER_M, "projector"),
    ):
        centre_x, centre_y = (lens.width_px - 1) / 2, (lens.height_px - 1) / 2
        projection = np.array([[focal, 0, centre_x, focal * shift], [0, focal, centre_y, 0], [0, 0, 1, 0]])
        texts.append(_camera_info(lens, name, turn, projection))
    return texts[0], texts[1]


def _rectifying(pair: StatedPair) -> tuple[Array, Array]:
    """Turns of both frames into one whose x axis runs along the line between the centres."""
    # The projector's centre lies at -R'T in the camera's frame, and x grows so that its shift keeps its sign.
    along = pair.rotation.T @ pair.shift_mm
    x = along / np.linalg.norm(along)
    x = x if x[0] >= 0 else -x
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    turn = np.stack([x, y, np.cross(x, y)])
    return turn, turn @ pair.rotation.T


def _camera_info(lens: Lens, name: str, turn: Array, projection: Array) -> str:
    matrix, terms = _matrices(lens)
    blocks: dict[str, Array | str] = {
        "camera_matrix": matrix,
        "distortion_model": "plumb_bob",
        "distortion_coefficients": terms.T,
        "rectification_matrix": turn,
        "projection_matrix": projection,
    }
    lines = [f"image_width: {lens.width_px}", f"image_height: {lens.height_px}", f"camera_name: {name}"]
    for key, value in blocks.items():
        if isinstance(value, str):
            lines.append(f"{key}: {value}")
            continue
        rows, columns = value.shape
        lines += [f"{key}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{_numbers(value, ', ')}]"]
    return "\n".join(lines) + "\n"


def _matrices(lens: Lens) -> tuple[Array, Array]:
    fx, fy, cx, cy, *terms = lens.values
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array([terms]).T


def _yaml(matrices: dict[str, Array], values: dict[str, int]) -> str:
    parts = [f"{name}: {value}\n" for name, value in values.items()]
    parts += [
        f"{name}: !!opencv-matrix\n   rows: {matrix.shape[0]}\n   cols: {matrix.shape[1]}\n   dt: d\n"
        f"   data: [ {_numbers(matrix, ', ')} ]\n"
        for name, matrix in matrices.items()
    ]
    return "%YAML:1.0\n---\n" + "".join(parts)


def _numbers(matrix: Array, between: str) -> str:
    return between.join(f"{value:.17g}" for value in np.ravel(matrix))
