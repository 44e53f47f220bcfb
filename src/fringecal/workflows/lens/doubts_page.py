"""The report of a stated calibration: the verdict, what speaks against it, and its numbers."""

from datetime import datetime

import pandas as pd

from fringecal.projector import PairsFound, StatedPair
from fringecal.records import software_versions
from fringecal.report import Fact, InputFile, Report, Section, Table, Verdict
from fringecal.workflows.lens.judging import Judged
from fringecal.workflows.lens.report import lens_table


def judged_report(judged: Judged, *, command: str = "", created: datetime | None = None) -> Report:
    """Return the report of a stated calibration."""
    stated = judged.stated
    pair = stated if isinstance(stated, StatedPair) else None
    lenses = [("Camera", stated.camera if isinstance(stated, StatedPair) else stated)]
    lenses += [] if pair is None else [("Projector", pair.projector)]
    sections = [
        Section("Verdict", (judged.sentence, *judged.notes), (_doubts(judged),) if judged.doubts else ()),
        *([] if judged.pairs is None else [_pairs_section(judged.pairs, judged.pairs_file)]),
        *(Section(name, (), (lens_table(lens),)) for name, lens in lenses),
        *([] if pair is None else [Section("Pose", (), (_pose(pair),))]),
    ]
    return Report(
        title="A stated calibration",
        subtitle=" and ".join(judged.inputs),
        verdict=Verdict(judged.verdict, judged.sentence),
        facts=() if pair is None else (Fact("Distance of the centres", f"{pair.baseline_mm:.2f} mm", judged.kind),),
        sections=tuple(sections),
        inputs=tuple(InputFile("calibration", name, sha256) for name, sha256 in judged.inputs.items()),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _doubts(judged: Judged) -> Table:
    rows = [
        {
            "about": doubt.subject,
            "what": doubt.name,
            "decision": "refused" if doubt.refused else "open",
            "reason": doubt.sentence,
        }
        for doubt in judged.doubts
    ]
    return Table("Reasons", pd.DataFrame(rows))


def _pairs_section(found: PairsFound, file: str) -> Section:
    rows = [
        ("poses", found.poses, ""),
        ("places at which both rays are seen", found.points, ""),
        ("rays miss each other, camera's picture, rms", found.camera_rms_px, "px"),
        ("rays miss each other, projector's frame, rms", found.projector_rms_px, "px"),
        ("distances over those of the board", found.scale, ""),
        ("its u, from the poses", found.scale_u, ""),
        ("points about the board, rms", found.form_rms_mm, "mm"),
    ]
    frame = pd.DataFrame([row for row in rows if row[1] == row[1]], columns=["quantity", "value", "unit"])
    return Section(
        "Points seen by both",
        (f"Places of {file} that belong together.",),
        (Table("Points seen by both", frame, "", {"value": "#.5g"}),),
    )


def _pose(pair: StatedPair) -> Table:
    rows = [{"of the projector": "shift", "x": x, "y": y, "z": z} for x, y, z in [pair.shift_mm]]
    rows += [
        {"of the projector": f"rotation, row {k}", "x": row[0], "y": row[1], "z": row[2]}
        for k, row in enumerate(pair.rotation, start=1)
    ]
    note = "X_projector = rotation X_camera + shift; mm, x right, y down, z forward"
    return Table("Pose of the projector", pd.DataFrame(rows), note, dict.fromkeys("xyz", "#.6g"))
