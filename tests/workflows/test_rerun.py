"""Records run once more: every archived calibration, judgements, and records whose files or numbers have changed."""

import copy
import hashlib
import json
import math
import re
import shutil
from pathlib import Path

import pytest

from fringecal.cli.app import main
from fringecal.errors import RecordError
from fringecal.records.audit_record import write_audit
from fringecal.records.calibration_record import CalibrationRecord, read_calibration, write_calibration
from fringecal.records.files import result_folder
from fringecal.records.kinds_of_record import read_record
from fringecal.records.limits import Limits
from fringecal.records.verification_record import CalibrationUsed, write_verification
from fringecal.session import load_session
from fringecal.workflows.audit.record import audit_record
from fringecal.workflows.audit.run import audit
from fringecal.workflows.rerun.number_by_number import differences, stated_alone
from fringecal.workflows.rerun.run import calibration_file, demand_inputs, rerun, session_folder
from fringecal.workflows.shared.stored_calibration import calibration_of
from fringecal.workflows.verify.record import verification_record
from fringecal.workflows.verify.run import verify

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
    assert ("by another definition" in found.sentence) is (written.en_definition is None)
    other_en = [d for d in found.differences if d.place.endswith((".en", ".dof")) and d.rule != "rounding"]
    assert not any(d.matters for d in other_en)  # a score by another definition, degrees of freedom not written before
    assert found.digest == written.digest_state
    assert ("no digest" in found.sentence) is (written.digest is None)


# ---- verifications and audits ----------------------------------------------------------------------
@pytest.fixture(scope="module")
def judged(tmp_path_factory) -> dict[str, Path]:
    """The newest archived session verified and audited, by limits that are not the usual ones."""
    place = tmp_path_factory.mktemp("judged")
    folder = shutil.copytree(ARCHIVE / VERSIONS[-1] / "session", place / "session")
    file = Path(shutil.copy(ARCHIVE / VERSIONS[-1] / "calibration.json", place))
    session, record = load_session(folder), read_calibration(file)
    limits = Limits(level=0.9)
    bars = verify(session, "bars", calibration_of(record), rows_px=(40, 75), with_filters=False)
    command = {verb: ("fringecal", verb, str(folder), "--calibration", str(file)) for verb in ("verify", "audit")}
    audited = audit(session, calibration_of(record), record)
    used = CalibrationUsed.of(record, file)
    write_verification(verification_record(bars, session, used, command=command["verify"], limits=limits), place)
    write_audit(audit_record(audited, used, command=command["audit"], limits=limits), place)
    return {
        "verify": place / "verification.json",
        "audit": place / "audit.json",
        "session": folder,
        "calibration": file,
    }


@pytest.mark.parametrize("verb", ["verify", "audit"])
def test_a_judgement_is_repeated_to_the_last_digit(judged, verb):
    written, kind = read_record(judged[verb])
    assert kind.name == {"verify": "verification", "audit": "audit"}[verb]
    assert (session_folder(written), calibration_file(written)) == (judged["session"], judged["calibration"])
    found = rerun(written, judged["session"], calibration_file(written))
    assert found.identical, found.sentence
    assert found.fresh.limits.level == 0.9


@pytest.mark.parametrize("verb", ["verify", "audit"])
def test_another_calibration_or_session_file_is_named(judged, verb, tmp_path):
    written, _ = read_record(judged[verb])
    session = shutil.copytree(judged["session"], tmp_path / "s")
    with (session / "session.toml").open("a") as stream:
        stream.write("# a note\n")
    other = tmp_path / "calibration.json"
    other.write_text(judged["calibration"].read_text() + "\n")
    with pytest.raises(RecordError) as caught:
        rerun(written, session, other)
    assert [line.split(":")[0].strip() for line in str(caught.value).splitlines()[1:]] == [
        "session.toml",
        "calibration.json",
    ]
    with pytest.raises(RecordError, match="calibration.json: missing, .* --calibration"):
        rerun(written, judged["session"])


def test_a_calibration_that_was_replaced_is_found_where_it_is_kept(judged, tmp_path):
    written, _ = read_record(judged["audit"])
    session = shutil.copytree(judged["session"], tmp_path / "s")
    kept, file = read_calibration(judged["calibration"]), tmp_path / "out" / "calibration.json"
    file.parent.mkdir()
    shutil.copy(judged["calibration"], file)
    with result_folder(file.parent) as staging:
        write_calibration(kept.model_copy(update={"notes": ("made anew",)}), staging)
    with pytest.raises(RecordError) as caught:
        rerun(written, session, file)
    (named,) = re.findall(r"--calibration (\S+)", str(caught.value))
    assert Path(named).parent.name == "earlier"
    assert rerun(written, session, Path(named)).agrees


