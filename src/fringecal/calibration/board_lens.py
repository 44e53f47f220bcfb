"""The full lens from pictures of a board: which were used, what they say, and what a reader should know of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import MIN_VIEWS, BoardView, Lens, LensFit, Model, Solver, ViewFit, board_view, fit_lens
from fringecal.errors import DetectionError, FitError
from fringecal.targets import Target

Image = NDArray[np.generic]


#: A picture whose residual is this many times that of most is blurred, or its corners were mistaken.
_SUSPECT = 3.0


@dataclass(frozen=True)
class BoardPicture:
    """One picture of the board: its points, or why there are none."""

    name: str
    image: Image
    view: BoardView | None
    reason: str = ""


@dataclass(frozen=True)
class LensFindings:
    """What board pictures say of the lens.

    Parameters
    ----------
    pictures
        All pictures, also those without a board.
    target
        The board.
    fit
        The lens; its views are those of the pictures with a board, in their order.
    """

    pictures: tuple[BoardPicture, ...]
    target: Target
    fit: LensFit

    @property
    def found(self) -> tuple[tuple[BoardPicture, ViewFit], ...]:
        """Pictures that were used, and what the fit says of each."""
        shown = [picture for picture in self.pictures if picture.view is not None]
        used = [picture for k, picture in enumerate(shown) if k not in self.fit.dropped]
        return tuple(zip(used, self.fit.views, strict=True))

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the pictures that disagree with the others about the lens."""
        shown = [picture.name for picture in self.pictures if picture.view is not None]
        return tuple(shown[k] for k in self.fit.dropped)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know besides the numbers."""
        fit = self.fit
        missed = [picture for picture in self.pictures if picture.view is None]
        usual = float(np.median([view.rms_px for view in fit.views]))
        suspects = [p.name for p, view in self.found if view.rms_px > _SUSPECT * usual]
        notes = [
            f"{len(fit.views)} of {len(self.pictures)} pictures of {self.target.name} used; lens by {fit.solver}, "
            f"{fit.points} points, {fit.outliers} left out, {fit.rms_px:.3f} px rms.",
            _halves_note(fit),
            *_model_note(fit),
        ]
        if missed:
            notes.append(f"No board in {', '.join(p.name for p in missed)}: {missed[0].reason}.")
        if self.dropped:
            notes.append(f"Left out, most points disagree with the other pictures: {', '.join(self.dropped)}.")
        if suspects:
            notes.append(f"Residuals over {_SUSPECT:g} times the usual in {', '.join(suspects)}: blurred, or moved?")
        return tuple(notes)


def _halves_note(fit: LensFit) -> str:
    if fit.halves_px is None:
        return "Too few pictures for separate solutions from odd and even ones: errors of the lens model are not found."
    apart = float(np.nanmedian(fit.halves_px))
    if fit.inflation > 1:
        return (
            f"Lenses from odd and even pictures differ by {apart:.2g} px, {fit.inflation:.2g} times what the scatter "
            "explains; the uncertainty is enlarged by it."
        )
    return f"Lenses from odd and even pictures differ by {apart:.2g} px, no more than the scatter explains."


def _model_note(fit: LensFit) -> tuple[str, ...]:
    if fit.rich is None or fit.left_px is None:
        return ()
    left = float(np.sqrt(np.mean(fit.left_px**2)))
    return (
        f"{fit.rich.model} was fitted; Brown's lens, which the rig uses, follows it to {left:.2g} px rms (at most "
        f"{float(fit.left_px.max()):.2g} px), which is part of its uncertainty.",
    )


@dataclass(frozen=True)
class KnownLens:
    """The lens that a session states in a file, or that its board pictures give."""

    lens: Lens
    file: str | None = None
    findings: LensFindings | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the lens comes from, and what is not known of it."""
        if self.findings is not None:
            return self.findings.notes
        if self.lens.covariance_known:
            return (f"The lens is stated with its covariance by {self.file}.",)
        return (
            f"{self.file} states no covariance: focal length, principal point and distortion count as exact, and no "
            "uncertainty of the rig contains their contribution; take board pictures, or a file that fringecal wrote.",
        )


def lens_from_pictures(
    pictures: Sequence[tuple[str, Image]],
    target: Target,
    *,
    solver: Solver = "auto",
    model: Model = "brown",
    flat_board: bool = False,
) -> LensFindings:
    """Find a board in named grey pictures of one camera and fit the full lens.

    A picture without a board is noted and left aside.

    Raises
    ------
    DetectionError
        Fewer than three pictures show the board.
    FitError
        Pictures of different sizes, or poses that do not determine the lens.
    TargetError
        The target is no board.
    """
    shapes = {image.shape for _, image in pictures}
    if len(shapes) > 1:
        sizes = ", ".join(sorted(f"{shape[1]} x {shape[0]}" for shape in shapes))
        raise FitError(f"the pictures have different sizes ({sizes} px); a lens is fitted to pictures of one camera")
    looked = tuple(_looked_at(name, image, target) for name, image in pictures)
    views = [picture.view for picture in looked if picture.view is not None]
    if len(views) < MIN_VIEWS:
        reasons = "; ".join(f"{p.name}: {p.reason}" for p in looked[:3] if p.reason) or "all show it"
        raise DetectionError(
            f"{target.name} is found in {len(views)} of {len(looked)} pictures, {MIN_VIEWS} are needed ({reasons}). "
            "One square-on picture never yields a focal length: any focal length fits it equally well"
        )
    fit = fit_lens(views, looked[0].image.shape[:2], solver=solver, model=model, flat_board=flat_board)
    return LensFindings(looked, target, fit)


def _looked_at(name: str, image: Image, target: Target) -> BoardPicture:
    try:
        return BoardPicture(name, image, board_view(image, target))
    except DetectionError as error:
        return BoardPicture(name, image, None, str(error))
