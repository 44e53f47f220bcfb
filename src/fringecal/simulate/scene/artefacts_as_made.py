"""Artefacts as they are, drawn about what is stated of them, so that a virtual rig is wrong by what its budget says."""

import zlib

import numpy as np
from pydantic import BaseModel

from fringecal.simulate.rig.rig_spec import CaptureSpec, RigSpec
from fringecal.simulate.scene.capture_scenes import stated_target
from fringecal.targets import Quantity, Target

_NO_SIZES = frozenset({"flatness_mm", "parallelism_mm"})  # largest departures from a form, not sizes of it


def true_target(rig: RigSpec, capture: CaptureSpec) -> Target | None:
    """Return what a capture shows: the artefact as stated, or as it is made where the rig's artefacts are drawn."""
    stated = stated_target(capture)
    if stated is None or rig.stated.artefact_seed is None:
        return stated
    return as_made(stated, rig.stated.artefact_seed)


def as_made(stated: Target, seed: int) -> Target:
    """Draw an artefact's true sizes, each normal about what is stated with its u.

    Its name and the seed decide them, so that it is the same object in every session. A number that stands for several
    items is in error by one amount for all; of values in a list each has its own, but for the heights of strips
    without an instrument, whose u is common. What an instrument adds is one error for all that it measured.

    Parameters
    ----------
    stated
        The artefact as its file states it.
    seed
        Of all artefacts of a rig.
    """
    instrument = stated.instrument_u_mm * float(_stream(seed, stated.instrument or stated.name).standard_normal())
    changes: dict[str, Quantity] = {}
    for name in type(stated).model_fields:
        quantity = getattr(stated, name)
        if isinstance(quantity, Quantity) and name.endswith(("_mm", "_deg")) and name not in _NO_SIZES:
            rng = _stream(seed, f"{stated.name}: {name}")
            common = _common(stated, name)
            changes[name] = _drawn(quantity, rng, common=common, added=instrument if name.endswith("_mm") else 0.0)
    return stated.model_copy(update=changes)


def _common(stated: BaseModel, name: str) -> bool:
    """Whether all values of a list are in error by the same number of their u."""
    return name == "height_mm" and getattr(stated, "kind", "") == "strips" and not getattr(stated, "instrument_u_mm", 0)


def _drawn(quantity: Quantity, rng: np.random.Generator, *, common: bool, added: float) -> Quantity:
    errors = rng.standard_normal() * np.ones(len(quantity.us)) if common else rng.standard_normal(len(quantity.us))
    values = np.array(quantity.values) + np.array(quantity.us) * errors + added
    true = tuple(values.tolist()) if isinstance(quantity.value, tuple) else float(values[0])
    return quantity.model_copy(update={"value": true})


def _stream(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
