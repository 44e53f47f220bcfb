"""`fringecal history`: the records of all rigs over the years, their control charts and what follows from them."""

import difflib
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE
from fringecal.cli.shared.saving import demand_folder
from fringecal.report import REPORT_FILE, write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    import pandas as pd

    from fringecal.history import Review
    from fringecal.report import Section

HELP = """Keep the records of rigs over the years: append, tabulate, chart, export.

The history is an SQLite file, or a PostgreSQL database by URL. Rows are added, never changed.

Example: fringecal history add calibration --db history.db
"""
DB = typer.Option(..., "--db", envvar="FRINGECAL_HISTORY", help="SQLite file, or postgresql://user@host/name.")
RIG = typer.Option(None, "--rig", help="Name of the rig; needed only where the history holds several.")
JSON = typer.Option(False, "--json", help="Print one JSON document.")


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    history = typer.Typer(help=HELP, no_args_is_help=True)
    history.command(name="add")(add)
    history.command(name="import")(import_file)
    history.command(name="show")(show)
    history.command(name="chart")(chart)
    history.command(name="msa")(msa)
    history.command(name="export")(export)
    app.add_typer(history, name="history")


def append_record(record: Path, db: str) -> None:
    """Append a record's file to a history, for the verbs that make records.

    Raises
    ------
    HistoryError
        The database refuses; the record itself is complete, and can be added later.
    """
    from fringecal.errors import HistoryError
    from fringecal.history import open_history, read_entry

    try:
        with open_history(db) as history:
            history.append([read_entry(record)])
    except HistoryError as error:
        hint = f"the results in {record.parent} are complete; `fringecal history add {record} --db DB` adds them"
        raise HistoryError(f"{error}\n{hint}") from error


def history_beside(record: Path, db: str) -> "Section | None":
    """Chart a record's quantities over the history that it will be appended to; None where there is none yet.

    A history that cannot be read stops no report: appending to it, when the results are written, will say why.
    """
    import pandas as pd

    from fringecal.errors import HistoryError
    from fringecal.history import open_history, read_entry, readings_of, reviews_of
    from fringecal.workflows.history import history_section

    if not db:
        return None
    entry = read_entry(record)
    today = readings_of(entry)
    try:
        with open_history(db, create=False) as history:
            before = history.readings(entry.rig)
    except HistoryError:
        return None
    quantities = [str(name) for name in today["quantity"] if not str(name).startswith("check: ")]
    table = today if before.empty else pd.concat([before.astype(object), today.astype(object)], ignore_index=True)
    reviews = reviews_of(table.sort_values("captured", kind="stable"), quantities) if quantities else ()
    return history_section(reviews)


def add(
    records: list[Path] = typer.Argument(..., help="Record files, or the folders that hold them.", show_default=False),
    db: str = DB,
    as_json: bool = JSON,
) -> None:
    """Append records; one that is there already is left as it is.

    Example: fringecal history add calibration verification --db history.db
    """
    from fringecal.history import open_history, read_entry

    entries = [read_entry(record) for record in records]
    with open_history(db) as history:
        _print_added(history.append(entries), len(entries), as_json)


def import_file(
    table: Path = typer.Argument(..., help="CSV or Parquet.", show_default=False),
    db: str = DB,
    correct: bool = typer.Option(False, "--correct", help="Supersede entries that the table contradicts."),
    as_json: bool = JSON,
) -> None:
    """Append the rows of a table: an export, or a table of one's own with rig, captured, quantity and value.

    Where the history holds other values of the same time, nothing is added, unless they are to be corrected; what was
    there stays in the database and is left out of tables and charts.

    Example: fringecal history import old-audits.csv --db history.db
    """
    from fringecal.history import import_table, open_history

    with open_history(db) as history:
        new = import_table(history, table, correct=correct)
        _print_added(new, None, as_json)


