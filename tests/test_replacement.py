"""Folders replaced in one step: whole before and after, others' files kept, leftovers told by their owner."""

import contextlib
import hashlib
import importlib.util
import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from fringecal import replacement
from fringecal.errors import RecordError
from fringecal.records.files import EARLIER, result_folder
from fringecal.replacement import ABANDONED_S, Owner, hidden_beside, put_in_place, settle, signals_deferred

CAMPAIGN = Path(__file__).parents[1] / "benchmarks" / "kills.py"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and folders of another kind")
NOBODY = Owner(replacement._host(), replacement._boot(), os.getpid(), "1")  # this number, but begun at another time


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def gathered(folder, files):
    staging = hidden_beside(folder)
    for name, text in files.items():
        (staging / name).parent.mkdir(parents=True, exist_ok=True)
        (staging / name).write_text(text)
    return staging


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "out"
    (folder / "mine").mkdir(parents=True)
    (folder / "mine" / "diary.txt").write_text("mine")
    (folder / "r.json").write_text("old")
    (folder / "link").symlink_to("r.json")
    return folder


def by_exchange(monkeypatch, out):
    pass


def by_moves(monkeypatch, out):
    monkeypatch.setattr(replacement, "_exchange_call", lambda: None)


def in_its_folder(monkeypatch, out):
    monkeypatch.chdir(out / "mine")


@pytest.mark.parametrize("way", [by_exchange, by_moves, in_its_folder])
def test_others_files_stay_and_nothing_hidden_is_left(out, monkeypatch, way):
    way(monkeypatch, out)
    out.chmod(0o751)
    put_in_place(gathered(out, {"r.json": "new", "figures/a.svg": "new"}), out, keep_others=True)
    assert content(out) == {"r.json": "new", "figures/a.svg": "new", "mine/diary.txt": "mine", "link": "new"}
    assert (out / "link").is_symlink()
    assert out.stat().st_mode & 0o777 == 0o751
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("way", [by_exchange, by_moves])
def test_a_folder_that_is_replaced_as_a_whole_keeps_nothing(out, monkeypatch, way):
    way(monkeypatch, out)
    put_in_place(gathered(out, {"a": "new"}), out, keep_others=False)
    assert content(out) == {"a": "new"}
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("way", [by_exchange, by_moves])
@pytest.mark.parametrize("name", ["mine", "r.json/a", "mine/diary.txt/a"])
def test_what_stands_in_the_way_is_named_and_stays(out, monkeypatch, way, name):
    """A file for somebody's folder, and folders for files."""
    way(monkeypatch, out)
    before = content(out)

    def write():
        with result_folder(out, last="r.json") as staging:
            (staging / name).parent.mkdir(parents=True, exist_ok=True)
            (staging / name).write_text("new")

    with pytest.raises(RecordError, match="stands in the way"):
        write()
    assert content(out) == before
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_the_exchange_is_one_step(out, monkeypatch):
    """Whoever looks between any two calls of the system finds all old or all new: here at the exchange itself."""
    seen = []
    call = replacement._exchange_call()
    if call is None:
        pytest.skip("no such call here")

    def watched(one, other):
        seen.append(content(out))
        result = call(one, other)
        seen.append(content(out))
        return result

    monkeypatch.setattr(replacement, "_exchange_call", lambda: watched)
    put_in_place(gathered(out, {"r.json": "new", "b": "new"}), out, keep_others=True)
    old = {"r.json": "old", "mine/diary.txt": "mine", "link": "old"}
    assert seen == [old, {"r.json": "new", "b": "new", "mine/diary.txt": "mine", "link": "new"}]


