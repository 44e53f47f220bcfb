"""The desk of `fringecal serve`: nothing is written without the token, one run at a time, results by safe names."""

import io
import json
import re
import shutil
import sys
import time
from pathlib import Path

import pytest

from fringecal.history.entries import read_entry
from fringecal.history.store import open_history

flask = pytest.importorskip("flask", reason="the extra serve is not installed")

from werkzeug.datastructures import FileStorage  # noqa: E402 -- comes with Flask
from werkzeug.test import stream_encode_multipart  # noqa: E402

TOKEN = "secret-of-this-test"
ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*"))
# Stands in for the command: says its steps and writes the archived record, or waits to be stopped.
STAND_IN = f"""
import pathlib, shutil, sys, time
words = sys.argv[1:]
out = pathlib.Path(next(word for word in words if word.startswith("--out="))[6:])
pathlib.Path(out.parent, "words.txt").write_text("\\n".join(words))
print("  camera", flush=True)
if out.parent.parent.joinpath("wait").exists():
    out.with_name(".out.0.partial").mkdir()
    print("  waiting", flush=True)
    time.sleep(60)
out.mkdir()
shutil.copy({str(ARCHIVE / "calibration.json")!r}, out)
out.joinpath("report.html").write_text("<script>1</script>")
print("PASS <b>&", flush=True)
"""


@pytest.fixture
def desk(tmp_path):
    from fringecal.serve.desk import Desk
    from fringecal.serve.runs import Runs
    from fringecal.serve.uploads import Bounds

    with open_history(tmp_path / "history.db") as history:
        history.append([])
    work = tmp_path / "work"
    work.mkdir()
    script = tmp_path / "command.py"
    script.write_text(STAND_IN, encoding="utf-8")
    runs = Runs(work, (sys.executable, "-S", str(script)))
    made = Desk(str(tmp_path / "history.db"), work, TOKEN, runs, root=tmp_path / "root", bounds=Bounds(30, 5))
    yield made
    runs.close()


@pytest.fixture
def app(desk):
    from fringecal.cli.serve import dashboard

    return dashboard(desk.db, desk=desk)


@pytest.fixture
def client(app):
    """A reader who opened the printed address."""
    client = app.test_client()
    answer = client.get(f"/?token={TOKEN}")
    assert answer.status_code == 302
    assert answer.headers["Location"] == "/"
    assert {"HttpOnly", "SameSite=Strict"} <= set(answer.headers["Set-Cookie"].split("; "))
    return client


@pytest.fixture(scope="session")
def pictures(data):
    """Files of the oblique session as a browser names them."""
    files = [file for file in sorted((data / "oblique").iterdir()) if file.suffix in (".toml", ".png")]
    return {f"oblique/{file.name}": file.read_bytes() for file in files}


def sent(files, token=TOKEN):
    """An upload's body; the client's own encoder would leave a temporary file open."""
    stream, length, boundary = stream_encode_multipart(
        {"token": token, "files": [FileStorage(io.BytesIO(content), name) for name, content in files.items()]},
        threshold=10**8,
    )
    return {"data": stream.read(length), "content_type": f"multipart/form-data; boundary={boundary}"}


def opened(client, pictures) -> str:
    answer = client.post("/sessions", **sent(pictures))
    assert answer.status_code == 303, answer.text
    return answer.headers["Location"]


def ended(desk, key) -> None:
    run = desk.runs.named(key)
    with run.changed:
        assert run.changed.wait_for(lambda: run.code is not None, 30)


def printed(desk, key, line) -> None:
    run = desk.runs.named(key)
    with run.changed:
        assert run.changed.wait_for(lambda: line in run.lines, 30)


# ---- nothing without the token, nothing for other sites --------------------------------------------
@pytest.mark.parametrize(
    ("headers", "token"),
    [
        ({}, None),
        ({}, "wrong"),
        ({}, "wröng"),
        ({"X-Fringecal-Token": "wrong"}, TOKEN),
        ({"Origin": "http://evil.example"}, TOKEN),
        ({"Origin": "null"}, TOKEN),
        ({"Origin": "http://localhost:1"}, TOKEN),
        ({"Sec-Fetch-Site": "cross-site"}, TOKEN),
        ({"Sec-Fetch-Site": "same-site"}, TOKEN),
        ({"Host": "evil.example"}, TOKEN),
    ],
)
def test_no_write_without_the_token_or_from_elsewhere(client, desk, headers, token):
    for place in ("/sessions", "/sessions/open", "/sessions/x/run", "/runs/x/stop", "/", "/none"):
        answer = client.post(place, data={} if token is None else {"token": token}, headers=headers)
        assert answer.status_code == 403, place
        assert "Not available" in answer.text
    assert list(desk.work.iterdir()) == []


def test_a_stranger_with_the_form_but_not_the_cookie_writes_nothing(app, desk, pictures):
    stranger = app.test_client()
    assert stranger.post("/sessions", **sent(pictures)).status_code == 403
    assert list(desk.work.iterdir()) == []


