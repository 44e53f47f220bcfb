"""A camera and a projector in others' formats: written by their own libraries and read, and the other way round."""

import base64
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.errors import RecordError
from fringecal.projector import StatedPair
from fringecal.records import read_lens, read_pair, read_point_pairs, read_stated, write_pair
from fringecal.records.foreign.write_pair import camera_info_texts, slmaster_text, slstudio_text, stereo_text

TERMS = np.array([-0.07, -0.18, 2.3e-4, 5.5e-4, 0.1])
CAMERA = Lens(np.array([1754.1, 1752.9, 645.4, 529.5, *TERMS]), np.zeros((9, 9)), 1280, 1024, covariance_known=False)
PROJECTOR = Lens(
    np.array([2496.6, 2495.8, 990.3, 1047.0, 0.04, -0.06, 1e-4, 2e-4, 0.0]), np.zeros((9, 9)), 1920, 1080, False
)
ROTATION = Rotation.from_rotvec([0.02, 0.31, -0.01]).as_matrix()
PAIR = StatedPair(CAMERA, PROJECTOR, ROTATION, np.array([-108.2, -5.2, 15.7]), "OpenCV")
SIZES = {"camera_size": (1280, 1024), "projector_size": (1920, 1080)}
POINTS = np.array([[0.0, 0, 500], [40, 20, 480], [-60, 30, 550], [10, -45, 510]])


