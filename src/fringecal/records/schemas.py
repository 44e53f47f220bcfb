"""The published JSON Schemas of the records; ``python -m fringecal.records.schemas`` renews them."""

import json
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from fringecal.records.audit_record import AuditRecord
from fringecal.records.board_calibration import BoardCalibrationRecord
from fringecal.records.calibration_record import CalibrationRecord
from fringecal.records.files import write_text
from fringecal.records.foreign.stated_record import PairDocument
from fringecal.records.lens_record import LensDocument
from fringecal.records.verification_record import VerificationRecord

SCHEMAS: dict[str, type[BaseModel]] = {
    "audit": AuditRecord,
    "board-calibration": BoardCalibrationRecord,
    "calibration": CalibrationRecord,
    "lens": LensDocument,
    "pair": PairDocument,
    "verification": VerificationRecord,
}
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def generate_schema(name: str) -> dict[str, Any]:
    """Generate the JSON Schema of a record from its model."""
    schema = SCHEMAS[name].model_json_schema(mode="validation")
    # A format that could be left out would let any JSON object pass for a record of that kind.
    schema["required"] = ["format", *schema["required"]]
    return {"$schema": _DIALECT, **schema}


def published_schema(name: str) -> dict[str, Any]:
    """Load the JSON Schema that ships with the package.

    Examples
    --------
    >>> published_schema("calibration")["properties"]["format"]["const"]
    'fringecal-calibration/1'
    """
    file = resources.files("fringecal.records") / "schema" / f"{name}.schema.json"
    return json.loads(file.read_text(encoding="utf-8"))


def write_schemas(folder: Path) -> None:
    """Write every schema into a folder, as the package ships them."""
    for name in SCHEMAS:
        write_text(folder / f"{name}.schema.json", json.dumps(generate_schema(name), indent=2) + "\n")


if __name__ == "__main__":
    write_schemas(Path(__file__).parent / "schema")