def test_a_program_brings_the_token_in_a_header(app, pictures):
    program, token = app.test_client(), {"X-Fringecal-Token": TOKEN}
    answer = program.post("/sessions", **sent(pictures, ""), headers=token | {"Accept": "application/json"})
    assert answer.status_code == 201
    assert re.fullmatch(r"/sessions/[0-9a-f]{16}", answer.json["location"])
    assert "may be used" in program.get(answer.json["location"], headers=token).text
    assert program.get(answer.json["location"]).status_code == 403


def test_pages_of_the_desk_are_for_holders_of_the_token(app, client):
    stranger = app.test_client()
    for place in ("/sessions", "/sessions/x", "/runs/x", "/runs/x/progress", "/runs/x/files/a"):
        assert stranger.get(place).status_code == 403
        assert stranger.get(f"{place}?token=wrong").status_code == 403
        assert client.get(place).status_code == (200 if place == "/sessions" else 404)


def test_every_other_way_of_writing_is_refused(client):
    for method in ("put", "delete", "patch"):
        assert getattr(client, method)("/sessions").status_code == 403
        assert getattr(client, method)("/sessions", headers={"X-Fringecal-Token": TOKEN}).status_code == 405


def test_the_desk_is_shut_where_others_can_reach_the_page(desk):
    from fringecal.cli.serve import dashboard

    client = dashboard(desk.db, "0.0.0.0").test_client()
    assert "/sessions" not in client.get("/").text
    assert client.get("/sessions").status_code == 404
    assert client.post("/sessions", headers={"X-Fringecal-Token": TOKEN}).status_code == 403


# ---- uploads ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("extra", "code", "words"),
    [
        ({"oblique/../../a.png": b""}, 400, "plain names"),
        ({"/etc/a.png": b""}, 400, "plain names"),
        ({"oblique/run.sh": b""}, 415, "no file that sessions use"),
        ({f"oblique/{k}.png": b"" for k in range(30)}, 413, "at most 30"),
        ({"oblique/large.png": bytes(4 * 10**6)}, 413, "most-megabytes"),
        ({"oblique/large.png": bytes(7 * 10**6)}, 413, "most-megabytes"),
    ],
)
def test_refused_uploads_leave_nothing(client, desk, pictures, extra, code, words):
    answer = client.post("/sessions", **sent(pictures | extra))
    assert answer.status_code == code
    assert words in answer.text
    assert list(desk.work.iterdir()) == []
    assert desk.opened == {}


def test_a_session_is_checked_and_every_fault_has_its_remedy(client, pictures):
    good = client.get(opened(client, pictures))
    assert "The session may be used." in good.text
    assert re.findall(r"<th scope=row>(\w+)</th>", good.text) == ["grid", "reference", "strips", "bars"]
    assert "Run commission" in good.text
    assert "Run audit" not in good.text  # no calibration of this rig
    broken = {name: content for name, content in pictures.items() if not name.endswith(("strips-1.png", "t-grid.toml"))}
    bad = client.get(opened(client, broken | {"oblique/grid.png": pictures["oblique/grid.png"][:5000]}))
    assert "The session cannot be used yet." in bad.text
    assert "truncated PNG" in bad.text
    assert "did you mean" in bad.text
    assert len(re.findall(r"<th scope=row>", bad.text)) >= 3  # each of the three faults
    assert "Run commission" not in bad.text
    key = re.search(r"sessions/(\w+)", bad.request.path)[1]
    answer = client.post(f"/sessions/{key}/run", data={"token": TOKEN, "verb": "commission"})
    assert answer.status_code == 409


def test_nonsense_is_a_fault_and_not_an_error(client):
    for text in (b"", b"\xff\xfe", b"format = 1\n[[", b"<script>alert(1)</script>"):
        page = client.get(opened(client, {"a/session.toml": text}))
        assert page.status_code == 200
        assert "cannot be used yet" in page.text
        assert "<script>alert" not in page.text


def test_folders_of_this_machine_are_opened_by_the_names_offered(client, desk, pictures, tmp_path):
    folder = desk.root / "2026" / "oblique"
    folder.mkdir(parents=True)
    for name, content in pictures.items():
        (folder / Path(name).name).write_bytes(content)
    shutil.copytree(folder, tmp_path / "outside")
    (desk.root / "link").symlink_to(tmp_path / "outside")
    assert re.findall(r"<option>(.*?)</option>", client.get("/sessions").text) == ["2026/oblique"]
    answer = client.post("/sessions/open", data={"token": TOKEN, "folder": "2026/oblique"})
    assert "may be used" in client.get(answer.headers["Location"]).text
    for name in ("link", "../outside", str(tmp_path / "outside"), "", "2026"):
        assert client.post("/sessions/open", data={"token": TOKEN, "folder": name}).status_code == 404


# ---- runs ------------------------------------------------------------------------------------------
@pytest.fixture
def session(client, pictures):
    return opened(client, pictures)


def start(client, session, **fields):
    return client.post(f"{session}/run", data={"token": TOKEN, "verb": "commission"} | fields)


