"""`fringecal serve`: pages of a history, under its own name."""

import html
import json
import re
import threading
import urllib.request
from pathlib import Path

import pytest

from fringecal.errors import FringecalError
from fringecal.history.entries import Entry, Reading, read_entry
from fringecal.history.store import open_history

flask = pytest.importorskip("flask", reason="the extra serve is not installed")

ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*")) / "calibration.json"
NASTY = "<b>rig</b>/../2 & more"


def entry(number: int, rig: str, kind: str, decision: str = "pass") -> Entry:
    day = f"2026-{1 + number:02d}-01T08:00:00+00:00"
    readings = (Reading("scale, mean", 0.734 + 1e-5 * (0, 2, 1, 1, 2, 0)[number % 6], "mm/px", 1e-5),)
    return Entry(rig, kind, day, day, f"{number:064x}", decision, readings, document=f'{{"number": {number}}}')


@pytest.fixture
def db(tmp_path):
    path = tmp_path / "history.db"
    with open_history(path) as history:
        kinds = ("calibration", "audit", "verification", "audit", "audit", "audit")
        history.append([entry(number, "bench-1", kind) for number, kind in enumerate(kinds)])
        history.append([entry(8, NASTY, "audit", "fail")])
    return str(path)


@pytest.fixture
def client(db):
    from fringecal.cli.serve import dashboard

    return dashboard(db).test_client()


def facts_of(card: str) -> dict[str, str]:
    """What a rig's card says, without its links."""
    pairs = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", card, flags=re.DOTALL)
    return {name: re.sub("<.*?>", "", text) for name, text in pairs}


def test_rigs_with_how_they_stand_the_worst_first(client):
    page = client.get("/")
    assert page.status_code == 200
    failed, bench = re.findall(r'<section class="verdict.*?</section>', page.text, flags=re.DOTALL)
    assert "Last record failed" in failed
    assert 'class="verdict fail"' in failed
    assert "bench-1" in bench
    assert "In control" in bench
    assert facts_of(bench) == {
        "Out": "nothing",
        "Alarm": "none",
        "Trend": "steady",
        "Due": "not enough to say",  # of a scale no limit is known
        "Last audit": "2026-06-01 08:00, pass",
        "Last calibration": "2026-01-01 08:00, pass",
        "Records": "6",
    }
    assert "<b>rig" not in page.text


def test_a_rig_out_of_its_limit_and_one_overdue(tmp_path):
    """Eight audits of a change with a limit of 0.3 %: the last at 0.41 %; and eight small ones, long ago."""
    from fringecal.cli.serve import dashboard

    scatter = (0.02, -0.01, 0.0, 0.01, -0.02, 0.01, 0.0)
    with open_history(tmp_path / "out.db") as history:
        for rig, last in (("out", 0.41), ("old", -0.01)):
            for month, change in enumerate((*scatter, last), start=1):
                day = f"2024-{month:02d}-01T08:00:00+00:00"
                reading = Reading("change of height scale", change, "%", 0.02, en=change / 0.04, limit=0.3)
                number = f"{month + 100 * (rig == 'old'):064x}"
                history.append([Entry(rig, "audit", day, day, number, "pass", (reading,))])
    page = dashboard(str(tmp_path / "out.db")).test_client().get("/").text
    out, old = re.findall(r'<section class="verdict.*?</section>', page, flags=re.DOTALL)
    assert "Out of its limit" in out
    assert "+0.410 % at the last record, limit 0.3 %" in facts_of(out)["Out"]
    assert facts_of(out)["Due"] == "now, by change of height scale"
    assert "EWMA" in facts_of(out)["Alarm"] or "individuals" in facts_of(out)["Alarm"]
    assert "Overdue" in old
    assert facts_of(old)["Due"].startswith("overdue since 20")


def test_every_link_of_every_page_leads_somewhere(client):
    seen, todo = set(), ["/"]
    while todo:
        place = todo.pop()
        page = client.get(place)
        assert page.status_code == 200, place
        seen.add(place)
        if page.mimetype == "text/html":
            found = {html.unescape(link) for link in re.findall(r'href="(/[^"]*)"', page.text)}
            todo += sorted(found - seen - set(todo))
    assert f"/record/{1:064x}" in seen
    assert "/report?name=bench-1" in seen
    assert f"/record/{1:064x}.json" in seen
    assert client.get(f"/record/{1:064x}.json").json == {"number": 1}


@pytest.fixture
def calibrations(tmp_path):
    """A history with two calibrations of one rig, the second with a scale larger by 0.2 %, and another rig's."""
    made = []
    for number, rig in enumerate(("thesis", "thesis", "another")):
        document = json.loads(ARCHIVE.read_text(encoding="utf-8"))
        document["session"].update(rig=rig, captured=f"2026-0{1 + number}-01T08:00:00Z")
        document["camera"]["parameters"][0] *= 1.002**number
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        made.append(read_entry(path))
    with open_history(tmp_path / "two.db") as history:
        history.append(made)
    return str(tmp_path / "two.db"), [one.sha256 for one in made]


@pytest.fixture
def choosing(calibrations):
    from fringecal.cli.serve import dashboard

    return dashboard(calibrations[0]).test_client(), calibrations[1]