def matrix(lens):
    fx, fy, cx, cy = lens.values[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def places(rotation, shift_mm):
    """Where OpenCV says that the projector lights POINTS: the truth that no reader of ours had a hand in."""
    turn = cv2.Rodrigues(rotation)[0]
    return cv2.projectPoints(POINTS, turn, np.asarray(shift_mm), matrix(PROJECTOR), PROJECTOR.values[4:])[0][:, 0]


def demand_same(found, *, atol=1e-9):
    np.testing.assert_allclose(found.camera.values, CAMERA.values, rtol=1e-9)
    np.testing.assert_allclose(found.light(POINTS), places(ROTATION, PAIR.shift_mm), atol=max(atol, 1e-6))
    assert (found.camera.width_px, found.camera.height_px) == SIZES["camera_size"]
    assert (found.projector.width_px, found.projector.height_px) == SIZES["projector_size"]


def stored(path, entries):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in entries.items():
        storage.write(name, value)
    storage.release()
    return path


SLSTUDIO = {
    "Kc": matrix(CAMERA), "kc": TERMS[None], "Kp": matrix(PROJECTOR), "kp": PROJECTOR.values[4:][None], "Rp": ROTATION,
    "Tp": PAIR.shift_mm[:, None], "cam_error": 0.2, "proj_error": 0.9, "stereo_error": 0.6, "frameWidth": 1280,
    "frameHeight": 1024, "screenResX": 1920, "screenResY": 1080,
}  # fmt: skip
SLMASTER = {
    "M1": matrix(CAMERA), "D1": TERMS[None], "S": np.array([[1280.0], [1024.0]]), "M4": matrix(PROJECTOR),
    "D4": PROJECTOR.values[4:][None], "Rlp": ROTATION, "Tlp": PAIR.shift_mm[:, None],
}  # fmt: skip
MORENO = {
    "cam_K": matrix(CAMERA), "cam_kc": TERMS[None], "proj_K": matrix(PROJECTOR), "proj_kc": PROJECTOR.values[4:][None],
    "R": ROTATION, "T": PAIR.shift_mm[:, None], "cam_error": 0.1, "proj_error": 0.2, "stereo_error": 0.2,
}  # fmt: skip


@pytest.mark.parametrize("suffix", ["yml", "xml"])
@pytest.mark.parametrize(
    ("entries", "sizes", "kind"),
    [
        (SLSTUDIO, {}, "SLStudio"),
        (SLMASTER, {"projector_size": (1920, 1080)}, "SLMaster"),
        (MORENO, SIZES, "scan3d-capture"),
    ],
)
def test_what_opencv_stores_is_read(tmp_path, suffix, entries, sizes, kind):
    found = read_pair([stored(tmp_path / f"theirs.{suffix}", entries)], **sizes)
    demand_same(found)
    assert found.kind == kind
    if kind == "SLStudio":
        assert found.errors_px == {"camera": 0.2, "projector": 0.9, "pair": 0.6}
    assert not found.camera.covariance_known


def test_intrinsics_and_extrinsics_of_opencv_are_two_files(tmp_path):
    inner = {"M1": matrix(CAMERA), "D1": TERMS[None], "M2": matrix(PROJECTOR), "D2": PROJECTOR.values[4:][None]}
    files = [
        stored(tmp_path / "intrinsics.yml", inner),
        stored(tmp_path / "extrinsics.yml", {"R": ROTATION, "T": PAIR.shift_mm[:, None]}),
    ]
    demand_same(read_pair(files, **SIZES))
    metres = [files[0], stored(tmp_path / "m.yml", {"R": ROTATION, "T": PAIR.shift_mm[:, None] / 1000})]
    np.testing.assert_allclose(read_pair(metres, **SIZES, unit_mm=1000.0).shift_mm, PAIR.shift_mm)


def test_a_size_that_is_missing_is_asked_for_by_its_option(tmp_path):
    file = stored(tmp_path / "theirs.yml", SLMASTER)
    with pytest.raises(RecordError, match="size of the projector is not stated.*--projector-size"):
        read_pair([file])
    with pytest.raises(RecordError, match="--camera-size"):
        read_pair([stored(tmp_path / "m.yml", MORENO)])


def test_two_cameras_of_slmaster_are_no_camera_and_projector(tmp_path):
    entries = {"M1": matrix(CAMERA), "D1": TERMS[None], "M2": matrix(CAMERA), "D2": TERMS[None], "Rlr": ROTATION}
    with pytest.raises(RecordError, match="two cameras"):
        read_pair([stored(tmp_path / "two.yml", entries | {"Tlr": PAIR.shift_mm[:, None]})], **SIZES)


def bouguet(path, **changes):
    savemat(
        path,
        {
            "fc_left": CAMERA.values[:2, None], "cc_left": CAMERA.values[2:4, None], "kc_left": TERMS[:, None],
            "alpha_c_left": 0.0, "fc_right": PROJECTOR.values[:2, None], "cc_right": PROJECTOR.values[2:4, None],
            "kc_right": PROJECTOR.values[4:, None], "alpha_c_right": 0.0, "R": ROTATION, "T": PAIR.shift_mm[:, None],
            "nx": 1280.0, "ny": 1024.0, "om": np.zeros((3, 1)), "calib_name_left": "board", **changes,
        },
        do_compression=True,
    )  # fmt: skip
    return path


def test_bouguets_file_is_read_and_its_errors_are_three_standard_deviations(tmp_path):
    errors = {"fc_left_error": [[3.0], [3.3]], "cc_left_error": [[1.5], [1.8]], "kc_left_error": np.full((5, 1), 0.03)}
    found = read_pair([bouguet(tmp_path / "c.mat", **errors)], projector_size=(1920, 1080))
    demand_same(found)
    assert found.camera.covariance_known
    assert not found.projector.covariance_known
    np.testing.assert_allclose(np.sqrt(np.diag(found.camera.covariance)), [1, 1.1, 0.5, 0.6, *[0.01] * 5])
    assert "without correlations" in found.notes[0]


def test_a_single_camera_of_bouguets_is_a_lens(tmp_path):
    savemat(
        tmp_path / "c.mat",
        {"fc": CAMERA.values[:2, None], "cc": CAMERA.values[2:4, None], "kc": TERMS[:, None], "nx": 1280, "ny": 1024},
    )
    np.testing.assert_allclose(read_lens(tmp_path / "c.mat").values, CAMERA.values)
    assert isinstance(read_stated([tmp_path / "c.mat"]), Lens)
    with pytest.raises(RecordError, match="holds one lens"):
        read_pair([tmp_path / "c.mat"])


def test_skewed_axes_are_refused_only_where_the_picture_shows_it(tmp_path):
    # 1e-5 of 1754 px over half of 1024 rows of 1753 px moves the edge by 0.005 px; 1e-3 by 0.5 px.
    read_pair([bouguet(tmp_path / "a.mat", alpha_c_left=1e-5)], projector_size=(1920, 1080))
    with pytest.raises(RecordError, match="skewed"):
        read_pair([bouguet(tmp_path / "b.mat", alpha_c_left=1e-3)], projector_size=(1920, 1080))


def test_files_of_matlabs_newer_format_are_named(tmp_path):
    (tmp_path / "c.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))
    with pytest.raises(RecordError, match="-v7"):
        read_lens(tmp_path / "c.mat")


def camera_info(lens, rectification, projection, *, topic):
    """camera_info as ROS writes it: its calibration files, and what is echoed of a topic."""
    keys = ("K", "D", "R", "P") if topic else _FILE_KEYS
    arrays = dict(zip(keys, (matrix(lens), lens.values[4:], rectification, projection), strict=True))
    if topic:
        rows = [f"{key}: [{', '.join(map(repr, np.ravel(value).tolist()))}]" for key, value in arrays.items()]
        head = f"header:\n  seq: 0\n  frame_id: 'cam'\nheight: {lens.height_px}\nwidth: {lens.width_px}\n"
        return head + 'distortion_model: "plumb_bob"\n' + "\n".join(rows) + "\n---\n"
    text = f"image_width: {lens.width_px}\nimage_height: {lens.height_px}\ncamera_name: cam\n"
    for key, value in arrays.items():
        rows, columns = np.atleast_2d(value).shape
        numbers = "\n".join(f"  - {number!r}" for number in np.ravel(value).tolist())
        text += f"{key}:\n  rows: {rows}\n  cols: {columns}\n  data:\n{numbers}\n"
    return text + "distortion_model: plumb_bob\n"


_FILE_KEYS = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")


@pytest.mark.parametrize("topic", [True, False])
def test_the_pose_of_ros_is_that_which_opencv_rectified(tmp_path, topic):
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        matrix(CAMERA),
        TERMS,
        matrix(PROJECTOR),
        PROJECTOR.values[4:],
        (1280, 1024),
        ROTATION,
        PAIR.shift_mm[:, None] / 1000,
    )
    for name, lens, r, p in (("left", CAMERA, r1, p1), ("right", PROJECTOR, r2, p2)):
        (tmp_path / f"{name}.yaml").write_text(camera_info(lens, r, p, topic=topic), encoding="utf-8")
    demand_same(read_pair([tmp_path / "left.yaml", tmp_path / "right.yaml"]), atol=1e-4)


def test_a_fisheye_of_ros_is_refused(tmp_path):
    text = camera_info(CAMERA, np.eye(3), np.eye(3, 4), topic=False).replace("plumb_bob", "equidistant")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecordError, match="equidistant"):
        read_lens(tmp_path / "a.yaml")