def test_moves_that_were_broken_off_are_completed_by_the_next_command(out, monkeypatch):
    monkeypatch.setattr(Owner, "of_this_process", classmethod(lambda _: NOBODY))
    half = gathered(out, {"r.json": "new", "b/c": "new"})
    half.rename(half.with_name(half.name.removesuffix("partial") + "moving"))
    settle(out)
    assert content(out) == {"r.json": "new", "b/c": "new", "mine/diary.txt": "mine", "link": "new"}
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_what_is_at_work_stays_and_what_was_left_goes_at_once(out, monkeypatch):
    at_work = gathered(out, {"a": "1"})
    monkeypatch.setattr(Owner, "of_this_process", classmethod(lambda _: NOBODY))
    left = gathered(out, {"a": "2"})
    of_another = gathered(out.with_name("out.b"), {"a": "3"})
    elsewhere = Owner("0" * 8, NOBODY.boot, 1, "1")
    monkeypatch.setattr(Owner, "of_this_process", classmethod(lambda _: elsewhere))
    unseen, unseen_and_old = gathered(out, {"a": "4"}), gathered(out, {"a": "5"})
    os.utime(unseen_and_old, (time.time() - ABANDONED_S - 60,) * 2)
    settle(out)
    assert {path.exists(): path for path in (left, unseen_and_old)}.keys() == {False}
    assert {path.exists(): path for path in (at_work, of_another, unseen)}.keys() == {True}


def test_a_boot_ago_every_process_has_ended():
    assert Owner(NOBODY.host, "0" * 8, os.getpid(), replacement._began(os.getpid())).is_gone
    assert not Owner.of_this_process().is_gone
    assert Owner.parsed(str(NOBODY)) == NOBODY
    assert Owner.parsed("1a2b3c4d") is None


@pytest.fixture
def heard():
    """Ctrl-C is heard, also where whatever runs the tests ignores it, as a shell does for what runs beside it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_signals_wait_until_the_step_is_done(heard):
    steps = []

    def step():
        with signals_deferred():
            signal.raise_signal(signal.SIGINT)
            steps.append("done")

    with pytest.raises(KeyboardInterrupt):
        step()
    assert steps == ["done"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_link_to_a_folder_stays_a_link(out, tmp_path):
    (tmp_path / "named").symlink_to(out)
    with result_folder(tmp_path / "named") as staging:
        (staging / "r.json").write_text("new")
    assert (tmp_path / "named").is_symlink()
    assert (out / "r.json").read_text() == "new"


def replace_often(out, number):
    for k in range(10):
        with result_folder(out, last="r.json") as staging:
            (staging / "r.json").write_text(f"{number}-{k}")
            (staging / f"{number}.txt").write_text(f"{number}-{k}")


def test_commands_at_the_same_time_lose_none_of_each_others_records(tmp_path):
    """Every record that stood there is found by its hash, and each command's own files are its last."""
    out = tmp_path / "out"
    workers = [multiprocessing.get_context("fork").Process(target=replace_often, args=(out, n)) for n in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    assert [worker.exitcode for worker in workers] == [0, 0, 0]
    texts = [f"{number}-{k}" for number in range(3) for k in range(10)]
    kept = {path.name for path in (out / EARLIER).iterdir()} | {f"r-{short((out / 'r.json').read_text())}.json"}
    assert kept == {f"r-{short(text)}.json" for text in texts}
    assert {(out / f"{number}.txt").read_text() for number in range(3)} == {f"{number}-9" for number in range(3)}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def short(text):
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def test_kills_leave_results_of_one_run(tmp_path):
    """A few trials of the campaign in `benchmarks`, in either way of replacing."""
    spec = importlib.util.spec_from_file_location("kills", CAMPAIGN)
    campaign = importlib.util.module_from_spec(spec)
    sys.modules["kills"] = campaign
    spec.loader.exec_module(campaign)
    for inside in (False, True):
        bench = campaign.prepared(tmp_path / str(inside), inside=inside)
        campaign.write_over_and_over(bench.out, 0, 1)
        with contextlib.suppress(KeyboardInterrupt):
            outcomes, broken = campaign.trials(campaign.writer_trial, bench, 4, 20_000)
        assert broken == []
        assert outcomes.total() == 4
