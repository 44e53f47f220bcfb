"""One base error and its few children: each says what was found, what was needed and what to do."""

from collections.abc import Sequence


class FringecalError(Exception):
    """Anything that stops a job for a reason the user can act on."""


class TargetError(FringecalError):
    """A target file that cannot be read or contradicts itself."""


class SessionError(FringecalError):
    """A session folder with faults; all of them are listed, not only the first.

    Parameters
    ----------
    faults
        One sentence per fault: where, what was found, what to do.
    """

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(self.faults))


class DetectionError(FringecalError):
    """The picture does not show what was to be found in it."""


class PhaseError(FringecalError):
    """Frames from which no trustworthy phase can be computed."""


class FitError(FringecalError):
    """A fit whose answer must not be used: badly conditioned, unresolved order or structured residuals."""


class RecordError(FringecalError):
    """A calibration record or result file that cannot be read, written or applied."""


class HistoryError(FringecalError):
    """A history that cannot be opened, read or added to, or that holds too little for what was asked."""