def test_slstudios_own_text_is_read(tmp_path):
    rows = lambda m: "\n".join(" ".join(f"{x:f}" for x in row) for row in np.atleast_2d(m))  # noqa: E731
    names = ("Kc", "kc", "Kp", "kp", "Rp", "Tp")
    text = "#V1.0 SLStudio calibration\n#Calibration time: today\n\n"
    text += "".join(f"{name}\n{rows(SLSTUDIO[name].T if name == 'Tp' else SLSTUDIO[name])}\n\n" for name in names)
    (tmp_path / "a.slcalib").write_text(text + "cam_error: 0.200000\n\n", encoding="utf-8")
    found = read_pair([tmp_path / "a.slcalib"], **SIZES)
    # Six decimals are written: of a turn as of the terms.
    np.testing.assert_allclose(found.light(POINTS), places(ROTATION, PAIR.shift_mm), atol=0.02)
    assert found.errors_px == {"camera": 0.2}


def test_mrcal_places_the_projector_as_we_do(tmp_path):
    mrcal = pytest.importorskip("mrcal")
    write_pair(tmp_path, replace(PAIR, valid_px={"projector": np.array([[0.0, 0], [9, 0], [9, 9], [0, 9], [0, 0]])}))
    camera, projector = (mrcal.cameramodel(str(tmp_path / f"{who}.cameramodel")) for who in ("camera", "projector"))
    pose = mrcal.compose_Rt(projector.Rt_cam_ref(), camera.Rt_ref_cam())
    seen = mrcal.project(mrcal.transform_point_Rt(pose, POINTS), *projector.intrinsics())
    np.testing.assert_allclose(seen, places(ROTATION, PAIR.shift_mm), atol=1e-6)
    assert projector.valid_intrinsics_region().shape == (5, 2)
    found = read_pair([tmp_path / "camera.cameramodel", tmp_path / "projector.cameramodel"])
    demand_same(found)
    assert found.valid_px["projector"].shape == (5, 2)


