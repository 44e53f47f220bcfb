"""Text files within their limits: what is beyond one is refused with a sentence, and nothing is waited for."""

import json
import os

import pytest

from fringecal.errors import FringecalError, RecordError, TargetError
from fringecal.guarded import MIB, MOST_DEPTH, MOST_DIGITS, Refusal, bytes_of, is_file, json_of, lies_inside, toml_of
from fringecal.records.kinds_of_record import read_record
from fringecal.records.limits import read_limits
from fringecal.records.parts import is_covariance
from fringecal.session import check_session
from fringecal.session.toml_text import to_toml
from fringecal.simulate import load_rig
from fringecal.targets import load_target


def nested(levels):
    """A document of so many tables in one another."""
    return json.dumps(0) if levels == 0 else f'{{"a": {nested(levels - 1)}}}'


def test_levels_are_read_up_to_the_limit():
    assert json_of(nested(MOST_DEPTH - 1))
    for levels in (MOST_DEPTH + 1, 900, 100_000):
        text = '{"a": ' * levels + "0" + "}" * levels
        with pytest.raises(Refusal, match=f"deeper than the {MOST_DEPTH} levels"):
            json_of(text)
    with pytest.raises(Refusal, match="deeper"):
        toml_of(".".join("a" * 5000) + " = 1")  # dotted keys nest without recursion
    with pytest.raises(Refusal, match="deeper"):
        toml_of("a = " + "[" * 5000)


def test_a_number_beyond_64_bits_is_refused():
    """The largest double is 1.798e308; what is written larger would be read as infinite, which no record may hold."""
    assert json_of('{"a": [1.7e308, -1.7E+308, 1e-400]}')["a"][2] == 0
    for text in ("1e999", "-1e309", "1" + "0" * 309 + ".0"):
        with pytest.raises(Refusal, match="beyond those of 64 bits"):
            json_of(f'{{"a": [{text}]}}')


@pytest.mark.parametrize("read", [json_of, toml_of])
def test_digits_are_read_up_to_the_limit(read):
    def stated(number):
        return f'{{"a": {number}}}' if read is json_of else f"a = {number}"

    for sign in ("", "-"):
        whole = sign + "9" * MOST_DIGITS
        assert read(stated(whole)) == {"a": int(whole)}
        for more in ("1" + "0" * MOST_DIGITS, "9" * 5000):
            with pytest.raises(Refusal, match=f"{MOST_DIGITS} digits"):
                read(stated(sign + more))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "a": 2}', "key 'a' twice"),
        ('{"a": NaN}', "NaN is not a JSON number"),
        ("3", "no JSON object"),
        ('{"a": 1', "not a JSON document"),
    ],
)
def test_json_that_says_two_things_or_nothing_is_refused(text, words):
    with pytest.raises(Refusal, match=words):
        json_of(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("".join(f"k{n} = 1\n" for n in range(30_000)), "20000 keys"),
        ("[[a]]\n" * 3000, "2000 tables"),
        ("[a]\n" + "".join(f"[a.b{n}]\n" for n in range(3000)), "2000 tables"),
        ("a = [" + "1," * 100_001 + "]", "100000 entries"),
    ],
)
def test_a_document_of_more_parts_than_any_has_is_refused(text, words):
    with pytest.raises(Refusal, match=words):
        toml_of(text)


def test_of_many_faults_the_first_are_named(tmp_path):
    """As many unknown keys, or wrong entries of a list, as are read: few words, and soon."""
    keys = "".join(f"k{n} = 1\n" for n in range(19_000))
    entries = f"[[capture]]\nname = 'g'\nkind = 'grid'\nimages = [{'1,' * 90_000}]\n"
    for text in (keys, entries):
        (tmp_path / "session.toml").write_text(f"format = 1\n{text}")
        assert len(check_session(tmp_path).faults) < 110
        (tmp_path / "t.toml").write_text(f"format = 1\n{text}")
        for read in (load_target, load_rig, read_limits):
            with pytest.raises(FringecalError) as refused:
                read(tmp_path / "t.toml")
            assert len(str(refused.value)) < 10_000