def test_a_run_shows_its_steps_and_ends_with_the_verdict(client, desk, session):
    place = start(client, session, history="yes").headers["Location"]
    key = place.rpartition("/")[2]
    events = client.get(f"{place}/progress?from=0").text
    said = [json.loads(line[6:]) for line in events.splitlines() if line.startswith('data: "')]
    assert said == ["  camera", "PASS <b>&"]
    assert events.endswith("event: end\ndata: 0\n\n")
    again = client.get(f"{place}/progress?from=0", headers={"Last-Event-ID": "0"}).text  # a connection that broke
    assert "PASS" in again
    assert "camera" not in again
    page = client.get(place).text
    verdict = read_entry(ARCHIVE / "calibration.json").decision
    assert f'class="verdict {verdict}"' in page
    assert "PASS &lt;b&gt;&amp;" in page
    assert "<script" not in page
    folder = desk.runs.named(key).folder
    uploaded = desk.opened[session.rpartition("/")[2]].folder
    words = (folder / "words.txt").read_text(encoding="utf-8").split("\n")
    assert words == ["commission", str(uploaded), f"--out={folder / 'out'}", f"--history={desk.db}"]


def test_results_are_had_from_below_the_output_alone(client, desk, session):
    place = start(client, session).headers["Location"]
    ended(desk, place.rpartition("/")[2])
    report = client.get(f"{place}/files/report.html")
    assert report.status_code == 200
    policy = report.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts allow-downloads; default-src 'none'")
    assert "allow-same-origin" not in policy
    record = client.get(f"{place}/files/calibration.json")
    assert record.data == (ARCHIVE / "calibration.json").read_bytes()
    assert record.headers["Content-Disposition"].startswith("attachment")
    for answer in (report, record):
        answer.close()
    up = ("../words.txt", "..%2Fwords.txt", "%2e%2e/words.txt", "../../../history.db")
    for name in (*up, "/etc/passwd", "none", ""):
        assert client.get(f"{place}/files/{name}").status_code == 404, name


def test_one_run_at_a_time_and_a_stopped_one_leaves_nothing(client, desk, session):
    (desk.work / "wait").touch()
    place = start(client, session).headers["Location"]
    printed(desk, place.rpartition("/")[2], "  waiting")
    page = client.get(place).text
    assert '<meta http-equiv="refresh"' in page  # without script
    assert f"{place}/progress?from=2" in page
    second = start(client, session)
    assert second.status_code == 409
    assert "wait for its end, or stop it" in second.text
    began = time.monotonic()
    assert client.post(f"{place}/stop", data={"token": TOKEN}).status_code == 303
    assert time.monotonic() - began < 30  # it sleeps for 60 s
    assert "Stopped; nothing was written." in client.get(place).text
    run = desk.runs.named(place.rpartition("/")[2])
    assert [file.name for file in run.folder.iterdir()] == ["words.txt"]
    assert run.process.poll() is not None
    (desk.work / "wait").unlink()
    assert start(client, session).status_code == 303


def test_an_audit_takes_a_calibration_of_its_own_rig(client, desk, session, tmp_path):
    document = json.loads((ARCHIVE / "calibration.json").read_text(encoding="utf-8"))
    records = []
    for rig in ("oblique", "another"):
        document["session"]["rig"] = rig
        file = tmp_path / f"{rig}.json"
        file.write_text(json.dumps(document), encoding="utf-8")
        records.append(read_entry(file))
    with open_history(desk.db) as history:
        history.append(records)
    offered = re.findall(r'<option value="(.*?)">', client.get(session).text)
    assert offered == [f"record-{records[0].sha256}"] * 2  # for verify and for audit
    for wrong in (f"record-{records[1].sha256}", "record-none", "run-none", "", "../../etc/passwd"):
        assert start(client, session, verb="audit", calibration=wrong).status_code == 400
    place = start(client, session, verb="audit", calibration=offered[0]).headers["Location"]
    ended(desk, place.rpartition("/")[2])
    folder = desk.runs.named(place.rpartition("/")[2]).folder
    assert (folder / "calibration.json").read_bytes() == (tmp_path / "oblique.json").read_bytes()
    assert f"--calibration={folder / 'calibration.json'}" in (folder / "words.txt").read_text(encoding="utf-8")


def test_what_was_not_offered_is_not_run(client, desk, session):
    for fields in ({"verb": "rm"}, {"verb": "--help"}, {"verb": ""}, {"capture": "none"}, {"capture": "--out=/"}):
        assert start(client, session, **fields).status_code == 400
    assert desk.runs.newest_first() == ()


def test_a_command_that_fails_says_so(client, desk, session, tmp_path):
    (tmp_path / "command.py").write_text("print('error: no grid found'); raise SystemExit(1)")
    place = start(client, session).headers["Location"]
    ended(desk, place.rpartition("/")[2])
    page = client.get(place).text
    assert "exit code 1: no results" in page
    assert "error: no grid found" in page
    assert "files/" not in page