def test_pairs_of_mrcal_with_another_reference_have_the_same_pose(tmp_path):
    mrcal = pytest.importorskip("mrcal")
    away = np.array([0.3, -0.2, 0.5, 100.0, -50.0, 800.0])
    other = mrcal.compose_rt(np.r_[Rotation.from_matrix(ROTATION).as_rotvec(), PAIR.shift_mm], away)
    for name, lens, pose in (("c", CAMERA, away), ("p", PROJECTOR, other)):
        model = mrcal.cameramodel(
            intrinsics=("LENSMODEL_OPENCV5", lens.values), imagersize=(lens.width_px, lens.height_px), rt_cam_ref=pose
        )
        model.write(str(tmp_path / f"{name}.cameramodel"))
    demand_same(read_pair([tmp_path / "c.cameramodel", tmp_path / "p.cameramodel"]), atol=1e-5)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (slstudio_text(PAIR), ("Kc", "Kp", "Rp", "Tp")),
        (slmaster_text(PAIR), ("M1", "M4", "Rlp", "Tlp")),
        (stereo_text(PAIR), ("camera_matrix1", "camera_matrix2", "R", "T")),
    ],
)
def test_opencv_reads_what_is_written(text, names):
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    truth = (matrix(CAMERA), matrix(PROJECTOR), ROTATION, PAIR.shift_mm[:, None])
    for name, expected in zip(names, truth, strict=True):
        np.testing.assert_allclose(storage.getNode(name).mat(), expected, rtol=1e-12)


def test_matlabs_reader_reads_what_is_written(tmp_path):
    write_pair(tmp_path, PAIR)
    found = loadmat(tmp_path / "Calib_Results_stereo.mat")
    np.testing.assert_allclose(found["fc_right"].ravel(), PROJECTOR.values[:2])
    np.testing.assert_allclose(found["R"], ROTATION)
    np.testing.assert_allclose(found["T"].ravel(), PAIR.shift_mm)
    demand_same(read_pair([tmp_path / "Calib_Results_stereo.mat"], projector_size=(1920, 1080)))


def test_yaml_readers_read_camera_info(tmp_path):
    yaml = pytest.importorskip("yaml")
    camera, projector = (yaml.safe_load(text) for text in camera_info_texts(PAIR))
    np.testing.assert_allclose(np.reshape(camera["camera_matrix"]["data"], (3, 3)), matrix(CAMERA))
    # Both turn into one frame in which the projector's centre lies on the x axis: P[0, 3] / fx is its shift, metres.
    turns = [np.reshape(one["rectification_matrix"]["data"], (3, 3)) for one in (camera, projector)]
    shift = projector["projection_matrix"]["data"][3] / projector["projection_matrix"]["data"][0]
    np.testing.assert_allclose(turns[1].T @ turns[0], ROTATION, atol=1e-12)
    np.testing.assert_allclose(turns[1].T @ [1000 * shift, 0, 0], PAIR.shift_mm, atol=1e-9)


def test_every_format_says_the_same(tmp_path):
    known = replace(CAMERA, covariance=np.diag(np.full(9, 1e-4)), covariance_known=True)
    write_pair(tmp_path, replace(PAIR, camera=known))
    for names in (
        ["camera.cameramodel", "projector.cameramodel"],
        ["stereo.yml"],
        ["slstudio.xml"],
        ["caliInfo.yml"],
        ["camera.yaml", "projector.yaml"],
    ):
        found = read_pair([tmp_path / name for name in names], projector_size=(1920, 1080))
        demand_same(found)
        assert found.camera.covariance_known is (names[0] == "camera.cameramodel")