def test_a_judgement_that_names_no_calibration_asks_for_it(judged):
    written, _ = read_record(judged["audit"])
    with pytest.raises(RecordError, match="--calibration"):
        calibration_file(written.model_copy(update={"command": written.command[:3]}))
    assert calibration_file(read_calibration(judged["calibration"])) is None


def test_a_changed_number_of_an_audit_is_found(judged, tmp_path, capsys):
    document = json.loads(judged["audit"].read_text())
    change = document["changes"][0]
    change["value"] += change["u"] / 2
    (tmp_path / "audit.json").write_text(json.dumps(document))
    with pytest.raises(SystemExit) as stop:
        main(["rerun", str(tmp_path)])
    assert stop.value.code == 3
    assert "changes[0].value" in capsys.readouterr().out


# ---- records that form En by another definition --------------------------------------------------
def as_older(file, place, decision=None):
    """Write a verification as an older version did: without definition and degrees of freedom, En = mean / (2 u)."""
    document = json.loads(file.read_text())
    del document["en_definition"], document["digest"]
    for profile in (*document["profiles"], *document["profiles_with_edges"]):
        del profile["dof"]
        profile["en"] = profile["mean_mm"] / (2 * profile["u_mm"])
    for check in document["checks"]:
        if check.pop("score") == "En":
            check["value"] *= 1.96 / 2
            check["decision"] = decision or check["decision"]
    place.mkdir()
    (place / file.name).write_text(json.dumps(document))
    return place


