import json
import math

import jsonschema
import numpy as np
import pytest

from fringecal.errors import RecordError
from fringecal.records.calibration_record import CalibrationRecord, read_calibration, write_calibration
from fringecal.records.parts import EstimateRecord, is_covariance
from fringecal.records.schemas import SCHEMAS, generate_schema, published_schema
from fringecal.records.verification_record import VerificationRecord, read_verification, write_verification
from fringecal.uncertainty.estimates import Estimate


def save(folder, document):
    path = folder / "calibration.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_a_document_written_by_hand_is_read(tmp_path, document):
    record = read_calibration(save(tmp_path, document))
    assert record.rig.parameters == (0.1,)
    assert record.projection.columns[0].theory_deg is None
    assert record.created.isoformat() == "2026-11-22T10:00:00+00:00"
    assert record.notes == ("ö and [ brackets ] stay",)


def test_a_record_is_found_in_its_folder(tmp_path, document):
    save(tmp_path, document)
    assert read_calibration(tmp_path).session.rig == "bench-1"


def test_writing_keeps_every_digit_and_every_key_of_the_design(tmp_path, document):
    document["rig"]["parameters"] = [math.pi]
    path = write_calibration(CalibrationRecord.model_validate(document), tmp_path)
    written = json.loads(path.read_text(encoding="utf-8"))
    assert written["rig"]["parameters"] == [math.pi]
    assert written["scale"]["mean"] == {"value": 0.734, "u": 0.0001, "dof": None, "unit": "mm/px"}
    assert set(document) <= set(written)
    assert written["notes"] == document["notes"]
    assert next(iter(written)) == "format"


def test_rows_of_a_matrix_stand_on_one_line(tmp_path, document):
    path = write_calibration(CalibrationRecord.model_validate(document), tmp_path)
    assert "[1e-08, 0.0]" in path.read_text(encoding="utf-8")


def test_infinite_degrees_of_freedom_are_null_and_come_back_infinite():
    record = EstimateRecord.of(Estimate(1.0, 0.1, unit="mm"))
    assert json.loads(record.model_dump_json())["dof"] is None
    assert record.estimate("a") == Estimate(1.0, 0.1, unit="mm", label="a")
    assert EstimateRecord.of(Estimate(1.0, 0.1, dof=4.5)).estimate().dof == 4.5


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_json_cannot_hold_is_refused(number):
    with pytest.raises(ValueError, match="finite"):
        EstimateRecord.of(Estimate(number, 0.1, unit="mm"))


def test_nan_hidden_in_a_target_is_refused_and_leaves_no_file(tmp_path, document):
    document["targets"]["grid-10mm"]["pitch_mm"]["u"] = math.nan
    record = CalibrationRecord.model_validate(document)
    with pytest.raises(RecordError, match="JSON cannot"):
        write_calibration(record, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_published_schema_is_current(name):
    assert published_schema(name) == generate_schema(name), "run python -m fringecal.records.schemas"


def test_a_written_record_fits_the_published_schema_and_a_damaged_one_does_not(tmp_path, document):
    path = write_calibration(CalibrationRecord.model_validate(document), tmp_path)
    written = json.loads(path.read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(published_schema("calibration"))
    validator.validate(written)
    for damage in ({"scale": None}, {"format": "fringecal-calibration/2"}, {"unknown": 1}):
        assert not validator.is_valid(written | damage)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "not a JSON document"),
        ("colour = blue", "not a JSON document"),
        ('{"format": "fringecal-calibration/1"', "not a JSON document"),
        ('{"format": NaN}', "NaN is not a JSON number"),
        ("[" * 100_000, "nested deeper"),
        ("[]", "no JSON object"),
        ("{}", "format is None"),
        ('{"format": "fringecal-verification/1"}', "another kind of file"),
        ('{"format": "fringecal-calibration/9"}', "newer"),
        ('{"format": "fringecal-calibration/0"}', "unknown"),
        ('{"format": "fringecal-calibration/1"}', "camera: Field required"),
    ],
)
def test_a_file_that_is_no_record_is_refused_with_the_reason(tmp_path, content, reason):
    path = tmp_path / "calibration.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RecordError, match=reason):
        read_calibration(path)