def test_a_mirrored_rotation_is_refused(tmp_path):
    for wrong, reason in (
        (np.diag([1.0, 1, -1]), "mirrors"),
        (2 * np.eye(3), "scales"),
        (np.full((3, 3), np.nan), "no"),
    ):
        file = stored(tmp_path / "theirs.yml", SLSTUDIO | {"Rp": wrong})
        with pytest.raises(RecordError, match=reason):
            read_pair([file])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage/>", "entity"),
        (b"<html></html>", "opencv_storage"),
        (b"<opencv_storage><a>", "whole XML"),
        (b"<opencv_storage>" + b"<a>" * 100, "deeper than the 16"),
        (b"%YAML:1.0\n---\na: &b [1]\n", "anchor"),
        (b"%YAML:1.0\n---\na: [1, 2\n", "cut short"),
        (b"%YAML:1.0\n---\na: 1\na: 2\n", "twice"),
        (b"%YAML:1.0\n---\na: " + b"[" * 100 + b"]" * 100, "deeper than the 16"),
        (b"%YAML:1.0\n---\nsomething: else\n", "names that are known here"),
        (b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + b"\x0e\x00\x00\x00\xff\xff\x00\x00", "cut short"),
    ],
)
def test_nonsense_is_refused_with_a_sentence(tmp_path, content, reason):
    (tmp_path / "a.xml").write_bytes(content)
    with pytest.raises(RecordError, match=reason):
        read_pair([tmp_path / "a.xml"], **SIZES)


def test_deflated_bombs_are_not_unpacked(tmp_path):
    import struct
    import zlib

    body = zlib.compress(bytes(200 << 20))
    head = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    (tmp_path / "a.mat").write_bytes(head + struct.pack("<II", 15, len(body)) + body)
    with pytest.raises(RecordError, match="64 MiB"):
        read_pair([tmp_path / "a.mat"])


CSV = "pose,camera_u_px,camera_v_px,projector_u_px,projector_v_px,x_mm,y_mm\n1,10,20,30,40,0,0\n2,11,21,,41,5,0\n"


def test_places_are_read_from_rows_and_from_arrays(tmp_path):
    (tmp_path / "a.csv").write_text(CSV, encoding="utf-8")
    one, two = read_point_pairs(tmp_path / "a.csv")
    assert one.camera_px.tolist() == [[10, 20]]
    assert one.board_mm.tolist() == [[0, 0, 0]]
    assert np.isnan(two.projector_px[0, 0])
    camera, board = np.arange(24.0).reshape(2, 6, 2), np.arange(18).reshape(6, 3)
    np.savez(tmp_path / "a.npz", camera_px=camera, projector_px=camera + 1, board_mm=board)
    savemat(tmp_path / "a.mat", {"camera_px": camera, "projector_px": camera + 1, "board_mm": board})
    for name in ("a.npz", "a.mat"):
        found = read_point_pairs(tmp_path / name)
        np.testing.assert_allclose([pose.camera_px for pose in found], camera)
        np.testing.assert_allclose(found[1].board_mm, board)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "camera_u_px is missing"),
        (CSV.replace("projector_v_px", "v"), "projector_v_px is missing"),
        (CSV.replace("1,10,", "1,ten,"), "line 2: 'ten' is no number"),
        (CSV + "3,1\n", "line 4 has 2 fields"),
        (CSV.splitlines()[0] + "\n", "0 poses"),
    ],
)
def test_lists_that_are_none_are_refused(tmp_path, text, reason):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(RecordError, match=reason):
        read_point_pairs(tmp_path / "a.csv")


def test_objects_in_archives_are_never_loaded(tmp_path):
    np.savez(tmp_path / "a.npz", camera_px=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordError, match="an array of object"):
        read_point_pairs(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(b"PK" + base64.b85decode("abcde"))
    with pytest.raises(RecordError, match="may be damaged"):
        read_point_pairs(tmp_path / "b.npz")
