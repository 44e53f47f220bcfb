"""`fringecal study`: many random virtual rigs commissioned, to find the coverage of the stated uncertainties."""

import json
import time
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder, print_outcome, progress
from fringecal.report import write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    from fringecal.workflows.study import ClusterKeys, StudySummary

HELP = """Commission many random virtual rigs and compare what was found with what is true.

Reports for scale, angle at the origin and heights at check points: bias, standard deviation against stated u, and the
coverage of 95 % intervals with its binomial band. Each rig's result is kept in DIR: the same command goes on where an
interrupted one stood. The numbers depend on the seed, and not on who computes them.

Example: fringecal study --rigs 2 --out study

Example: fringecal study --rigs 500 --out study --scheduler tcp://host:8786
"""

_MOST_WORKERS = 256  # processes on one machine: more than the processors of any
_TOLD = 20  # times that progress is printed where there is no terminal


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="study", help=HELP)(study)


def study(  # noqa: PLR0913, PLR0917 -- one argument per option
    rigs: int = typer.Option(60, "--rigs", min=2, max=99_999, help="How many rigs."),
    out: Path = typer.Option(..., "--out", help="Folder for results and report."),
    seed: int = typer.Option(0, "--seed", min=0, help="Seed of the study."),
    rig: str = typer.Option("", "--rig", help="One rig (name or TOML) of which only errors are drawn."),
    heights: str = typer.Option("5,15,30", "--heights", help="Heights of the check points in mm."),
    workers: int = typer.Option(
        0, "--workers", min=0, max=_MOST_WORKERS, help="Processes here; as many as processors by default."
    ),
    scheduler: str = typer.Option("", "--scheduler", help="Address of a Dask scheduler to compute on instead."),
    tls_ca: Path | None = typer.Option(None, "--tls-ca", help="Certificate of the cluster's authority (PEM)."),
    tls_cert: Path | None = typer.Option(None, "--tls-cert", help="Our own certificate by that authority (PEM)."),
    tls_key: Path | None = typer.Option(None, "--tls-key", help="Its key (PEM)."),
    as_json: bool = typer.Option(False, "--json", help="Print the summary as one JSON document."),
) -> None:
    """Compute, summarise, save, print."""
    from fringecal.records import result_folder
    from fringecal.simulate import load_rig
    from fringecal.workflows.study import StudyPlan, cluster, local_pool, run_study, study_report, summarise

    if workers and scheduler:
        raise typer.BadParameter("a cluster has its own workers; give one of the two", param_hint="--workers")
    plan = StudyPlan(seed, load_rig(rig) if rig else None, _heights(heights))
    demand_folder(out)
    given = ["--rigs", rigs, "--out", out, "--seed", seed, "--heights", heights, *(["--rig", rig] if rig else [])]
    command = " ".join(command_line("study", given))
    keys = _keys(scheduler, tls_ca, tls_cert, tls_key)
    compute = partial(cluster, address=scheduler, keys=keys) if scheduler else partial(local_pool, workers=workers)
    with progress(quiet=as_json) as show:
        results = run_study(plan, rigs, out, compute, progress=_now_and_then(show, rigs))
        summary = summarise(results)
        show("writing the report")
        with result_folder(out, last="report.html") as staging:
            write_report(study_report(summary, command=command, created=datetime.now(UTC)), staging)
    if as_json:
        print_json(_document(summary, command))
        raise typer.Exit(3 if any(check.decision == "fail" for check in summary.checks()) else 0)
    console.print(_table(summary))
    print_outcome(summary.checks(), (summary.sentence,), out)


def _keys(scheduler: str, *files: Path | None) -> "ClusterKeys | None":
    """Return what a connection by TLS needs, none where it is not asked for."""
    from fringecal.workflows.study import ClusterKeys

    if not any(files):
        return None
    stated = [file for file in files if file is not None]
    if len(stated) < len(files) or not scheduler.startswith("tls://"):
        words = "--tls-ca, --tls-cert and --tls-key belong together, and to a --scheduler tls://HOST:PORT"
        raise typer.BadParameter(words, param_hint="--tls-ca")
    for file in stated:
        if not file.is_file():
            raise typer.BadParameter(f"{file}: a file was needed, there is none", param_hint="--tls-ca")
    return ClusterKeys(*stated)


def _heights(text: str) -> tuple[float, ...]:
    try:
        heights = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r}: numbers in mm with commas between", param_hint="--heights") from None
    if not all(0 < z < 1000 for z in heights):
        raise typer.BadParameter(f"{text!r}: heights lie between 0 and 1000 mm", param_hint="--heights")
    return heights


def _now_and_then(show, rigs: int):  # type: ignore[no-untyped-def]
    """Let through the progress of every rig at a terminal, else a few lines, with the time that is left."""
    started, calls = time.monotonic(), 0
    every = 1 if console.is_terminal else max(1, rigs // _TOLD)

    def line(stage: str) -> None:
        nonlocal calls
        if calls % every == 0:
            show(f"{stage}, {time.monotonic() - started:.0f} s")
        calls += 1

    return line


def _table(summary: "StudySummary") -> Table:
    title = "Errors against stated uncertainties; coverage of 95 % intervals with its binomial band"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("quantity", "bias", "stated u", "sd/u", "coverage/%", "band/%"):
        table.add_column(heading, justify="left" if heading == "quantity" else "right", no_wrap=True)
    for q in summary.quantities:
        band = f"{100 * q.band[0]:.1f}..{100 * q.band[1]:.1f}"
        numbers = (
            value_text(q.bias, q.u_bias, sign=True),
            uncertainty_text(q.stated),
            f"{q.ratio:.2f}",
            f"{100 * q.coverage:.1f}",
        )
        table.add_row(f"{q.name} / {q.unit}", *numbers, band)
    return table


def _document(summary: "StudySummary", command: str) -> dict[str, Any]:
    return {
        "format": "fringecal-study-summary/1",
        "command": command,
        "rigs": summary.rigs,
        "refused": {str(number): reason for number, reason in summary.refused.items()},
        "quantities": json.loads(summary.frame().to_json(orient="records")),
        "checks": [check.model_dump(mode="json") for check in summary.checks()],
        "sentence": summary.sentence,
    }
