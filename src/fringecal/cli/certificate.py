"""`fringecal certificate`: a calibration report as Digital Calibration Certificate, page and sheets."""

from datetime import UTC, datetime
from pathlib import Path

import typer

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder
from fringecal.report import SHEETS_FILE
from fringecal.workflows.shared import command_line

HELP = """Write a calibration report: XML (Digital Calibration Certificate 3.3.0), and the same as HTML and PDF.

The numbers come from the records, everything else from the laboratory's lab.toml (docs/certificate.md). What a report
needs and the file does not state is asked for by name; nothing is made up. The report carries no electronic signature.
Writes certificate.xml, report.html, report.pdf and tables into DIR.

Example: fringecal certificate --template lab.toml

Example: fringecal certificate calibration/calibration.json --lab lab.toml --out certificate
"""
CERTIFICATE_FILE = "certificate.xml"


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="certificate", help=HELP)(certificate)


def certificate(
    record: Path | None = typer.Argument(None, help="calibration.json, or its folder.", show_default=False),
    out: Path | None = typer.Option(None, "--out", "-o", help="Folder for the results.", show_default=False),
    lab: Path | None = typer.Option(None, "--lab", help="The laboratory's file.", show_default=False),
    verification: Path | None = typer.Option(
        None, "--verification", help="verification.json made with this calibration.", show_default=False
    ),
    draft: bool = typer.Option(False, "--draft", help="Mark what is not stated instead of refusing; says DRAFT."),
    template: Path | None = typer.Option(
        None, "--template", help="Write a lab.toml to fill in, and nothing else.", show_default=False
    ),
    as_json: bool = typer.Option(False, "--json", help="Print what was written as one JSON document."),
) -> None:
    """Load, gather, save, print."""
    if template is not None:
        _write_template(template, as_json=as_json)
        return
    if record is None or out is None:
        raise typer.BadParameter(
            "needed for a report; --template FILE alone writes a lab.toml", param_hint="RECORD --out"
        )
    _write_certificate(record, out, lab, verification, draft=draft, as_json=as_json)


def _write_template(file: Path, *, as_json: bool) -> None:
    from fringecal.errors import RecordError
    from fringecal.records import lab_template, write_text

    if file.exists():
        raise RecordError(f"{file}: is there already and is not replaced; name another file")
    write_text(file, lab_template())
    if as_json:
        print_json({"format": "fringecal-certificate/1", "template": str(file)})
        return
    console.print(f"{file}: fill in the empty values, then name it with --lab", markup=False, soft_wrap=True)


def _write_certificate(
    record: Path, out: Path, lab: Path | None, verification: Path | None, *, draft: bool, as_json: bool
) -> None:
    from fringecal.records import (
        Laboratory,
        certificate_xml,
        is_board_calibration,
        read_board_calibration,
        read_calibration,
        read_laboratory,
        read_verification,
        result_folder,
        write_bytes,
    )
    from fringecal.report import write_report
    from fringecal.workflows.certificate import certificate_of, certificate_report

    demand_folder(out)
    stated = Laboratory() if lab is None else read_laboratory(lab)
    calibration = read_board_calibration(record) if is_board_calibration(record) else read_calibration(record)
    found = certificate_of(
        calibration,
        calibration.file_sha256,
        stated,
        verification=None if verification is None else read_verification(verification),
        draft=draft,
    )
    command = command_line("certificate", [record, "--out", out, *(("--lab", lab) if lab else ())])
    report = certificate_report(found, command=" ".join(command), created=datetime.now(UTC))
    with result_folder(out, last=CERTIFICATE_FILE) as staging:
        write_report(report, staging)
        sheets = (staging / SHEETS_FILE).read_bytes()
        write_bytes(staging / CERTIFICATE_FILE, certificate_xml(found, sheets=sheets))
    if as_json:
        document = {"number": found.number, "draft": found.draft, "missing": found.missing, "decision": found.decision}
        print_json({"format": "fringecal-certificate/1", "file": str(out / CERTIFICATE_FILE), **document})
        return
    for text in found.missing:
        console.print(f"not stated: {text}", markup=False, highlight=False, soft_wrap=True)
    console.print(f"{found.title}: {out / CERTIFICATE_FILE}", markup=False, highlight=False, soft_wrap=True)
