"""A calibration that another program made, or a list of places that belong together: judged, and put on record."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from fringecal.calibration import KnownLens
from fringecal.camera import Doubt, Lens, lens_doubts
from fringecal.errors import FitError, RecordError
from fringecal.guarded import Refusal, bytes_of
from fringecal.projector import (
    BoardPose,
    PairsFound,
    PointPairs,
    StatedPair,
    doubts_by_pairs,
    fit_board_rig,
    judge_pairs,
    pair_doubts,
    stated_from_rig,
)
from fringecal.records import (
    MOST_PAIRS_FILE,
    DoubtRecord,
    PairDocument,
    PairsRecord,
    read_point_pairs,
    read_stated,
    software_versions,
)
from fringecal.workflows.lens.record import lens_record

Size = tuple[int, int]
Verdict = Literal["pass", "conditionalPass", "fail"]


@dataclass(frozen=True)
class Judged:
    """A stated calibration with what speaks against it.

    Parameters
    ----------
    stated
        Camera and projector, or the lens of a camera alone.
    doubts
        What speaks against it; nothing if it is empty.
    inputs
        SHA-256 by file.
    pairs, pairs_file
        What given places say of it, and the file that gives them.
    notes
        What a reader should know besides.
    """

    stated: StatedPair | Lens
    doubts: tuple[Doubt, ...]
    inputs: dict[str, str]
    pairs: PairsFound | None = None
    pairs_file: str = ""
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Fail where something is refused, conditional where something is open."""
        if any(doubt.refused for doubt in self.doubts):
            return "fail"
        return "conditionalPass" if self.doubts else "pass"

    @property
    def kind(self) -> str:
        """Whose format the files have."""
        return self.stated.kind if isinstance(self.stated, StatedPair) else "lens"

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        refused = [doubt for doubt in self.doubts if doubt.refused]
        if refused:
            return f"Not to be trusted: {_listed(refused)}."
        if self.doubts:
            return f"Nothing refuses it, but open are: {_listed(self.doubts)}."
        return "Nothing speaks against it."


def judge_files(
    paths: Sequence[Path],
    *,
    camera_size: Size | None = None,
    projector_size: Size | None = None,
    unit_mm: float | None = None,
    pixel_aspect: float | None = None,
    pairs: Path | None = None,
) -> Judged:
    """Read a calibration and say what speaks against it.

    Parameters
    ----------
    paths, camera_size, projector_size, unit_mm
        As for `fringecal.records.read_stated`.
    pixel_aspect
        Distance of the projector's rows over that of its columns, where it is known.
    pairs
        File with places that belong together, which were seen with this rig: an independent judge.

    Raises
    ------
    RecordError
        A file cannot be read, or pairs are given for a lens alone.
    """
    stated = read_stated(paths, camera_size=camera_size, projector_size=projector_size, unit_mm=unit_mm)
    inputs = _hashes(paths)
    if isinstance(stated, Lens):
        if pairs is not None:
            raise RecordError(f"{paths[0]}: holds one lens; places in two pictures need a camera and a projector")
        return Judged(stated, lens_doubts(stated), inputs)
    doubts = pair_doubts(stated, pixel_aspect=pixel_aspect)
    if pairs is None:
        return Judged(stated, doubts, inputs, notes=stated.notes)
    found = judge_pairs(stated, read_point_pairs(pairs))
    doubts += doubts_by_pairs(found)
    return Judged(stated, doubts, inputs | _hashes([pairs]), found, pairs.name, stated.notes)


def judge_points(
    path: Path, *, camera_size: Size | None, projector_size: Size | None, pixel_aspect: float | None = None
) -> Judged:
    """Calibrate a camera and a projector by a list of places on a board, and say what speaks against it.

    Parameters
    ----------
    path
        File with a board's points in several poses, as `fringecal.records.read_point_pairs` reads it.
    camera_size, projector_size
        Width and height of the picture and of the projector's frame, px; no list states them.
    pixel_aspect
        Distance of the projector's rows over that of its columns, where it is known.

    Raises
    ------
    RecordError
        The file cannot be read, or lacks the board's points or the sizes.
    FitError
        The poses do not determine the rig.
    """
    poses = read_point_pairs(path)
    if camera_size is None or projector_size is None:
        raise RecordError(f"{path}: a list of places states no sizes; give --camera-size and --projector-size")
    if any(pose.board_mm is None for pose in poses):
        raise RecordError(
            f"{path}: the board's points (x_mm, y_mm or board_mm) are missing; a rig is solved for by them"
        )
    try:
        fit = fit_board_rig(
            [_board_pose(pose) for pose in poses],
            camera_size,
            projector_size,
            projector_aspect=1 / (pixel_aspect or 1.0),
        )
    except FitError as error:
        raise FitError(f"{path}: {error}") from error
    stated = stated_from_rig(fit.rig)
    notes = (
        f"Solved from {sum(len(pose.camera_px) for pose in poses)} places in {len(poses)} poses of the board: "
        f"{fit.stereo_rms_px:.3f} px rms over both pictures. Lengths are those of the board, whose print "
        "counts as exact.",
    )
    return Judged(stated, pair_doubts(stated, pixel_aspect=pixel_aspect), _hashes([path]), notes=notes)


def judged_document(judged: Judged, *, command: tuple[str, ...] = ()) -> PairDocument:
    """Return the record of what was found."""
    stated = judged.stated
    pair = stated if isinstance(stated, StatedPair) else None
    names = " and ".join(judged.inputs)
    camera = stated.camera if isinstance(stated, StatedPair) else stated
    return PairDocument(
        software=software_versions(),
        command=command,
        inputs=judged.inputs,
        decision=judged.verdict,
        kind=judged.kind,
        camera=lens_record(KnownLens(camera, file=names)),
        projector=None if pair is None else lens_record(KnownLens(pair.projector, file=names)),
        rotation=None if pair is None else tuple(tuple(map(float, row)) for row in pair.rotation),
        shift_mm=None if pair is None else tuple(map(float, pair.shift_mm)),
        doubts=tuple(DoubtRecord.model_validate(asdict(doubt)) for doubt in judged.doubts),
        pairs=None if judged.pairs is None else _pairs_record(judged.pairs, judged.pairs_file),
        notes=judged.notes,
    )


def _pairs_record(found: PairsFound, file: str) -> PairsRecord:
    numbers = {name: value if math.isfinite(value) else None for name, value in asdict(found).items()}
    return PairsRecord.model_validate({"file": file, **numbers})


def _board_pose(pose: PointPairs) -> BoardPose:
    assert pose.board_mm is not None  # whoever asks has seen it
    return BoardPose(np.asarray(pose.board_mm), pose.camera_px, pose.projector_px)


def _listed(doubts: Sequence[Doubt]) -> str:
    return ", ".join(dict.fromkeys(f"{doubt.subject}: {doubt.name}" for doubt in doubts))


def _hashes(paths: Sequence[Path]) -> dict[str, str]:
    try:
        return {path.name: hashlib.sha256(bytes_of(path, MOST_PAIRS_FILE)).hexdigest() for path in paths}
    except Refusal as error:
        raise RecordError(f"{paths[0]}: {error}") from error