def test_a_file_is_read_up_to_its_size_and_a_pipe_never(tmp_path):
    file, pipe = tmp_path / "a", tmp_path / "pipe"
    file.write_bytes(b"x" * MIB)
    assert len(bytes_of(file, MIB)) == MIB
    with file.open("ab") as stream:
        stream.write(b"y")
    with pytest.raises(Refusal, match="larger than the 1 MiB"):
        bytes_of(file, MIB)
    os.mkfifo(pipe)
    with pytest.raises(Refusal, match="is a pipe"):
        bytes_of(pipe, MIB)
    for path, words in (
        (tmp_path, "is a folder"),
        ("a" * 300, "too long"),
        ("a\0b", "null"),
        ("/dev/zero", "device"),
    ):
        with pytest.raises(Refusal, match=words):
            bytes_of(path, MIB)


@pytest.mark.parametrize("name", ["d" * 300, "d/" * 3000, "a\0b", "\udcff", "file/inside"])
def test_names_that_no_file_can_have_are_no_files(tmp_path, name):
    (tmp_path / "file").touch()
    assert not is_file(tmp_path / name)
    for read in (load_target, load_rig, read_limits, read_record):
        with pytest.raises(FringecalError):
            read(f"{tmp_path}/{name}.toml")


def test_links_that_lead_out_are_not_inside(tmp_path):
    inside = tmp_path / "session"
    inside.mkdir()
    (tmp_path / "x.toml").touch()
    (inside / "link.toml").symlink_to(tmp_path / "x.toml")
    (inside / "loop").symlink_to(inside / "loop")
    assert not lies_inside(inside / "link.toml", inside)
    assert lies_inside(inside / "not-there.toml", inside)


@pytest.mark.parametrize("levels", [100, 100_000])
def test_every_reader_of_a_document_is_guarded(tmp_path, levels):
    for name, text, read, error in (
        ("t.toml", "a = " + "[" * levels + "]" * levels, load_target, TargetError),
        ("l.toml", "a = " + "[" * levels + "]" * levels, read_limits, RecordError),
        ("r.toml", "a = " + "[" * levels + "]" * levels, load_rig, FringecalError),
        ("c.json", '{"format": ' + "[" * levels + "]" * levels + "}", read_record, RecordError),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(error, match=f"{name}.*(deeper|not valid)"):
            read(tmp_path / name)


def session_with(folder, *, model, target):
    folder.mkdir(exist_ok=True)
    capture = {"name": "g", "kind": "grid", "target": target, "images": []}
    document = {"format": 1, "rig": "r", "camera": {"model": model}, "capture": [capture]}
    (folder / "session.toml").write_text("captured = 2026-11-22T10:00:00Z\n" + to_toml(document))
    return folder


@pytest.mark.parametrize("name", ["../x.toml", "/etc/passwd.toml", "link.toml"])
def test_target_and_camera_model_stay_in_the_session(tmp_path, name):
    (tmp_path / "x.toml").write_text("format = 1")
    folder = session_with(tmp_path / "s", model=name, target=name)
    (folder / "link.toml").symlink_to(tmp_path / "x.toml")
    outside = [str(fault) for fault in check_session(folder).faults if "outside the session folder" in str(fault)]
    assert ["camera.model" in outside[0], "target" in outside[1], len(outside)] == [True, True, 2]


def test_a_check_reads_the_camera_model(tmp_path):
    check = check_session(session_with(tmp_path / "s", model="lens.json", target="grid-10mm"))
    assert any("lens.json" in str(fault) and "not there" in str(fault) for fault in check.faults)
    (tmp_path / "s" / "lens.json").write_text("[" * 1000)
    with_reader = check_session(tmp_path / "s", read_model=lambda content: load_target(content.decode()))
    assert any("camera.model" in str(fault) for fault in with_reader.faults)
    assert not any("camera.model" in str(fault) for fault in check_session(tmp_path / "s").faults)


@pytest.mark.parametrize(
    "matrix",
    [
        ((1.0,), (0.0, 1.0)),
        ((1e308, 0.0), (0.0, 5e-324)),
        ((1.0, 2.0), (2.0, 1.0)),
        ((-1.0, 0.0), (0.0, 1.0)),
        ((1.0, 1e300), (1e300, 1e-300)),
        ((0.0, 1.0), (1.0, 0.0)),
    ],
)
def test_what_is_no_covariance_is_told_without_an_error(matrix):
    """A diagonal of whatever sizes is one; negative, ragged or correlated beyond one is none."""
    diagonal = matrix == ((1e308, 0.0), (0.0, 5e-324))
    assert is_covariance(matrix, 2) is diagonal
