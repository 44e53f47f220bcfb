"""Calibrations run once more: every archived record, and records whose files or numbers are no longer those."""

import json
import shutil
from pathlib import Path

import pytest

from fringecal.errors import RecordError
from fringecal.procedures.recording import calibration_of
from fringecal.procedures.rerun import demand_inputs, differences, rerun, session_folder
from fringecal.procedures.verification import verify
from fringecal.records.calibration import CalibrationRecord, read_calibration
from fringecal.session import load_session

ARCHIVE = Path(__file__).parents[1] / "records" / "archive"
VERSIONS = sorted(path.name for path in ARCHIVE.iterdir() if path.is_dir() and path.name[0].isdigit())


@pytest.fixture(scope="module", params=VERSIONS)
def archived(request) -> Path:
    return ARCHIVE / request.param


def test_an_archived_record_is_applied(archived):
    bars = verify(load_session(archived / "session"), "bars", calibration_of(read_calibration(archived)))
    # The virtual bars are as certified; a rig of 200 x 150 px and one grey level of noise knows heights to a
    # hundredth of the bars' 28 mm.
    assert bars.errors.pooled.max_abs_mm < 0.02 * bars.errors.full_height_mm
    assert all(abs(profile.en) < 1.5 for profile in bars.errors.profiles)


def test_an_archived_record_is_repeated(archived):
    written = read_calibration(archived)
    assert session_folder(written) == Path("session")
    found = rerun(written, archived / "session")
    assert found.fresh.inputs == written.inputs
    then, now = ({c.name: c.decision for c in one.checks} for one in (written, found.fresh))
    common = then.keys() & now.keys()  # later versions may judge more, or something better
    assert len(common) >= 5
    assert {name: now[name] for name in common} == {name: then[name] for name in common}
    # Later versions may do better, and say so under "Numbers that change"; none may contradict an older one.
    assert max((d.part_of_u or 0.0 for d in found.differences), default=0.0) < 1.0, found.sentence
    assert "Other software" in found.sentence if found.versions else "the record's own" in found.sentence


# ---- what is no longer the same --------------------------------------------------------------------
@pytest.fixture(scope="module")
def newest() -> CalibrationRecord:
    return read_calibration(ARCHIVE / VERSIONS[-1])


def test_every_file_that_is_not_the_records_is_named(newest, tmp_path):
    folder = shutil.copytree(ARCHIVE / VERSIONS[-1] / "session", tmp_path / "s")
    demand_inputs(newest, folder)
    (folder / "grid.png").unlink()
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(text + "# a note\n")
    with pytest.raises(RecordError) as caught:
        rerun(newest, folder)
    grid, toml = sorted(line.strip() for line in str(caught.value).splitlines()[1:])
    assert grid.startswith("grid.png: missing")
    assert toml.startswith("session.toml: another content (SHA-256 ")


def test_a_record_without_a_command_line_needs_a_folder(newest):
    with pytest.raises(RecordError, match="--session"):
        session_folder(newest.model_copy(update={"command": ()}))


def document_of(record):
    return json.loads(record.model_dump_json())


@pytest.mark.parametrize(
    ("place", "change", "part", "matters"),
    [
        (("scale", "mean", "value"), lambda old, u: old + u / 2, 0.5, True),
        (("scale", "mean", "value"), lambda old, u: old + u / 1000, 0.001, False),
        (("scale", "mean", "u"), lambda old, _: old * (1 + 1e-9), None, False),
        (("distortion", "verdict"), lambda old, _: old + "!", None, True),
        (("projection", "theory"), lambda *_: None, None, True),
        (("rig", "residual_rms_rad"), lambda old, _: old * 1.001, None, False),
    ],
)
def test_differences_are_told_by_their_uncertainty(newest, place, change, part, matters):
    then, now = document_of(newest), document_of(newest)
    table = now
    for key in place[:-1]:
        table = table[key]
    table[place[-1]] = change(table[place[-1]], table.get("u"))
    (found,) = differences(then, now)
    assert found.place == ".".join(place)
    assert found.part_of_u == (None if part is None else pytest.approx(part, rel=1e-6))
    assert found.matters is matters


def test_a_column_more_is_a_difference(newest):
    then, now = document_of(newest), document_of(newest)
    now["projection"]["columns"].pop()
    (found,) = differences(then, now)
    assert (found.place, found.matters) == ("projection.columns", True)
