"""What made a result: versions of the software, and the hash of a file."""

import functools
import hashlib
import platform
from importlib import metadata
from pathlib import Path

import numpy as np

from fringecal import __version__
from fringecal.errors import RecordError

_PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "numba", "lmfit", "mrcal", "pydantic")


PROCESSOR = "processor"
"""Key of the kind of processor among the versions: other vector instructions round otherwise."""


def software_versions() -> dict[str, str]:
    """Give the versions of the toolkit, of Python, and of the packages that numbers depend on.

    The kind of processor stands among them, since vector instructions round differently.
    Packages that are not installed (mrcal is optional) are left out.

    Examples
    --------
    >>> {"fringecal", "python", "numpy"} <= set(software_versions())
    True
    """
    return {"fringecal": __version__, "python": platform.python_version(), **_installed(), PROCESSOR: _processor()}


@functools.cache
def _processor() -> str:
    """Name the machine and the last group of vector instructions that NumPy found on it."""
    found = np.show_config(mode="dicts").get("SIMD Extensions", {}).get("found", [])
    return " ".join([platform.machine(), *found[-1:]])


@functools.cache
def _installed() -> dict[str, str]:
    """Read the packages' own files once: all that are installed take half a second."""
    versions = {(entry.name or "").lower(): entry.version for entry in metadata.distributions()}
    return {name: versions[name] for name in _PACKAGES if name in versions}


def sha256_of(path: str | Path) -> str:
    """Give the SHA-256 of a file as lower-case hex.

    Raises
    ------
    RecordError
        The file cannot be read.
    """
    try:
        with Path(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror or error})") from error