def _print_added(new: int, given: int | None, as_json: bool) -> None:
    if as_json:
        print_json({"added": new})
    else:
        known = f", {given - new} were there already" if given is not None and given > new else ""
        console.print(f"{new} record(s) added{known}", markup=False, highlight=False)


def show(
    db: str = DB,
    rig: str | None = RIG,
    values: bool = typer.Option(False, "--values", help="Show every reading with its U; so does naming a rig."),
    quantity: list[str] = typer.Option([], "--quantity", help="Only readings of this quantity; repeat for more."),
    as_json: bool = JSON,
) -> None:
    """List the records in the order of capture, and the quantities or their values.

    Example: fringecal history show --db history.db --rig bench-1

    Example: fringecal history show --db history.db --quantity "projection angle"
    """
    from fringecal.history import LEAST_POINTS, open_history

    with open_history(db, create=False) as history:
        entries, readings = history.entries(rig), history.readings(rig)
    _demand_quantities(quantity, set(readings["quantity"]))
    readings = readings[readings["quantity"].isin(quantity)] if quantity else readings
    wanted = values or bool(quantity) or rig is not None
    counts: list[dict[str, Any]] = [
        {"rig": str(one), "quantity": str(quantity), "records": len(group)}
        for (one, quantity), group in readings.groupby(["rig", "quantity"])
    ]
    if as_json:
        told = {"readings": _plain(readings)} if wanted else {}
        print_json({"format": "fringecal-history/1", "entries": _plain(entries), "quantities": counts, **told})
        return
    table = Table(title=f"{len(entries)} record(s)", box=box.SIMPLE_HEAD, padding=0)
    for heading in ("rig", "captured", "kind", "verdict", "operator", "source"):
        table.add_column(heading, overflow="fold")
    for row in _plain(entries):
        cells = (row["rig"], row["captured"][:16], row["kind"], row["decision"], row["operator"] or "", row["source"])
        table.add_row(*(escape(cell) for cell in cells))
    console.print(table)
    if wanted:
        for number, row in enumerate(_plain(entries), start=1):
            _print_readings(
                f"{number}. {row['rig']}, {row['captured'][:16]}, {row['kind']}: {row['decision']}",
                _plain(readings[readings["sha256"] == row["sha256"]]),
            )
        return
    known = [count for count in counts if count["records"] >= LEAST_POINTS]
    lines = [f"{count['records']:5d} x {count['rig']} / {count['quantity']}" for count in known]
    if len(known) < len(counts):
        few = f"{len(counts) - len(known)} with fewer than {LEAST_POINTS} records: --values lists them"
        lines.append(f"quantities: {few}")
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _demand_quantities(asked: Sequence[str], known: set[str]) -> None:
    """Refuse a quantity that no record holds.

    Raises
    ------
    HistoryError
        As described; the message holds the nearest names.
    """
    from fringecal.errors import HistoryError

    for name in asked:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3, cutoff=0.3)
            raise HistoryError(
                f"no record holds the quantity {name!r}; {'near: ' + '; '.join(near) if near else 'none is near'}"
            )


