"""The study: its draws, its statistics, its resumption, and that workers do not matter."""

import math
import os
import shutil
import signal
import subprocess
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fringecal.errors import FringecalError, RecordError
from fringecal.projector import total_u
from fringecal.records.parts import EstimateRecord
from fringecal.records.study_record import Comparison, RigResult, rig_file
from fringecal.simulate import load_rig
from fringecal.targets import parse_target
from fringecal.uncertainty.coverage import wilson_interval
from fringecal.workflows.study.coverage_summary import ENOUGH, summarise
from fringecal.workflows.study.drawn_rigs import STEP_ERROR_DEG, draw_rig
from fringecal.workflows.study.run import StudyPlan, examine_rig, run_study
from fringecal.workflows.study.workers import ClusterKeys, cluster, local_pool


# Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3.
@pytest.mark.parametrize(
    ("hits", "number", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_intervals_are_the_published_ones(hits, number, low, high):
    assert wilson_interval(hits, number) == pytest.approx((low, high), abs=5.1e-5)


@pytest.mark.parametrize(("hits", "number"), [(0, 0), (3, 2), (-1, 5)])
def test_impossible_counts_are_refused(hits, number):
    with pytest.raises(ValueError, match="at least one trial"):
        wilson_interval(hits, number)


def drawn_errors(number):
    drawn = draw_rig(number, seed=5)
    stated = {c.name: parse_target(c.target).warmed(None, 0.0) for c in drawn.spec.capture if c.target is not None}
    pitch, strips = stated["grid"].pitch_mm, stated["strips"]
    u_pitch = math.hypot(pitch.u, pitch.value * stated["grid"].thermal_rel_u)
    height = replace(strips.height_mm.estimate("height", "mm"), value=strips.height_mm.value + strips.added_mm)
    errors = [
        (drawn.targets["grid"].pitch_mm.value - pitch.value) / u_pitch,
        (drawn.targets["strips"].height_mm.values[0] - height.value) / total_u(strips, height),
    ]
    return [*errors, *(np.array(drawn.steps["strips"].error_deg) / STEP_ERROR_DEG)[:3]]


def test_true_sizes_are_normal_about_the_stated_ones():
    errors = np.array([drawn_errors(k) for k in range(300)])
    # 300 draws: the mean's standard deviation is 0.058, the variance's 0.08; four of each.
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=0.24)
    np.testing.assert_allclose(errors.var(axis=0), 1, atol=0.33)
    # Independent of one another: correlations scatter by 0.058 too.
    assert np.abs(np.corrcoef(errors.T) - np.eye(5)).max() < 0.26


def test_number_and_seed_decide_a_rig():
    assert draw_rig(3, seed=1) == draw_rig(3, seed=1)
    assert draw_rig(3, seed=1).spec != draw_rig(4, seed=1).spec
    assert draw_rig(3, seed=1).spec != draw_rig(3, seed=2).spec


def test_of_one_rig_only_errors_are_drawn():
    thesis = load_rig("thesis")
    first, second = (draw_rig(k, seed=1, spec=thesis) for k in (0, 1))
    assert first.spec.camera == second.spec.camera == thesis.camera
    assert first.targets["strips"].height_mm != second.targets["strips"].height_mm
    assert first.seed != second.seed


def results(rng, number, spread=1.0):
    """Results with a known answer: errors of `spread` times their u, one rig in ten refused."""
    for k in range(number):
        if k % 10 == 9:
            yield RigResult(number=k, refused="FitError: too dark")
        else:
            found = EstimateRecord(value=2.0 + 0.1 * spread * rng.standard_normal(), u=0.1, unit="mm")
            yield RigResult(number=k, quantities=(Comparison(name="5 mm", true=2.0, found=found),))


def test_a_study_of_few_rigs_is_too_few_to_judge():
    """All of 51 intervals may hold the truth by luck where 93 % do; that 0 of 20 do is proof enough."""
    few = summarise(list(results(np.random.default_rng(1), 20, 1.0)))
    (quantity,) = few.quantities
    assert quantity.decision == "info"
    assert few.sentence.startswith("Too few to judge")
    assert wilson_interval(ENOUGH - 1, ENOUGH - 1)[0] < 0.93 <= wilson_interval(ENOUGH, ENOUGH)[0]
    (missed,) = summarise(list(results(np.random.default_rng(1), 20, 100.0))).quantities
    assert missed.decision == "fail"


@pytest.mark.parametrize(("spread", "decision"), [(1.0, "pass"), (0.5, "fail"), (2.0, "fail")])
def test_a_summary_tells_honest_statements_from_others(spread, decision):
    summary = summarise(list(results(np.random.default_rng(1), 2000, spread)))
    (quantity,) = summary.quantities
    assert summary.rigs == 2000
    assert len(summary.refused) == 200
    # P(|z| <= 1.96 / spread) of the normal distribution; 1800 rigs: 0.5 % (spread 1) to 1.1 % (spread 2).
    assert quantity.coverage == pytest.approx(math.erf(1.96 / spread / math.sqrt(2)), abs=0.03)
    assert quantity.ratio == pytest.approx(spread, rel=0.07)  # four times 1 / sqrt(2 n)
    assert abs(quantity.bias) < 4 * quantity.u_bias
    assert quantity.decision == decision
    assert "200 refused" in summary.sentence


def test_no_spread_without_two_rigs():
    with pytest.raises(FringecalError, match="too dark"):
        summarise([RigResult(number=0, refused="FitError: too dark")])


def quick(plan, numbers):
    """Stand in for workers: the answer depends on the rig's number alone."""
    for number in numbers:
        quick.computed.append(number)
        found = EstimateRecord(value=float(number), u=1.0, unit="mm")
        yield RigResult(number=number, quantities=(Comparison(name="5 mm", true=0.0, found=found),))


@pytest.fixture(autouse=True)
def nothing_computed():
    quick.computed = []


def interrupted(plan, numbers):
    for result in quick(plan, numbers):
        if result.number == 3:
            raise KeyboardInterrupt
        yield result


def test_an_interrupted_study_goes_on_where_it_stood(tmp_path):
    plan = StudyPlan(seed=1)
    with pytest.raises(KeyboardInterrupt):
        run_study(plan, 6, tmp_path, interrupted)
    whole = run_study(plan, 6, tmp_path, quick)
    assert quick.computed == [0, 1, 2, 3, 3, 4, 5]
    assert [result.number for result in whole] == list(range(6))
    assert run_study(plan, 6, tmp_path, quick) == whole
    assert len(quick.computed) == 7


def test_a_rig_delivered_twice_counts_once(tmp_path):
    def twice(plan, numbers):
        yield from quick(plan, numbers)
        yield from quick(plan, numbers)

    assert [r.number for r in run_study(StudyPlan(), 3, tmp_path, twice)] == [0, 1, 2]


def test_another_study_is_not_mixed_in(tmp_path):
    run_study(StudyPlan(seed=1), 2, tmp_path, quick)
    with pytest.raises(RecordError, match="seed 1, asked 2"):
        run_study(StudyPlan(seed=2), 2, tmp_path, quick)


def test_a_damaged_or_misplaced_result_is_refused(tmp_path):
    run_study(StudyPlan(), 2, tmp_path, quick)
    first, second = (rig_file(tmp_path, k) for k in (0, 1))
    second.write_text(first.read_text())
    with pytest.raises(RecordError, match="holds rig 0"):
        run_study(StudyPlan(), 2, tmp_path, quick)
    second.write_text(first.read_text()[:40])
    with pytest.raises(RecordError, match="not a JSON document"):
        run_study(StudyPlan(), 2, tmp_path, quick)


@pytest.fixture
def dark():
    """Plan of a rig that is quickly refused: nothing shows in its small pictures."""
    small = {"width_px": 48, "height_px": 40}
    return StudyPlan(rig=load_rig("thesis").at(light={"mid_grey": 0.004, "room_grey": 0.004}, camera=small))


def test_a_dark_rig_is_refused_with_its_reason(dark):
    result = examine_rig(dark, 0)
    assert result.quantities == ()
    assert "Error: " in result.refused


def test_the_number_of_workers_changes_nothing(dark):
    two = sorted(local_pool(dark, [0, 1], workers=2), key=lambda result: result.number)
    assert two == [examine_rig(dark, 0), examine_rig(dark, 1)]


def test_no_scheduler_is_said_plainly():
    with pytest.raises(FringecalError, match="no Dask scheduler answers"):
        list(cluster(StudyPlan(), [0], address="nonsense://nowhere:1"))


def test_a_cluster_without_workers_is_given_up():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as nobody,
        pytest.raises(FringecalError, match="no worker for 0.2 s.*start workers"),
    ):
        list(cluster(StudyPlan(), [0], address=nobody.scheduler_address, without_workers_s=0.2))


