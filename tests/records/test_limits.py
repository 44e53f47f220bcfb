"""A laboratory's own limits: read, refused with a hint, and obeyed by the checks."""

import pytest

from fringecal.errors import RecordError
from fringecal.records.limits import Limits, limits_for, read_limits
from fringecal.uncertainty.estimates import Estimate
from fringecal.workflows.shared.judgement import judged


def written(folder, text):
    file = folder / "limits.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_what_a_file_leaves_out_keeps_its_default(tmp_path):
    limits = read_limits(written(tmp_path, "format = 1\nlevel = 0.9\n[audit]\nscale_percent = 0.5\n"))
    assert (limits.level, limits.audit.scale_percent) == (0.9, 0.5)
    assert limits.audit.angle_deg == Limits().audit.angle_deg
    assert limits.commission == Limits().commission


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format = 1\n[audit]\nscale_procent = 0.5", ("audit.scale_procent", "'scale_percent'")),
        ("format = 1\n[comission]\nangle_en = 1", ("comission", "'commission'")),
        ("format = 1\n[audit]\nqqqq = 0.5", ("audit.qqqq", "known: scale_percent")),
        ("format = 1\n[audit]\nscale_percent = -1", ("audit.scale_percent", "greater than 0", "-1")),
        ("format = 1\n[audit]\nscale_percent = nan", ("audit.scale_percent",)),
        ("format = 1\n[audit]\nscale_percent = 'wide'", ("audit.scale_percent", "wide")),
        ("format = 1\naudit = 3", ("audit",)),
        ("format = 2", ("format", "found 2")),
        ("level = 0.9", ('"format = 1"',)),
        ("", ('"format = 1"',)),
        ("format = = 1", ("not valid TOML",)),
    ],
)
def test_a_wrong_file_is_refused_with_what_to_do(tmp_path, text, words):
    with pytest.raises(RecordError) as refusal:
        read_limits(written(tmp_path, text))
    for word in ("limits.toml", *words):
        assert word in str(refusal.value)


def test_no_file_and_no_text_are_refused(tmp_path):
    with pytest.raises(RecordError, match="cannot be read"):
        read_limits(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordError, match="not UTF-8"):
        read_limits(binary)


def test_stated_limits_come_before_those_beside_the_session(tmp_path):
    assert limits_for(tmp_path) == Limits()
    written(tmp_path, "format = 1\n[verify]\nen = 2.0")
    (tmp_path / "other").mkdir()
    stated = written(tmp_path / "other", "format = 1\n[verify]\nen = 3.0")
    assert limits_for(tmp_path).verify.en == 2.0
    assert limits_for(tmp_path, stated).verify.en == 3.0


@pytest.mark.parametrize(
    ("value", "outcome"),
    # Guard band of 1.645 u at 95 % (JCGM 106:2012, 8.3.2): 0.1645 about the limit of 1, on either side of zero.
    [(0.83, "pass"), (-0.83, "pass"), (0.84, "conditionalPass"), (-1.16, "conditionalFail"), (-1.17, "fail")],
)
def test_a_signed_change_is_judged_by_its_size(value, outcome):
    check = judged("change", Estimate(value, 0.1, "mm"), 1.0)
    assert check.decision == outcome
    assert check.expanded == pytest.approx(0.196, abs=5e-4)


def test_the_page_states_every_limit_with_its_default(request, tmp_path):
    page = (request.config.rootpath / "docs" / "limits.md").read_text(encoding="utf-8")
    example = page.partition("```toml\n")[2].partition("```")[0]
    stated = read_limits(written(tmp_path, example))
    assert stated == Limits()
    for table in (stated.commission, stated.verify, stated.audit):
        assert all(f"\n{key} =" in example or f"# {key} =" in example for key in type(table).model_fields)
