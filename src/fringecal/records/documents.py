"""Records as JSON documents: read with a reason for every refusal, written whole or not at all."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from fringecal.errors import RecordError
from fringecal.guarded import MOST_JSON, Refusal, bytes_of, is_folder, json_of, quoted, shortened, text_of
from fringecal.records.files import write_text
from fringecal.records.parts import Digested

# What is asked for in vain most often, since it stands in files of the same name.
_OTHERS = {
    "fringecal-board-calibration/1": "a calibration by a board in poses, which `fringecal reconstruct` uses and this "
    "does not yet"
}
_ANOTHER = "another kind of file"
_SHOWN_FAULTS = 8  # of a document; one slip often makes many, and the first few show it


def read_document[Record: BaseModel](path: str | Path, model: type[Record], form: str, *, file_name: str) -> Record:
    """Read one record and check it against its model.

    Parameters
    ----------
    path
        The JSON file, or the folder that holds it under `file_name`.
    model
        Pydantic model of the record.
    form
        Format name and version that the model reads, for example ``"fringecal-calibration/1"``.

    Raises
    ------
    RecordError
        The file is missing, not JSON, of another or a newer format, or does not fit the model.
    """
    file = Path(path) / file_name if is_folder(path) else Path(path)
    return document_of_bytes(record_bytes(file), model, form, name=str(file))


def record_bytes(file: Path) -> bytes:
    """Read the bytes of a record's file.

    Raises
    ------
    RecordError
        They cannot be read, or are more than a record has.
    """
    try:
        return bytes_of(file, MOST_JSON)
    except Refusal as error:
        raise RecordError(f"{file}: {error}; give a record file") from error


def document_of_bytes[Record: BaseModel](content: bytes, model: type[Record], form: str, *, name: str) -> Record:
    """Check the bytes of a record against its model; a record keeps their hash (`file_sha256`).

    Raises
    ------
    RecordError
        As `parse_document`.
    """
    try:
        text = text_of(content)
    except Refusal as error:
        raise RecordError(f"{name}: {error}") from error
    record = parse_document(text, model, form, name=name)
    if isinstance(record, Digested):
        record.mark_read_from(hashlib.sha256(content).hexdigest())
    return record


def parse_document[Record: BaseModel](text: str, model: type[Record], form: str, *, name: str) -> Record:
    """Check the text of a record against its model; `name` is what a refusal calls it.

    Raises
    ------
    RecordError
        The text is not JSON, of another or a newer format, or does not fit the model.
    """
    document = json_document(text, name)
    _demand_format(name, document.get("format"), form)
    try:
        record = model.model_validate_json(json.dumps(document), strict=True)
    except ValidationError as error:
        raise RecordError(f"{name}: {_faults(error)}") from error
    if isinstance(record, Digested) and record.digest not in (None, digest_of(document)):
        record.mark_edited()
    return record


def write_document(record: BaseModel, path: str | Path) -> Path:
    """Write a record as readable JSON in place of what stood at `path`, and return the path.

    Raises
    ------
    RecordError
        The record holds NaN or infinity in a free field, or the file cannot be written.
    """
    try:
        text = to_json(record)
    except ValueError as error:
        raise RecordError(f"{path}: the record holds a number that JSON cannot ({error})") from error
    return write_text(path, text)


def digest_of(document: Mapping[str, Any]) -> str:
    """Give the SHA-256 of a document's content, whatever its layout, as lower-case hex.

    Hashed is the document without its key ``digest``, as JSON with sorted keys, ``","`` and ``":"`` without spaces, and
    every character beyond ASCII escaped; numbers have the fewest digits that give them back (RFC 8785 is close to it,
    but writes some numbers otherwise).

    Examples
    --------
    >>> digest_of({"b": 1.0, "a": "x"}) == digest_of({"a": "x", "digest": "0" * 64, "b": 1.00})
    True
    """
    content = {name: value for name, value in document.items() if name != "digest"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def written_document(record: BaseModel) -> dict[str, Any]:
    """Return a record as it is written: as plain values, with the digest of its content last."""
    document = record.model_dump(mode="json")
    if isinstance(record, Digested):
        document = {name: value for name, value in document.items() if name != "digest"}
        document["digest"] = digest_of(document)
    return document


def to_json(record: BaseModel) -> str:
    """Print a record as indented JSON with its digest, each list of plain numbers on one line."""
    text = json.dumps(written_document(record), indent=2, ensure_ascii=False, allow_nan=False)
    # A raw line break cannot occur inside a JSON string, so only true lists of numbers match.
    return re.sub(r"\[\n\s+([^\[\]{}\"]*?)\n\s*\]", _on_one_line, text) + "\n"


def _on_one_line(match: re.Match[str]) -> str:
    return "[" + re.sub(r"\s*\n\s*", " ", match.group(1)) + "]"


def json_document(text: str, name: str) -> dict[str, Any]:
    """Return the JSON object that a text holds.

    Raises
    ------
    RecordError
        It holds none, or one beyond the limits of what is read.
    """
    try:
        return json_of(text)
    except Refusal as error:
        raise RecordError(f"{name}: {error}") from error


def _demand_format(where: str, found: object, needed: str) -> None:
    name, version = needed.split("/")
    match = re.fullmatch(rf"{re.escape(name)}/([0-9]{{1,9}})", found) if isinstance(found, str) else None
    if match is None:
        kind = _OTHERS.get(found, _ANOTHER) if isinstance(found, str) else _ANOTHER
        raise RecordError(f"{where}: format is {quoted(found)}, needed {needed!r}; this is {kind}")
    if int(match[1]) > int(version):
        raise RecordError(f"{where}: format {found!r} is newer than {needed!r}, the newest read here; update fringecal")
    if match[0] != needed:
        raise RecordError(f"{where}: format {found!r} is unknown, needed {needed!r}")


def _place(keys: tuple[int | str, ...]) -> str:
    return shortened(".".join(map(str, keys))) or "record"


def _faults(error: ValidationError) -> str:
    faults = [f"{_place(fault['loc'])}: {shortened(fault['msg'])}" for fault in error.errors()]
    more = f"; and {len(faults) - _SHOWN_FAULTS} more" if len(faults) > _SHOWN_FAULTS else ""
    return "does not fit its format: " + "; ".join(faults[:_SHOWN_FAULTS]) + more
