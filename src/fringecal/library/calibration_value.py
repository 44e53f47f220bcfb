"""A calibration to hold in the hand: estimates, budgets and checks as tables, pictures, and ways to use it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Self

import pandas as pd
from numpy.typing import ArrayLike

from fringecal.errors import RecordError
from fringecal.projector import RigCalibration
from fringecal.records import (
    CALIBRATION_FILE,
    CAMERAMODEL_FILE,
    CalibrationRecord,
    read_calibration,
    result_folder,
    write_calibration,
    write_cameramodel,
)
from fringecal.report import budget_bars, write_report
from fringecal.session import Session
from fringecal.targets import Target
from fringecal.uncertainty import Source
from fringecal.workflows.commission import Commissioning, calibration_record, commission_report
from fringecal.workflows.shared import calibration_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fringecal.library.surface_value import Surface
    from fringecal.library.verdicts import AuditResult, VerificationResult

#: Estimates of a record that have a budget in it.
BUDGETS = ("scale.mean", "projection.angle")


@dataclass(frozen=True, repr=False)
class Calibration:
    """A calibrated rig.

    Parameters
    ----------
    record
        Everything that is stated of the calibration, as `calibration.json` holds it.
    rig
        Camera and rig model with the components of their uncertainty, for own computations.
    found
        What commissioning found, with every intermediate result; None where the calibration was loaded from a file.
    """

    record: CalibrationRecord
    rig: RigCalibration
    found: Commissioning | None = field(default=None, compare=False)

    @classmethod
    def of(cls, found: Commissioning) -> Self:
        """Take what commissioning has found."""
        return cls(calibration_record(found), found.calibrated.result.rig, found)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load a calibration from `calibration.json`, or from the folder that holds it.

        Raises
        ------
        RecordError
            There is none, or it is of a version that is not known.
        """
        record = read_calibration(path)
        return cls(record, calibration_of(record))

    def save(self, folder: str | Path) -> Path:
        """Write `calibration.json` and `camera.cameramodel` into a folder, whole or not at all; return the file.

        A calibration that is there already is kept in `earlier/`.

        Raises
        ------
        RecordError
            Nothing may be written there.
        """
        place = Path(folder)
        with result_folder(place, last=CALIBRATION_FILE) as staging:
            if not self.rig.camera.telecentric:
                write_cameramodel(staging / CAMERAMODEL_FILE, self.rig.camera)
            write_calibration(self.record, staging)
        return place / CALIBRATION_FILE

    def report(self, folder: str | Path) -> Path:
        """Write the record and the report (HTML, PDF, tables, figures) into a folder; return the page.

        Raises
        ------
        RecordError
            The calibration was loaded from a file, which holds no pictures to show; or nothing may be written there.
        """
        if self.found is not None and not self.found.calibrated.session.find("grid"):
            raise RecordError(
                "the report shows the grid's picture; calibrate from the picture instead of its crossings"
            )
        if self.found is None:
            raise RecordError(
                "a calibration loaded from its file holds no pictures to report on; calibrate from the pictures again, "
                "or run fringecal rerun on the file"
            )
        place = Path(folder)
        with result_folder(place, last=CALIBRATION_FILE) as staging:
            write_calibration(self.record, staging)
            write_report(commission_report(self.found, created=datetime.now(UTC)), staging)
        return place / "report.html"

    @property
    def estimates(self) -> pd.DataFrame:
        """Scale and projection angle: value, u, dof, U (95 %) and unit, one row each."""
        scale, projection = self.record.scale, self.record.projection
        named = {
            "scale, mean": scale.mean,
            "scale, horizontal": scale.horizontal,
            "scale, vertical": scale.vertical,
            "projection angle": projection.angle,
            "apparent projection angle": projection.apparent_angle,
        }
        rows = {name: one.estimate(name) for name, one in named.items() if one is not None}
        return pd.DataFrame(
            {
                "value": [e.value for e in rows.values()],
                "u": [e.u for e in rows.values()],
                "dof": [e.dof for e in rows.values()],
                "U (95 %)": [e.expanded().U for e in rows.values()],
                "unit": [e.unit for e in rows.values()],
            },
            index=pd.Index(rows, name="quantity"),
        )

    @property
    def checks(self) -> pd.DataFrame:
        """Every check with its value, u, limit, decision and rule, one row each."""
        rows = [check.model_dump() for check in self.record.checks]
        columns = ["name", "value", "u", "unit", "limit", "decision", "rule"]
        return pd.DataFrame(rows, columns=columns).set_index("name")

    @property
    def verdict(self) -> str:
        """The severest decision of all checks."""
        from fringecal.workflows.shared import severest

        return severest(self.record.checks)

    def budget(self, quantity: str = "projection.angle") -> pd.DataFrame:
        """Return the uncertainty budget of a quantity: contribution to u and share of the variance, the largest first.

        Parameters
        ----------
        quantity
            "projection.angle" (deg) or "scale.mean" (mm/px).

        Raises
        ------
        RecordError
            No such budget.
        """
        if quantity not in self.record.budgets:
            raise RecordError(f"no budget of {quantity!r}; there are those of {', '.join(self.record.budgets)}")
        rows = [
            {
                "source of uncertainty": Source.parse(row.label).text,
                "contribution to u": row.contribution,
                "share of the variance / %": row.percent,
            }
            for row in self.record.budgets[quantity]
        ]
        return pd.DataFrame(rows).set_index("source of uncertainty")

    def measure(
        self,
        frames: ArrayLike,
        *,
        phase_shifts_deg: Sequence[float] = (),
        periods: Sequence[float] = (),
        height_range_mm: tuple[float, float] | None = None,
        tie_to_plate: bool = False,
        model: str = "projective",
        white_level: int | None = None,
    ) -> "Surface":
        """Measure an object's surface: x, y, z, u_z and mask at every pixel; see `fringecal.measure`."""
        from fringecal.library.using import measure

        return measure(
            self,
            frames,
            phase_shifts_deg=phase_shifts_deg,
            periods=periods,
            height_range_mm=height_range_mm,
            tie_to_plate=tie_to_plate,
            model=model,
            white_level=white_level,
        )

    def verify(
        self,
        frames: ArrayLike,
        target: Target | str | Path,
        *,
        phase_shifts_deg: Sequence[float] = (),
        periods: Sequence[float] = (),
        white_level: int | None = None,
    ) -> "VerificationResult":
        """Measure an artefact and compare it with its certificate; see `fringecal.verify`."""
        from fringecal.library.using import verify

        return verify(self, frames, target, phase_shifts_deg=phase_shifts_deg, periods=periods, white_level=white_level)

    def audit(self, session: Session | str | Path) -> "AuditResult":
        """Compare a later session with this calibration; see `fringecal.audit`."""
        from fringecal.library.using import audit

        return audit(self, session)

    def plot(self, quantity: str = "projection.angle") -> "Figure":
        """Draw the budget of a quantity: bars of each influence's share of the variance."""
        table = self.budget(quantity)
        shares = table["share of the variance / %"]
        return budget_bars(list(table.index), list(shares), title=f"uncertainty of {quantity}")

    def __repr__(self) -> str:
        """Say the rig, the verdict and the headline numbers."""
        scale, angle = self.record.scale.mean, self.record.projection.angle
        return (
            f"<Calibration of {self.record.session.rig}: {self.verdict}; {scale.estimate('scale')}; "
            f"{angle.estimate('projection angle')}>"
        )

    def _repr_html_(self) -> str:
        head = f"<b>Calibration of {self.record.session.rig}</b>: {self.verdict}"
        return f"<div>{head}{self.estimates.to_html(float_format='{:.6g}'.format)}</div>"
