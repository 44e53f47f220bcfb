import hashlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

from fringecal.errors import RecordError
from fringecal.records.files import EARLIER, replacing, result_folder, write_bytes, write_table, write_text
from fringecal.records.provenance import sha256_of


def names(folder):
    return sorted(file.name for file in folder.iterdir())


def test_text_is_utf8_with_one_kind_of_line_end(tmp_path):
    assert write_text(tmp_path / "deep" / "a.txt", "µm\n").read_bytes() == b"\xc2\xb5m\n"


def test_an_error_while_writing_keeps_the_old_file_and_leaves_nothing_else(tmp_path):
    path = write_text(tmp_path / "a.txt", "old")

    def break_off():
        with replacing(path) as sibling:
            sibling.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        break_off()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_the_sibling_keeps_the_suffix_and_the_folder(tmp_path):
    with replacing(tmp_path / "map.npz") as sibling:
        assert (sibling.parent, sibling.suffix) == (tmp_path, ".npz")
        sibling.write_bytes(b"1")
    assert names(tmp_path) == ["map.npz"]


def test_a_place_that_cannot_be_written_is_a_record_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        write_bytes(tmp_path / "file" / "below.bin", b"1")


def test_a_table_keeps_every_digit(tmp_path):
    frame = pd.DataFrame({"angle / deg": [np.pi, np.nan], "name": ["a,b", 'say "x"']})
    path = write_table(tmp_path / "t.csv", frame)
    assert path.read_text() == 'angle / deg,name\n3.141592653589793,"a,b"\n,"say ""x"""\n'


def test_what_a_killed_command_left_is_cleared_a_day_later(tmp_path):
    left, at_work, other = (tmp_path / f".{name}.partial" for name in ("out.1a", "out.2b", "outer.3c"))
    for folder in (left, at_work, other):
        folder.mkdir()
        (folder / "a.txt").write_text("gathered")
    for folder in (left, other):
        os.utime(folder, (time.time() - 25 * 3600,) * 2)
    with result_folder(tmp_path / "out") as staging:
        (staging / "b.txt").write_text("")
    assert names(tmp_path) == [".out.2b.partial", ".outer.3c.partial", "out"]


def test_a_new_folder_appears_whole(tmp_path):
    with result_folder(tmp_path / "out") as staging:
        (staging / "tables").mkdir()
        (staging / "tables" / "a.csv").write_text("1")
        (staging / "calibration.json").write_text("{}")
        assert not (tmp_path / "out").exists()
    assert names(tmp_path) == ["out"]
    assert names(tmp_path / "out") == ["calibration.json", "tables"]


def test_an_existing_folder_keeps_other_files_and_the_record_that_was_replaced(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "calibration.json").write_text("old")
    (out / "diary.txt").write_text("mine")
    with result_folder(out) as staging:
        (staging / "calibration.json").write_text("new")
        (staging / "z.csv").write_text("1")
    assert (out / "calibration.json").read_text() == "new"
    assert names(out) == ["calibration.json", "diary.txt", "earlier", "z.csv"]


def test_a_failed_job_leaves_the_folder_as_it_was(tmp_path):
    def break_off():
        with result_folder(tmp_path / "out") as staging:
            (staging / "a.csv").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        break_off()
    assert names(tmp_path) == []


def test_a_file_in_the_way_of_the_folder_is_named(tmp_path):
    (tmp_path / "out").write_text("I was here first")
    with pytest.raises(RecordError, match="found a file"), result_folder(tmp_path / "out"):
        pass
    assert names(tmp_path) == ["out"]


WRITER = """
import sys
from fringecal.records.files import write_text
from fringecal.records.provenance import sha256_of
sys.stdout.write("ready\\n"); sys.stdout.flush()
for number in range(10**9):
    write_text(sys.argv[1], (str(number % 10) * 200_000))
"""


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is a POSIX matter")
def test_killing_the_writer_at_any_moment_leaves_a_whole_file(tmp_path):
    path = tmp_path / "a.txt"
    rng = np.random.default_rng(20261122)
    for _ in range(5):
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
        writer.stdout.readline()
        while not path.exists():
            time.sleep(0.005)
        time.sleep(rng.uniform(0.01, 0.1))
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
        text = path.read_text()
        assert len(text) == 200_000
        assert len(set(text)) == 1


def test_hashes_are_those_of_the_standard_and_a_missing_file_is_refused(tmp_path):
    # FIPS 180-4 example: the message "abc".
    path = write_text(tmp_path / "abc.txt", "abc")
    assert sha256_of(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    with pytest.raises(RecordError, match="cannot be read"):
        sha256_of(tmp_path)


def test_a_replaced_record_is_kept_by_its_hash(tmp_path):
    for text in ("first", "second", "second"):
        with result_folder(tmp_path / "out") as staging:
            (staging / "calibration.json").write_text(text)
            (staging / "report.html").write_text(text)
    assert (tmp_path / "out" / "calibration.json").read_text() == "second"
    kept = {path.name: path.read_text() for path in (tmp_path / "out" / EARLIER).iterdir()}
    assert kept == {f"calibration-{hashlib.sha256(b'first').hexdigest()[:12]}.json": "first"}
