"""An artefact's numbers beside its certificate: error, uncertainty of both, and what the uncertainty is made of."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.uncertainty import Budget, Estimate, Influence, UncertaintyComponent, combined, en_score
from fringecal.verification.forms.probes import Numbers, Probe
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface

ByComponent = Callable[[Floats, Floats, Floats], Iterable[tuple[UncertaintyComponent, Floats]]]

_MOST = 6000  # points of a group that are moved by each component: a smooth change needs no more
_DRAW_SEED = 2634  # of the draw of those points: any number serves, and a fixed one repeats the readings
_BLOCKS_ACROSS, _BLOCKS_ALONG = 4, 6
_BLOCKS = _BLOCKS_ACROSS * _BLOCKS_ALONG  # of the picture, left out in turn; neighbours share their errors


@dataclass(frozen=True)
class Reading:
    """One number of an artefact.

    Parameters
    ----------
    name, unit
        What it is.
    measured
        From all points of the artefact.
    reference, u_reference
        The certified value and its standard uncertainty; None where the certificate says nothing.
    u_measured
        Standard uncertainty of the measured value: the calibration's, and the scatter between parts of the picture;
        None for a form error, which contains the noise by definition.
    budget
        The components of `u_measured`; None for a form error.
    points
        Number of points.
    shared
        Covariance of measured and certified value, in the unit squared: what one instrument's calibration, by which
        both the rig's artefacts and this one were measured, does to both.
    """

    name: str
    unit: str
    measured: float
    reference: float | None
    u_reference: float
    u_measured: float | None
    points: int
    budget: Budget | None = None
    shared: float = 0.0

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of `u_measured`."""
        return math.inf if self.budget is None else self.budget.result.dof

    @property
    def error(self) -> float | None:
        """Measured minus certified value."""
        return None if self.reference is None else self.measured - self.reference

    @property
    def en(self) -> float | None:
        """Measured against certified value, `en_score`; None where one of them or all uncertainty is missing."""
        if self.reference is None or self.u_measured is None or not max(self.u_measured, self.u_reference) > 0:
            return None
        measured = Estimate(self.measured, self.u_measured, self.unit, self.name, self.dof)
        if self.shared:
            u = math.sqrt(max(self.u_measured**2 + self.u_reference**2 - 2 * self.shared, 0.0))
            # By Welch and Satterthwaite: all finite degrees of freedom are those of the measured value.
            dof = self.dof * (u / self.u_measured) ** 4 if self.u_measured > 0 else math.inf
            return en_score(Estimate(self.measured - self.reference, u, self.unit, self.name, dof)) if u > 0 else None
        return en_score(measured, Estimate(self.reference, self.u_reference, self.unit))


def take_readings(
    probe: Probe,
    surface: Surface,
    by_component: ByComponent,
    *,
    instrument: tuple[str | None, float] = (None, 0.0),
    thermal_rel_u: float = 0.0,
    seed: int = _DRAW_SEED,
) -> tuple[Reading, ...]:
    """Evaluate a probe on a surface.

    Parameters
    ----------
    probe
        Pixels and numbers of the artefact.
    surface
        The height map that it was found in.
    by_component
        `by_component(u_px, v_px, z_mm)` yields every component of the calibration's uncertainty and the moved points
        (n, 3); see `fringecal.reconstruct.perturbed.points_by_component`.
    instrument
        What the artefact's lengths were measured with, and the standard uncertainty of its calibration, mm: all of them
        have it in common, with the rig's artefacts as well where these were measured with the same instrument.
    thermal_rel_u
        What temperature adds to u of all of the artefact's lengths, relative; the rig's artefacts have it in common.
    seed
        Of the draw of points that each component moves.
    """
    cloud = np.stack([np.asarray(m, float) for m in (surface.x, surface.y, surface.z)], axis=-1).reshape(-1, 3)
    width = np.shape(surface.z)[1]
    measured = probe.numbers([cloud[group] for group in probe.groups])
    thin = [_thinned(group, seed) for group in probe.groups]
    base = probe.numbers([cloud[group] for group in thin])
    changes = _changes(probe, thin, cloud, width, base, by_component)
    scatter = _jackknife(probe, thin, cloud, width)
    points = sum(group.size for group in probe.groups)
    readings = []
    for name, value in measured.items():
        reference = probe.references.get(name)
        unit = probe.units.get(name, "mm")
        components = [replace(component, effect=change[name]) for component, change in changes]
        own = UncertaintyComponent(Influence.ARTEFACT_SCATTER, scatter[name], _BLOCKS - 1)
        certified = unit == "mm" and reference is not None and name not in probe.forms
        common = instrument[1] if certified else 0.0
        warm = thermal_rel_u * abs(reference.value) if certified and reference is not None else 0.0
        both = sum(float(c.effect) for c in components if is_common(c.influence, c.detail, instrument[0]))
        heat = sum(float(c.effect) for c in components if c.influence is Influence.TEMPERATURE)
        budget = None if name in probe.forms else combined(value, [*components, own], unit=unit, label=name)
        readings.append(
            Reading(
                name=name,
                unit=unit,
                measured=value,
                reference=None if reference is None else reference.value,
                u_reference=0.0 if reference is None else math.hypot(reference.u, common, warm),
                u_measured=None if budget is None else budget.result.u,
                points=points,
                budget=budget,
                shared=common * both + warm * heat,
            )
        )
    return tuple(readings)