def test_two_calibrations_are_chosen_on_the_rigs_page(choosing):
    client, (first, second, _) = choosing
    page = client.get("/rig?name=thesis").text
    assert re.findall(r'<option value="(\w+)"( selected)?>', page) == [
        (second, ""), (first, " selected"), (second, " selected"), (first, "")
    ]  # fmt: skip
    assert '<form action="/compare" method="get">' in page
    record = client.get(f"/record/{first}")
    assert record.mimetype == "text/html"
    checks = json.loads(ARCHIVE.read_text(encoding="utf-8"))["checks"]
    assert all(html.escape(check["name"], quote=False) in record.text for check in checks)
    outcomes = re.findall(r'<tr class="(\w+)">', record.text)
    worst = ("fail", "conditionalFail", "conditionalPass", "info", "pass")
    assert outcomes == sorted((check["decision"] for check in checks), key=worst.index)
    assert "projection angle" in record.text
    assert "<form" not in client.get("/rig?name=another").text  # one calibration has nothing beside it


def test_two_calibrations_beside_each_other(choosing):
    client, (first, second, _) = choosing
    page = client.get(f"/compare?first={first}&second={second}")
    assert page.status_code == 200
    assert "First: 2026-01-01 08:00; second: 2026-02-01 08:00" in page.text
    assert "scale, horizontal (En +" in page.text
    assert page.text.count("<figure") == 3  # En by quantity, and both rigs
    assert "<script" not in page.text
    policy = page.headers["Content-Security-Policy"]
    assert "form-action 'self'" in policy
    assert "script-src" not in policy


@pytest.mark.parametrize("query", ["", "?first={0}", "?first={0}&second=none", "?first=../../etc/passwd&second={0}"])
def test_a_comparison_needs_two_records(choosing, query):
    client, hashes = choosing
    assert client.get("/compare" + query.format(*hashes)).status_code == 404


def test_what_cannot_be_compared_says_why(choosing, client):
    other, (first, _, another) = choosing
    page = other.get(f"/compare?first={first}&second={another}")
    assert page.status_code == 400
    assert "one rig were needed, found those of thesis and another" in page.text
    page = client.get(f"/compare?first={0:064x}&second={1:064x}")  # documents of no format at all
    assert page.status_code == 400
    assert "record 000000000000: format is None" in html.unescape(page.text)


@pytest.mark.parametrize(
    "place", ["/rig?name=none", "/rig", "/record/none", "/report?name=none", "/etc/passwd", "/../../etc/passwd"]
)
def test_what_is_not_there_is_not_found(client, place):
    page = client.get(place)
    assert page.status_code == 404
    assert "Not available" in page.text


@pytest.mark.parametrize("method", ["post", "put", "delete", "patch"])
def test_nothing_can_be_written(client, method):
    assert getattr(client, method)("/").status_code == 403
    assert getattr(client, method)("/rig?name=bench-1", data=b"x" * 1000).status_code == 403


def test_pages_run_no_script_and_answer_to_their_own_name_only(client):
    page = client.get("/")
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]
    assert client.get("/", headers={"Host": "evil.example:8050"}).status_code == 403
    assert client.get("/", headers={"Host": "[::1]:8050"}).status_code == 200


def test_a_history_that_is_not_there_is_refused(run, tmp_path):
    outcome = run("serve", "--db", tmp_path / "none.db")
    assert outcome.code == 1
    assert "there is no history" in outcome.stderr


def test_it_listens_on_this_machine(db, monkeypatch, capsys):
    """The verb itself, with a real request; another server on the same port is refused."""
    from fringecal.cli import serve

    made, ready = [], threading.Event()
    make_server = serve.web_server

    def remembered(*arguments, **options):
        made.append(make_server(*arguments, **options))
        ready.set()
        return made[-1]

    monkeypatch.setattr(serve, "web_server", remembered)
    stated = {"db": db, "host": "127.0.0.1", "sessions": None, "work": None, "most_files": 2, "most_megabytes": 1}
    thread = threading.Thread(target=serve.serve, kwargs=stated | {"port": 0, "as_json": True}, daemon=True)
    thread.start()
    assert ready.wait(30)
    port = made[0].effective_port
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as answer:
        assert b"bench-1" in answer.read()
    monkeypatch.undo()
    with pytest.raises(FringecalError, match="another --port"):
        serve.serve(**stated, port=port, as_json=True)
    made[0].end()
    thread.join(30)
    assert not thread.is_alive()
    printed = json.loads(capsys.readouterr().out)["address"]
    assert re.fullmatch(rf"http://127\.0\.0\.1:{port}/\?token=[\w-]{{40,}}", printed)


def test_a_rigs_report_may_run_its_own_script(tmp_path):
    from fringecal.cli.serve import dashboard

    days = [f"2026-01-{day:02}T08:00:00+00:00" for day in range(1, 12)]
    entries = []
    for k, day in enumerate(days):
        readings = tuple(Reading(f"quantity {n}", k + n / 8, "mm", 0.01) for n in range(12))
        entries.append(Entry("bench-1", "audit", day, day, f"{k:064x}", "pass", readings))
    with open_history(tmp_path / "charts.db") as history:
        history.append(entries)
    answer = dashboard(str(tmp_path / "charts.db")).test_client().get("/report?name=bench-1")
    assert "<script" in answer.text  # a long report folds its sections
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts")
    assert "script-src 'unsafe-inline'" in policy
    assert "allow-same-origin" not in policy  # it is of no site, and can ask for nothing
    assert "connect-src" not in policy
