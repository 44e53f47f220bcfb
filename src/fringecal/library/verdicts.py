"""What a verification and an audit found, as tables for a notebook."""

from dataclasses import dataclass

import pandas as pd

from fringecal.records import Check
from fringecal.uncertainty import EN_DEFINITION
from fringecal.workflows.audit import Audit, audit_checks, audit_sentence, changes_of
from fringecal.workflows.shared import severest
from fringecal.workflows.verify import ArtefactVerification, Verification, artefact_checks, verification_checks


def tabulated(checks: tuple[Check, ...]) -> pd.DataFrame:
    """Return checks as a table: value, u, unit, limit, decision and rule by name."""
    columns = ["name", "value", "u", "unit", "limit", "decision", "rule"]
    return pd.DataFrame([check.model_dump() for check in checks], columns=columns).set_index("name")


@dataclass(frozen=True, repr=False)
class VerificationResult:
    """An artefact measured with a calibration, beside its certificate; `found` holds every intermediate result."""

    found: Verification | ArtefactVerification

    @property
    def table(self) -> pd.DataFrame:
        """Errors along profiles of angle bars, or the artefact's numbers beside the certificate's.

        u are standard uncertainties, dof those of the measurement's; En is `fringecal.uncertainty.en_score`, by U = k u
        of 95 % coverage, k from the effective degrees of freedom.
        """
        if isinstance(self.found, Verification):
            return self.found.errors.table()
        rows = [
            {
                "number": r.name,
                "measured": r.measured,
                "certified": r.reference,
                "error": r.error,
                "u": r.u_measured,
                "dof": r.dof,
                "u(cert.)": r.u_reference,
                "En": r.en,
                "unit": r.unit,
            }
            for r in self.found.readings
        ]
        return pd.DataFrame(rows).set_index("number")

    @property
    def checks(self) -> pd.DataFrame:
        """Every check with its value, limit, decision and rule."""
        return tabulated(self._checks)

    @property
    def verdict(self) -> str:
        """The severest decision of all checks."""
        return severest(self._checks)

    @property
    def sentence(self) -> str:
        """Whether measured and certified values agree, in words."""
        return self.found.errors.sentence if isinstance(self.found, Verification) else self.found.sentence

    @property
    def _checks(self) -> tuple[Check, ...]:
        if isinstance(self.found, Verification):
            return verification_checks(self.found)
        return artefact_checks(self.found)

    def __repr__(self) -> str:
        """Say artefact and verdict."""
        return f"<Verification on {self.found.target.name}: {self.verdict}; {self.sentence}>"

    def _repr_html_(self) -> str:
        table = self.table.to_html(float_format="{:.4g}".format)
        return (
            f"<div><b>Verification on {self.found.target.name}</b>: {self.verdict}<p>{self.sentence}</p>{table}"
            f"<p>{EN_DEFINITION}</p></div>"
        )


@dataclass(frozen=True, repr=False)
class AuditResult:
    """A later session against a calibration; `found` holds every intermediate result."""

    found: Audit

    @property
    def changes(self) -> pd.DataFrame:
        """Every change with u, En (`fringecal.uncertainty.en_score`), limit and detection limit, in its own unit."""
        rows = [
            {
                "change": change.name,
                "value": change.found.value,
                "u": change.found.u,
                "unit": change.found.unit,
                "En": change.en,
                "limit": change.limit,
                "detection limit": change.detection_limit,
            }
            for change in changes_of(self.found)
        ]
        return pd.DataFrame(rows).set_index("change")

    @property
    def causes(self) -> pd.DataFrame:
        """What may have moved, the most probable first, where the rig changed."""
        rows = [{"cause": fit.cause, "chi-squared": fit.chi2, "dof": fit.dof} for fit in self.found.causes]
        return pd.DataFrame(rows, columns=["cause", "chi-squared", "dof"]).set_index("cause")

    @property
    def checks(self) -> pd.DataFrame:
        """Every check with its value, limit, decision and rule."""
        return tabulated(audit_checks(self.found))

    @property
    def verdict(self) -> str:
        """The severest decision of all checks."""
        return severest(audit_checks(self.found))

    def __repr__(self) -> str:
        """Say rig, verdict and whether something changed."""
        return f"<Audit of {self.found.session.rig}: {self.verdict}; {audit_sentence(self.found)}>"

    def _repr_html_(self) -> str:
        table = self.changes.to_html(float_format="{:.3g}".format)
        head = f"<b>Audit of {self.found.session.rig}</b>: {self.verdict}"
        return f"<div>{head}<p>{audit_sentence(self.found)}</p>{table}<p>{EN_DEFINITION}</p></div>"
