"""A `.cameramodel` that keeps its solve brings its covariance: held against another solver's, and damaged."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.lens_solve import Way, solve_lens
from fringecal.errors import RecordError
from fringecal.records.foreign.lens_files import parse_lens

mrcal = pytest.importorskip("mrcal")
NOISE_PX = 0.1


@pytest.fixture(scope="module")
def views(boards):
    """Ten views with a second board pose each side, and a third radial term, so that all of OPENCV5 is determined."""
    lens = Lens(np.array([810.0, 812, 325, 236, -0.2, 0.08, 0.001, -0.0005, 0.05]), np.zeros((9, 9)), 640, 480)
    return boards.seen(noise_px=NOISE_PX, seed=3, project=lens.project)


def solved(views, boards, model="LENSMODEL_OPENCV5", size=9):
    """mrcal's own solve and the text of the file that it writes."""
    start = np.concatenate([boards.truth[:4], np.zeros(size - 4)])
    inputs = mrcal_wall._inputs([view.points_px for view in views], 25.0, start, poses(views), boards.shape)
    inputs |= mrcal_wall._choices(model, warped=True)
    # As mrcal's own tool does it: unregularised, eight terms fit such corners with a pole inside the picture.
    inputs["do_apply_regularization"] = size > 9
    mrcal.optimize(**inputs)
    return mrcal.cameramodel(optimization_inputs=inputs, icam_intrinsics=0)


def poses(views):
    flat = solve_lens(views, (480, 640), Way(use_mrcal=False, model="brown", radial_terms=2, flat_board=True))
    found = []
    for view in flat.views:
        first, along, down = (view.points_mm[k] - view.points_mm[0] * (k > 0) for k in (0, 8, 45))
        axes = np.stack([along / np.linalg.norm(along), down / np.linalg.norm(down)])
        found.append(np.concatenate([Rotation.align_vectors(axes, np.eye(3)[:2])[0].as_rotvec(), first]))
    return np.array(found)


def text_of(model, tmp_path):
    model.write(str(tmp_path / "theirs.cameramodel"))
    return (tmp_path / "theirs.cameramodel").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def written(views, boards, tmp_path_factory):
    return text_of(solved(views, boards), tmp_path_factory.mktemp("mrcal"))


def test_the_covariance_is_that_of_another_solver_on_the_same_points(written, views, boards):
    found = parse_lens(written)
    ours = solve_lens(views, boards.shape, Way(use_mrcal=False, model="brown", radial_terms=3, flat_board=False)).lens
    assert found.covariance_known
    # Both minimise the same sum: the solvers stop a little apart, and the Jacobians there agree.
    sigma = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose(found.values, ours.values, atol=0.01 * sigma.max(), rtol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), sigma, rtol=0.02)
    correlation = found.covariance / np.outer(*[np.sqrt(np.diag(found.covariance))] * 2)
    np.testing.assert_allclose(correlation, ours.covariance / np.outer(sigma, sigma), atol=0.02)


def test_terms_that_a_model_has_not_are_exact(views, boards, tmp_path):
    found = parse_lens(text_of(solved(views, boards, "LENSMODEL_OPENCV4", 8), tmp_path))
    assert found.covariance_known
    assert found.covariance[8].tolist() == [0.0] * 9
    assert (np.diag(found.covariance)[:8] > 0).all()


def test_a_rational_lens_carries_its_covariance_to_browns(views, boards, tmp_path):
    found = parse_lens(text_of(solved(views, boards, "LENSMODEL_OPENCV8", 12), tmp_path))
    assert found.covariance_known
    # Where the boards were, both describe one and the same picture; the focal length is known as well as by Brown's.
    assert 0.3 < np.sqrt(found.covariance[0, 0]) / np.sqrt(parse_lens_brown(views, boards)[0, 0]) < 3


def parse_lens_brown(views, boards):
    way = Way(use_mrcal=False, model="brown", radial_terms=3, flat_board=False)
    return solve_lens(views, boards.shape, way).lens.covariance


def test_the_second_camera_of_a_solve_has_its_own_covariance(views, boards):
    """Two cameras solved together that share nothing: each has the covariance that it has alone."""
    one = solved(views, boards).optimization_inputs()
    other = [replace(view, points_px=view.points_px + np.random.default_rng(9).normal(0, 0.3, view.points_px.shape))
             for view in views]  # fmt: skip
    two = solved(other, boards).optimization_inputs()
    alone = mrcal_wall.solve_covariance(two, 0, "LENSMODEL_OPENCV5", two["intrinsics"][0])
    far = {"rt_cam_ref": np.zeros((0, 6))}
    both = one | far
    for name in ("intrinsics", "imagersizes", "rt_ref_frame", "observations_board"):
        both[name] = np.concatenate([one[name], two[name]])
    numbers = one["indices_frame_camintrinsics_camextrinsics"]
    both["indices_frame_camintrinsics_camextrinsics"] = np.concatenate(
        [numbers, numbers + np.array([len(views), 1, 0], dtype=np.int32)]
    )
    both |= {"calobject_warp": None, "do_optimize_calobject_warp": False}
    together = mrcal_wall.solve_covariance(both, 1, "LENSMODEL_OPENCV5", two["intrinsics"][0])
    # The scatter is that of both, and the warp is held: the shape of the covariance remains near.
    ratio = np.sqrt(np.diag(together) / np.diag(alone))
    assert ratio.max() / ratio.min() < 1.3


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace("'icam_intrinsics': 0", "'icam_intrinsics': 5"), "do not fit together"),
        (lambda text: text.replace("'icam_intrinsics': 0,", ""), "icam_intrinsics"),
        (lambda text: text.replace("'icam_intrinsics': 0,", "'icam_intrinsics': True,"), "icam_intrinsics"),
        (lambda text: re.sub(r"b'([^']{1000})", lambda m: f"b'{m[1][::-1]}", text), "damaged"),
        (lambda text: re.sub(r"b'([^']{400})[^']*'", r"b'\1'", text), "damaged"),
        (lambda text: re.sub(r"b'[^']*'", "'zzz\\\\'", text), "neither"),
        (lambda text: re.sub(r"b'[^']*'", "[1, 2]", text), "no text"),
        (lambda text: re.sub(r"'intrinsics': \[ [0-9.]+", "'intrinsics': [ 900.0", text), "changed after"),
        (lambda text: text.replace("OPENCV5'", "OPENCV4'").replace(text.split("intrinsics': [")[1].split("]")[0],
         " 1, 1, 1, 1, 0, 0, 0, 0 "), "not one of its lens model"),
    ],
)  # fmt: skip
def test_a_solve_that_does_not_belong_to_the_lens_is_refused(written, change, reason):
    text = change(written)
    assert text != written
    with pytest.raises(RecordError, match=reason):
        parse_lens(text)


def test_without_mrcal_such_a_lens_is_no_exact_one(written, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mrcal", None)
    with pytest.raises(RecordError, match="mrcal is not installed.*take the entry optimization_inputs out"):
        parse_lens(written)
