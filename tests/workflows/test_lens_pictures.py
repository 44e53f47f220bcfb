"""The lens from real pictures: half of them without a board, one blurred, the counts swapped, the board too small."""

from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest

from fringecal.calibration.board_lens import KnownLens, lens_from_pictures
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.lens_uncertainty import projection_difference_px
from fringecal.errors import DetectionError, FitError, TargetError
from fringecal.records.lens_record import LensDocument
from fringecal.records.schemas import published_schema
from fringecal.targets import load_target
from fringecal.workflows.lens.record import lens_record
from fringecal.workflows.lens.report import lens_report, lens_section

DATA = Path(__file__).parents[1] / "data" / "opencv_chess_left"
BOARD = load_target("chessboard-9x6-25mm")


@pytest.fixture(scope="module")
def pictures():
    return [(path.name, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in sorted(DATA.glob("*.jpg"))[:9]]


@pytest.fixture(scope="module")
def found(pictures):
    return lens_from_pictures(pictures, BOARD)


def without_board(picture):
    """The upper left quarter of a picture, as large as the whole."""
    return cv2.resize(picture[:240, :320], (640, 480))


def test_pictures_without_a_board_are_named_and_left_aside(pictures, found):
    mixed = [p for name, image in pictures for p in ((name, image), (f"no-{name}", without_board(image)))]
    mixed = mixed[:8] + [p for p in mixed[8:] if not p[0].startswith("no-")]
    half = lens_from_pictures(mixed, BOARD)
    missed = [p.name for p in half.pictures if p.view is None]
    assert missed == [f"no-{name}" for name, _ in pictures[:4]]
    assert any("no-left01.jpg" in note for note in half.notes)
    np.testing.assert_allclose(half.fit.lens.values, found.fit.lens.values)


def test_a_blurred_picture_does_not_move_the_lens_beyond_its_uncertainty(pictures, found):
    blurred = [(n, cv2.GaussianBlur(i, (0, 0), 3.0) if k == 2 else i) for k, (n, i) in enumerate(pictures)]
    other = lens_from_pictures(blurred, BOARD)
    both = np.hypot(found.fit.uncertainty_px, other.fit.uncertainty_px)
    assert np.median(projection_difference_px(found.fit.lens, other.fit.lens) / both) < 2


def test_swapped_counts_mean_the_same_board(pictures, found):
    swapped = BOARD.model_copy(update={"columns": 6, "rows": 9})
    other = lens_from_pictures(pictures, swapped)
    both = np.hypot(found.fit.uncertainty_px, other.fit.uncertainty_px)
    assert np.median(projection_difference_px(found.fit.lens, other.fit.lens) / both) < 1


def test_a_board_that_is_not_there_is_refused(pictures):
    other = BOARD.model_copy(update={"columns": 10, "rows": 7})
    with pytest.raises(DetectionError, match=r"0 of 2 pictures.*inner corners"):
        lens_from_pictures(pictures[:2], other)


def test_one_picture_never_yields_a_focal_length(pictures):
    with pytest.raises(DetectionError, match="square-on"):
        lens_from_pictures(pictures[:1], BOARD)


def test_pictures_of_two_sizes_and_a_target_that_is_no_board_are_refused(pictures):
    with pytest.raises(FitError, match="different sizes"):
        lens_from_pictures([*pictures, ("small.png", pictures[0][1][::2, ::2])], BOARD)
    with pytest.raises(TargetError, match="no board"):
        lens_from_pictures(pictures[:3], load_target("glass-strips"))


def test_black_pictures_hold_no_board():
    black = [(f"{k}.png", np.zeros((480, 640), np.uint8)) for k in range(3)]
    with pytest.raises(DetectionError, match="0 of 3"):
        lens_from_pictures(black, BOARD)


def test_the_record_fits_its_schema_and_says_what_the_lens_rests_on(found):
    record = lens_record(KnownLens(found.fit.lens, findings=found), distance_mm=400.0)
    document = LensDocument(software={"fringecal": "0"}, lens=record).model_dump(mode="json")
    jsonschema.Draft202012Validator(published_schema("lens")).validate(document)
    assert record.boards.points + record.boards.outliers == 9 * 54
    assert record.boards.projection.median_px == pytest.approx(np.nanmedian(found.fit.uncertainty_at_px(400.0)))
    assert [p.name for p in record.boards.pictures] == [p.name for p in found.pictures]


def test_the_report_shows_boards_residuals_coverage_and_uncertainty(found):
    report = lens_report(found)
    assert [f.caption for f in report.sections[0].figures] == [
        "Boards found",
        "Residuals of the boards",
        "Coverage of the field",
        "Uncertainty of the projection",
    ]
    table = next(t for t in report.sections[0].tables if t.caption == "Pictures of the board").frame
    assert list(table["picture"]) == [p.name for p in found.pictures]


def test_a_file_without_covariance_is_said_to_count_as_exact():
    bare = Lens(np.array([800.0, 800, 320, 240, 0, 0, 0, 0, 0]), np.zeros((9, 9)), 640, 480, covariance_known=False)
    known = KnownLens(bare, file="camera.yml")
    assert any("camera.yml states no covariance" in note for note in known.notes)
    assert lens_record(known).covariance is None
    assert lens_section(known).sentences == known.notes