def is_common(influence: Influence, detail: str, instrument: str | None) -> bool:
    """Return whether a component of the rig is the calibration of the instrument that measured an artefact.

    Examples
    --------
    >>> is_common(Influence.INSTRUMENT, "caliper 3", "caliper 3"), is_common(Influence.TEMPERATURE, "", "caliper 3")
    (True, False)
    """
    return influence is Influence.INSTRUMENT and instrument is not None and detail == instrument


def readings_table(readings: Sequence[Reading]) -> pd.DataFrame:
    """Return readings as a table, one row each."""
    columns = ("name", "unit", "measured", "reference", "error", "u_measured", "dof", "u_reference", "en", "points")
    return pd.DataFrame([{c: getattr(r, c) for c in columns} for r in readings])


def _thinned(group: NDArray[np.intp], seed: int) -> NDArray[np.intp]:
    if group.size <= _MOST:
        return group
    return np.sort(np.random.default_rng(seed).permutation(group)[:_MOST])


def _changes(  # noqa: PLR0913, PLR0917 -- private: what moves, and where
    probe: Probe, groups: list[NDArray[np.intp]], cloud: Floats, width: int, base: Numbers, by_component: ByComponent
) -> list[tuple[UncertaintyComponent, Numbers]]:
    """Change of every number under each component of the calibration's uncertainty."""
    every = np.concatenate(groups)
    cuts = np.cumsum([group.size for group in groups])[:-1]
    pixels = (every % width).astype(float), (every // width).astype(float)
    return [
        (component, {name: value - base[name] for name, value in probe.numbers(np.split(moved, cuts)).items()})
        for component, moved in by_component(*pixels, cloud[every, 2])
    ]


def _jackknife(probe: Probe, groups: list[NDArray[np.intp]], cloud: Floats, width: int) -> Numbers:
    """Standard uncertainty of every number from leaving out one block of each group at a time."""
    blocks = [_block_of(group, width) for group in groups]
    found = [probe.numbers([cloud[g[b != k]] for g, b in zip(groups, blocks, strict=True)]) for k in range(_BLOCKS)]
    return {
        name: math.sqrt((_BLOCKS - 1) / _BLOCKS * float(np.sum((v - v.mean()) ** 2)))
        for name in found[0]
        for v in [np.array([f[name] for f in found])]
    }


def _block_of(group: NDArray[np.intp], width: int) -> NDArray[np.intp]:
    """Number each pixel's block, across and along the picture, each with the same number of pixels."""
    row, column = np.divmod(group, width)
    across = np.argsort(np.argsort(column, kind="stable")) * _BLOCKS_ACROSS // group.size
    block = np.empty(group.size, np.intp)
    for k in range(_BLOCKS_ACROSS):
        inside = np.flatnonzero(across == k)
        rank = np.argsort(np.argsort(row[inside], kind="stable"))
        block[inside] = k * _BLOCKS_ALONG + rank * _BLOCKS_ALONG // max(inside.size, 1)
    return block