def test_another_definition_of_en_is_named_and_is_no_difference(judged, tmp_path, capsys):
    """One outcome hangs on the definition: it is named, but nothing that is measured differs."""
    folder = as_older(judged["verify"], tmp_path / "older", decision="fail")
    with pytest.raises(SystemExit) as stop:
        main(["rerun", str(folder), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (stop.value.code, found["identical"], found["agrees"]) == (0, False, True)
    assert {d["place"].rpartition(".")[2] for d in found["differences"]} == {"en", "value", "decision"}
    assert all(d["by_definition_of_en"] for d in found["differences"])
    assert "by another definition (En = " in found["sentence"]
    assert "checks.mean error, profile A.decision (fail then, pass now)" in found["sentence"]


def test_a_change_of_what_en_is_formed_from_still_alarms(judged, tmp_path):
    file = as_older(judged["verify"], tmp_path / "older") / "verification.json"
    document = json.loads(file.read_text())
    document["profiles"][0]["mean_mm"] += document["profiles"][0]["u_mm"] / 10
    file.write_text(json.dumps(document))
    found = rerun(read_record(file)[0], judged["session"], judged["calibration"])
    assert not found.agrees
    assert [d.place for d in found.differences if d.matters] == ["profiles[0].mean_mm"]


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
        (("scale", "mean", "u"), lambda old, _: old * 10, None, True),
        (("distortion", "verdict"), lambda old, _: old + "!", None, True),
        (("projection", "theory"), lambda *_: None, None, True),
        (("rig", "residual_rms_rad"), lambda old, _: old * 1.001, None, True),
        (("rig", "residual_rms_rad"), lambda old, _: old * (1 + 1e-9), None, False),
        (("session", "rig"), lambda *_: "another", None, True),
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


def test_a_u_made_larger_in_the_record_is_seen_with_what_it_would_hide(newest):
    """Value and u edited together: by the larger u the value is the same, but the u is not."""
    then, now = document_of(newest), document_of(newest)
    mean = then["scale"]["mean"]
    mean["value"], mean["u"] = mean["value"] + mean["u"] / 2, 100 * mean["u"]
    found = {d.place: (d.rule, d.matters) for d in differences(then, now)}
    assert found == {"scale.mean.value": ("u", False), "scale.mean.u": ("rounding", True)}


def numbers_in(table, place=()):
    """Yield the way to every number of a document."""
    inside = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in inside:
        if isinstance(value, dict | list):
            yield from numbers_in(value, (*place, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*place, key)


def sizes_beside(document, place, table):
    """Return what a number may be small against: the u beside it, or of the parameters that it is about; 1e-10."""
    rig, camera = ([math.sqrt(row[n]) for n, row in enumerate(document[x]["covariance"])] for x in ("rig", "camera"))
    u, last = {"rig": rig, "camera": camera}.get(place[0], []), place[-1]
    if "parameters" in place:
        return u[last]
    if "covariance" in place:
        return u[place[-2]] * u[last] / 1000
    if "cross_covariance" in place:
        return rig[place[-2]] * camera[last] / 1000
    if "effect" in place:
        return math.sqrt(sum(mode["effect"][last] ** 2 for mode in document["rig"]["modes"])) / 10
    if last == "percent":
        return 0.1  # of 100
    if isinstance(table, dict):
        return max([table[key] for key in ("u", "u_deg") if isinstance(table.get(key), float)] + [1e-10])
    holder = document
    for key in place[:-2]:
        holder = holder[key]
    beside = {"projector_mm": "projector_u_mm", "estimated_rad": "u_rad"}.get(place[-2], "u")
    return holder[beside][last] if isinstance(holder, dict) and isinstance(holder.get(beside), list) else 0.0


def test_no_number_of_a_record_can_be_edited_unseen(newest):
    """Each by 5 % of itself, or of what it may be small against (covariance: a thousandth, effect: a tenth of u)."""
    then = document_of(newest)
    unseen, places = [], list(numbers_in(then))
    assert len(places) > 1500
    for place in places:
        now = copy.deepcopy({place[0]: then[place[0]]})
        table = now
        for key in place[:-1]:
            table = table[key]
        table[place[-1]] += 0.05 * max(abs(table[place[-1]]), sizes_beside(then, place, table)) or 1e-3
        if not any(d.matters for d in differences({place[0]: then[place[0]]}, now)):
            unseen.append(place)
    assert unseen == []


def test_three_numbers_that_were_certified_as_the_same(newest):
    """A rig parameter by 5 %, the projector a metre higher, the scale's u tenfold: each alone is another result."""
    then = document_of(newest)
    for place, edit in (
        (("rig", "parameters", 1), lambda x: 1.05 * x),
        (("rig", "projector_mm", 2), lambda x: x + 1000.0),
        (("scale", "mean", "u"), lambda x: 10 * x),
    ):
        now = document_of(newest)
        table = now
        for key in place[:-1]:
            table = table[key]
        table[place[-1]] = edit(table[place[-1]])
        assert [d.place for d in differences(then, now) if d.matters] != [], place


# ---- a record that was edited ----------------------------------------------------------------------
def edited(file, place, change):
    document = json.loads(file.read_text())
    change(document)
    place.mkdir()
    (place / file.name).write_text(json.dumps(document))
    return read_record(place / file.name)[0]


def test_an_edited_record_is_told_from_another_result(judged, tmp_path, capsys):
    """Words alone were edited: no result differs, but the record is not the one that was written."""
    written = edited(judged["audit"], tmp_path / "words", lambda d: d.update(sentence="nothing moved"))
    assert (read_record(judged["audit"])[0].digest_state, written.digest_state) == ("fits", "differs")
    with pytest.raises(SystemExit) as stop:
        main(["rerun", str(tmp_path / "words"), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (stop.value.code, found["agrees"], found["digest"]) == (3, True, "differs")
    assert "was edited after it was written" in found["sentence"]


def test_what_a_record_does_not_state_is_named_and_not_compared(newest):
    """A key that older versions did not know, and a table of one's own in which every key counts."""
    now, then = document_of(newest), document_of(newest)
    del then["projection"]["columns"][0]["apparent_deg"], then["budgets"]["scale.mean"]
    kept, unstated = stated_alone(now, then)
    assert unstated == ["projection.columns[0].apparent_deg"]
    assert [d.place for d in differences(then, kept) if d.matters] == ["budgets.scale.mean"]


def test_the_digest_is_that_of_the_content_and_not_of_the_layout(judged, tmp_path):
    """As docs/records.md has it: everything but the digest, keys sorted, without spaces, ASCII."""
    document = json.loads(judged["verify"].read_text())
    stated = document.pop("digest")
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    assert hashlib.sha256(text.encode()).hexdigest() == stated
    backwards = dict(reversed([*document.items(), ("digest", stated)]))
    (tmp_path / "verification.json").write_text(json.dumps(backwards, indent=7))
    assert read_record(tmp_path)[0].digest_state == "fits"
