"""A study on disk: what was asked, and one file for each rig, so that an interrupted study goes on where it stood."""

from pathlib import Path
from typing import Final, Literal

from pydantic import Field

from fringecal.errors import RecordError
from fringecal.records.documents import read_document, write_document
from fringecal.records.parts import EstimateRecord, Part

STUDY_FORMAT: Final = "fringecal-study/1"
RIG_FORMAT: Final = "fringecal-study-rig/1"
STUDY_FILE = "study.json"


class StudyRecord(Part):
    """What decides the results of a study: they belong together only if all of it is the same."""

    format: Literal["fringecal-study/1"] = STUDY_FORMAT
    seed: int = Field(ge=0)
    rig: str = Field(description="the one rig whose errors are drawn, or empty where every rig is another")
    heights_mm: tuple[float, ...]
    software: dict[str, str]


class Comparison(Part):
    """A quantity as found, and what is true."""

    name: str
    true: float
    found: EstimateRecord


class RigResult(Part):
    """What commissioning one rig of a study gave, or why it was refused."""

    format: Literal["fringecal-study-rig/1"] = RIG_FORMAT
    number: int = Field(ge=0)
    refused: str = Field(default="", description="message of the refusal; empty where the rig was commissioned")
    quantities: tuple[Comparison, ...] = ()


def open_study(folder: Path, asked: StudyRecord) -> None:
    """Begin a study in a folder, or make sure that the one that stands there is the same.

    Raises
    ------
    RecordError
        Another study stands there.
    """
    file = folder / STUDY_FILE
    if not file.exists():
        write_document(asked, file)
        return
    stands = read_document(file, StudyRecord, STUDY_FORMAT, file_name=STUDY_FILE)
    differs = [name for name in StudyRecord.model_fields if getattr(stands, name) != getattr(asked, name)]
    if differs:
        facts = "; ".join(f"{name} {getattr(stands, name)!r}, asked {getattr(asked, name)!r}" for name in differs)
        raise RecordError(
            f"{folder} holds results of another study ({facts}): they cannot be counted together. Name another "
            "folder, or ask for the same study to go on with it."
        )


def rig_file(folder: Path, number: int) -> Path:
    """Return where the result of one rig stands."""
    return folder / "rigs" / f"rig-{number:05d}.json"


def write_rig(folder: Path, result: RigResult) -> None:
    """Write the result of one rig, whole or not at all."""
    write_document(result, rig_file(folder, result.number))


def read_rigs(folder: Path, numbers: range) -> dict[int, RigResult]:
    """Return the results that stand in a folder, by the number of the rig.

    Raises
    ------
    RecordError
        A result cannot be read, or stands under another rig's name.
    """
    files = {number: rig_file(folder, number) for number in numbers}
    found = {
        number: read_document(file, RigResult, RIG_FORMAT, file_name=file.name)
        for number, file in files.items()
        if file.exists()
    }
    for number, result in found.items():
        if result.number != number:
            raise RecordError(f"{files[number]}: holds rig {result.number}; remove it to have it computed again")
    return found