def _print_readings(title: str, readings: list[dict[str, Any]]) -> None:
    """Tabulate one record's readings, U and En formed from what stands beside them."""
    from dataclasses import fields

    from fringecal.history import Reading, en_of
    from fringecal.uncertainty import EXPANDED_BY, Estimate

    names = [field.name for field in fields(Reading)]
    title = f"{title}\n{EXPANDED_BY}; En by U"
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("quantity", "value", "U (95 %)", "unit", "En", "limit", "outcome"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit", "outcome") else "right")
    for row in readings:
        u = row["u"]
        expanded = Estimate(row["value"], u, dof=row["dof"] or math.inf).expanded().U if u else None
        numbers = (value_text(row["value"], u), "" if expanded is None else uncertainty_text(expanded))
        en, limit = en_of(Reading(**{name: row[name] for name in names})), row["limit"]
        others = "" if en is None else f"{en:+z.2f}", "" if limit is None else f"{limit:g}"
        table.add_row(escape(row["quantity"]), *numbers, escape(row["unit"] or ""), *others, row["decision"] or "")
    console.print(table if readings else escape(f"{title}: no such reading"))


def _plain(frame: "pd.DataFrame") -> list[dict[str, Any]]:
    """Turn a table into rows that JSON can hold: None where something is missing."""
    return [
        {str(name): value for name, value in row.items()}
        for row in frame.astype(object).where(frame.notna(), None).to_dict("records")
    ]


def chart(
    db: str = DB,
    rig: str | None = RIG,
    quantity: list[str] = typer.Option(
        [], "--quantity", help="Quantity to chart; repeat for more. All but checks by default."
    ),
    limit: float | None = typer.Option(None, "--limit", help="Largest permissible distance from --reference."),
    reference: float | None = typer.Option(None, "--reference", help="What --limit is counted from, 0 by default."),
    baseline: int | None = typer.Option(
        None, "--baseline", min=2, help="Records in control, from the first, that judge the others."
    ),
    since: str = typer.Option("", "--since", help="Leave out what was captured before, e.g. 2026-02-01."),
    out: Path | None = typer.Option(None, "--out", help="Folder for report.html, tables and figures."),
    as_json: bool = JSON,
) -> None:
    """Say what is out, what drifts and what is due; draw control charts.

    Exit code 3 if a chart is in alarm at the last record.

    Example: fringecal history chart --db history.db --quantity "scale, mean" --out charts
    """
    from fringecal.history import captured_since, open_history, reviews_of
    from fringecal.workflows.history import history_report, history_verdict, review_table

    if (limit is not None or reference is not None) and len(quantity) != 1:
        raise typer.BadParameter("a limit belongs to one quantity: name it with --quantity", param_hint="--limit")
    first = _time(since, "--since") if since else None
    if out is not None:
        demand_folder(out)
    with open_history(db, create=False) as history:
        name = _one_rig(history.rigs(), rig)
        entries, readings = history.entries(name), history.readings(name)
    if first is not None:
        readings, entries = (captured_since(frame, first) for frame in (readings, entries))
    _demand_quantities(quantity, set(readings["quantity"]))
    reviews = reviews_of(readings, quantity, limit=limit, reference=reference, baseline=baseline)
    verdict, table = history_verdict(reviews), review_table(reviews)
    if out is not None:
        from fringecal.records import result_folder

        command = " ".join(command_line("history", ["chart", "--db", db, "--out", out]))
        report = history_report(name, entries, reviews, command=command, created=datetime.now(UTC))
        with result_folder(out, last=REPORT_FILE) as staging:
            write_report(report, staging)
    if as_json:
        print_json(
            {
                "format": "fringecal-history-chart/1",
                "rig": name,
                "verdict": verdict.sentence,
                "quantities": _plain(table),
            }
        )
    else:
        _print_reviews(reviews, verdict.sentence)
    if verdict.decision == "conditionalFail":
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE)


def _time(text: str, option: str) -> datetime:
    from fringecal.history import parsed_time

    try:
        return parsed_time(text)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r}; {error}", param_hint=option) from None


def _print_reviews(reviews: "Sequence[Review]", sentence: str) -> None:
    """Print the verdict first, then each quantity that has a line, and the others in one."""
    from fringecal.history import last_text, rate_text, standing_of

    few = standing_of(reviews).too_few
    lines = [sentence]
    for review in reviews:
        if review in few:
            continue
        lines.append(f"{review.series.quantity}: {len(review.series.values)} record(s), last {last_text(review)}")
        lines += [f"  drift {rate_text(review.drift)}, p {review.drift.p_value:.2g}"] if review.drift else []
        lines.append(f"  {_due_text(review)}")
        lines += [f"  {note}" for note in review.notes]
    if few:
        lines.append(
            f"quantities with too few records to say anything: {len(few)}; `fringecal history show` lists them"
        )
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _due_text(review: "Review") -> str:
    days = review.due.days
    return f"{review.due.method}: {'' if days is None else f'{days:.0f} days; '}{review.due.reason}"