def test_bytes_that_are_no_text_and_a_missing_file_are_refused(tmp_path):
    (tmp_path / "picture.json").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(RecordError, match="is not UTF-8 text"):
        read_calibration(tmp_path / "picture.json")
    with pytest.raises(RecordError, match="cannot be read"):
        read_calibration(tmp_path / "nowhere.json")


def put(document, keys, value):
    for key in keys[:-1]:
        document = document[key]
    document[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value", "reason"),
    [
        (("camera", "covariance"), [[1.0]], "camera: .*2 x 2"),
        (("camera", "covariance"), [[1.0, 2.0], [2.0, 1.0]], "semi-definite"),
        (("camera", "names"), ["a", "a"], "different names"),
        (("rig", "cross_covariance"), [[0.0]], "1 x 2"),
        (("rig", "plate_residual", "coefficients"), [0.0], "takes 3 coefficients"),
        (("rig", "plate_residual", "box"), [1.0, -1.0, 0.0, 1.0], "x_min < x_max"),
        (("scale", "mean", "u"), -1.0, "scale.mean.u: .*greater than or equal to 0"),
        (("scale", "mean", "value"), "0.734", "scale.mean.value: .*valid number"),
        (("distortion", "verdict"), "banana", "distortion.verdict"),
        (("inputs", 0, "sha256"), "abc", "inputs.0.sha256"),
        (("created",), "2026-11-22T10:00:00", "created: .*timezone"),
        (("rig", "colour"), "blue", "rig.colour: Extra"),
    ],
)
def test_a_record_that_contradicts_itself_is_refused_by_the_name_of_the_key(tmp_path, document, keys, value, reason):
    put(document, keys, value)
    with pytest.raises(RecordError, match=reason):
        read_calibration(save(tmp_path, document))


def test_covariance_is_judged_at_every_scale():
    # Parameters of a rig differ by 12 decades; an absolute test would pass or fail everything.
    correlation = np.array([[1.0, 1.2], [1.2, 1.0]])
    for scale in (1e-9, 1.0, 1e9):
        assert not is_covariance(tuple(map(tuple, correlation * scale)), 2)
    assert is_covariance(((1e-18, 0.0), (0.0, 1e12)), 2)
    assert is_covariance(((0.0, 0.0), (0.0, 1.0)), 2)  # a parameter held fixed
    assert not is_covariance(((1.0, 0.5), (0.1, 1.0)), 2)
    assert is_covariance((), 0)


def test_a_verification_record_goes_out_and_comes_back(tmp_path, document):
    profile = {
        "name": "A", "row_px": 10.0, "y_mm": 7.34, "n": 435, "mean_mm": 0.01, "sd_mm": 0.05,
        "max_abs_mm": 0.2, "mean_percent": 0.035, "max_percent": 0.7, "u_mm": 0.02, "en": 0.25, "dof": 12.5,
    }  # fmt: skip
    shared = {key: document[key] for key in ("software", "session", "inputs", "created")}
    record = VerificationRecord.model_validate(
        shared
        | {
            "calibration": {"file": "calibration.json", "sha256": "a" * 64},
            "capture": "bars",
            "target": {"kind": "zigzag"},
            "full_height_mm": 28.284,
            "edge_zone_mm": 3.0,
            "height_model": "projective",
            "profiles": [profile],
        }
    )
    path = write_verification(record, tmp_path)
    assert json.loads(path.read_text(encoding="utf-8"))["profiles"] == [profile]
    again = read_verification(tmp_path)
    assert again.digest_state == "fits"
    assert again.model_dump(exclude={"digest"}) == record.model_dump(exclude={"digest"})
    jsonschema.validate(json.loads(path.read_text(encoding="utf-8")), published_schema("verification"))