def test_a_cluster_that_asks_for_keys_is_reached_with_them_alone(tmp_path):
    distributed = pytest.importorskip("distributed")
    if shutil.which("openssl") is None:
        pytest.skip("no openssl to make certificates with")
    make = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -keyout key.pem -out certificate.pem"
    subprocess.run(make.split(), cwd=tmp_path, check=True, capture_output=True)
    ca, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
    named = {"tls_ca_file": ca, "tls_scheduler_cert": ca, "tls_scheduler_key": key, "tls_client_cert": ca}
    security = distributed.Security(
        require_encryption=True, tls_client_key=str(key), **{name: str(file) for name, file in named.items()}
    )
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0", protocol="tls://", security=security) as nobody:
        address = nobody.scheduler_address
        with pytest.raises(FringecalError, match="no worker for 0.2 s"):  # connected, and told so
            list(cluster(StudyPlan(), [0], address=address, keys=ClusterKeys(ca, ca, key), without_workers_s=0.2))
        with pytest.raises(FringecalError, match="no Dask scheduler answers"):
            list(cluster(StudyPlan(), [0], address=address, without_workers_s=0.2))


@pytest.mark.parametrize(
    "words",
    [
        ("--tls-ca=ca.pem",),
        ("--tls-ca=ca.pem", "--tls-cert=ca.pem", "--tls-key=ca.pem"),
        ("--tls-ca=ca.pem", "--tls-cert=ca.pem", "--tls-key=ca.pem", "--scheduler=tcp://localhost:1"),
        ("--tls-ca=ca.pem", "--tls-cert=ca.pem", "--tls-key=none.pem", "--scheduler=tls://localhost:1"),
    ],
)
def test_keys_belong_together(tmp_path, monkeypatch, words):
    from typer.testing import CliRunner

    from fringecal.cli.app import build_app

    monkeypatch.chdir(tmp_path)
    (tmp_path / "ca.pem").touch()
    found = CliRunner().invoke(build_app("study"), ["study", "--rigs=2", "--out=out", *words])
    assert found.exit_code == 2
    assert "--tls-ca" in found.output
    assert not (tmp_path / "out").exists()


def test_a_cluster_whose_workers_are_killed_finishes(dark, tmp_path):
    distributed = pytest.importorskip("distributed")
    killed = []

    def kill_all(step):
        if step.startswith("3 of 12") and not killed:
            killed.extend(client.run(os.getpid).values())
            for process in killed:
                os.kill(process, signal.SIGKILL)

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as workers,
        distributed.Client(workers) as client,
    ):
        compute = partial(cluster, address=workers.scheduler_address)
        found = run_study(dark, 12, tmp_path, compute, progress=kill_all)
    assert len(killed) == 2
    assert [result.number for result in found] == list(range(12))
    assert len(list((tmp_path / "rigs").iterdir())) == 12