def _one_rig(rigs: tuple[str, ...], rig: str | None) -> str:
    from fringecal.errors import HistoryError

    if rig in rigs:
        return str(rig)
    if rig is None and len(rigs) == 1:
        return rigs[0]
    raise HistoryError(
        f"{'no rig named' if rig is None else f'no rig {rig!r}'}; the history holds {', '.join(rigs) or 'none'}"
    )


def msa(
    artefact: str = typer.Argument(..., help="Name of the target that was verified repeatedly.", show_default=False),
    db: str = DB,
    rig: str | None = RIG,
    tolerance: float | None = typer.Option(
        None, "--tolerance", help="Width of the tolerance in mm, for type-1 studies."
    ),
    as_json: bool = JSON,
) -> None:
    """Study the rig as a gauge: repeatability and reproducibility, and Cg, Cgk with a tolerance.

    Parts are the certified numbers of the artefact, trials its repeated verifications by each operator.

    Example: fringecal history msa "Step block" --db history.db --tolerance 0.5
    """
    from dataclasses import asdict

    from fringecal.history import anova_study, open_history, range_study, repeats_of, type_one_study

    with open_history(db, create=False) as history:
        repeats = repeats_of(history.readings(_one_rig(history.rigs(), rig)), artefact)
    document: dict[str, object] = {"format": "fringecal-msa/1", "artefact": artefact, "shape": repeats.readings.shape}
    several = len(repeats.parts) > 1
    studies = [method(repeats.readings) for method in (anova_study, range_study) if several]
    if several:
        document["gauge"] = [
            asdict(s) | {"percent": s.percent, "categories": s.categories, "verdict": s.verdict} for s in studies
        ]
    if tolerance is not None:
        document["percent_of_tolerance"] = {s.method: s.percent_of_tolerance(tolerance) for s in studies}
        pairs = zip(repeats.parts, repeats.readings, repeats.references, strict=True)
        document["type_one"] = {
            part: asdict(type_one_study(x.ravel(), float(reference), tolerance)) for part, x, reference in pairs
        }
    if as_json:
        print_json(document)
    else:
        _print_studies(document)


def _print_studies(document) -> None:  # type: ignore[no-untyped-def]
    parts, operators, trials = document["shape"]
    lines = [f"{document['artefact']}: {parts} part(s), {operators} operator(s), {trials} trials each"]
    if "gauge" not in document:
        lines.append("no gauge R&R: two parts are needed")
    for s in document.get("gauge", []):
        lines.append(
            f"{s['method']}: repeatability {s['repeatability']:.4g} mm, reproducibility {s['reproducibility']:.4g} mm, "
            f"GRR {s['gauge']:.4g} mm = {s['percent']:.1f} % of the total, ndc {s['categories']:.1f}: {s['verdict']}"
        )
    for method, share in document.get("percent_of_tolerance", {}).items():
        lines.append(f"{method}: six standard deviations of the gauge are {share:.1f} % of the tolerance")
    for part, t in document.get("type_one", {}).items():
        verdict = "capable" if not t["reasons"] else "not capable: " + "; ".join(t["reasons"])
        lines.append(
            f"{part}: Cg {t['cg']:.2f}, Cgk {t['cgk']:.2f}, bias {t['bias']:+.4g} mm (p {t['p']:.2g}), {verdict}"
        )
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def export(
    file: Path = typer.Argument(..., help="File to write: .csv or .parquet.", show_default=False),
    db: str = DB,
    rig: str | None = RIG,
    as_json: bool = JSON,
) -> None:
    """Write the readings as one flat table.

    Example: fringecal history export history.csv --db history.db
    """
    from fringecal.history import export_table, open_history

    with open_history(db, create=False) as history:
        count = export_table(history, file, rig)
    if as_json:
        print_json({"rows": count, "file": str(file)})
        return
    console.print(f"{count} row(s) written to {file}", markup=False, highlight=False, soft_wrap=True)
