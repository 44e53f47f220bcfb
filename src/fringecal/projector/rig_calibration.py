"""A calibrated rig: camera and rig model as one parameter vector, with its covariance split by influence.

Every influence (strip height, grid pitch, camera height, scatter of phase) is an uncertainty component: what one
standard uncertainty of it does to all parameters at once. Any quantity's budget is its change under each component.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import CAMERA_NAMES, CameraFit, PlateCamera
from fringecal.numerics import DRAW_SEED, powers_up_to
from fringecal.phase import PlateLook, PlateOrders, Waveform
from fringecal.projector.joint_fit import PhasePoints, RigFit, fit_rig
from fringecal.projector.plate_form import PlateForm, form_height
from fringecal.projector.rig_model import RESIDUAL_DEGREE, RIG_NAMES, PlateResidual, RigModel, projector_point
from fringecal.uncertainty import Budget, Estimate, Influence, Source, UncertaintyComponent, combined

Array = NDArray[np.float64]

NOT_STATED = "(not stated)"
"""Detail of a source of which nothing is stated: its component has no effect, and its row says why."""
#: What all artefacts share that name it: one and the same error of all of them.
_OF_WHOLE_SETS = frozenset({Influence.INSTRUMENT, Influence.TEMPERATURE, Influence.STRIP_PAINT, Influence.TRANSLUCENCY})
#: What each strip has for itself.
OF_SINGLE_STRIPS = frozenset({Influence.STRIP_HEIGHT, Influence.STRIP_SEATING, Influence.STRIP_PARALLELISM})
_MANY = 4  # components of one source from which on its principal axes are fewer
_NEGLIGIBLE = 1e-4  # axes below this share of the variance only cost time


@dataclass(frozen=True)
class RigCalibration:
    """Camera, rig model and the components of their joint uncertainty, whose effects run over all parameters.

    The parameter vector is camera (`CAMERA_NAMES`), rig (`RIG_NAMES`), coefficients of the plate residual. `wave` is
    the waveform of the fringes as found on the plate, `orders` how further periods number them, `look` what the plate
    looked like.
    """

    camera: PlateCamera
    model: RigModel
    components: tuple[UncertaintyComponent, ...]
    excess_rad: float = 0.0
    wave: Waveform | None = None
    orders: PlateOrders | None = None
    look: PlateLook | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of `vector`."""
        terms = powers_up_to(self.model.residual.degree)
        return (
            *(f"camera.{n}" for n in CAMERA_NAMES),
            *(f"rig.{n}" for n in RIG_NAMES),
            *(f"plate_residual.{i}.{j}" for i, j in terms),
        )

    @property
    def vector(self) -> Array:
        """All parameters."""
        coefficients = self.model.residual.coefficients
        return np.concatenate([self.camera.parameters, self.model.parameters, coefficients])

    @property
    def covariance(self) -> Array:
        """Joint covariance of `vector`: the sum over all components."""
        size = self.vector.size
        return sum((np.outer(c.effect, c.effect) for c in self.components), np.zeros((size, size)))

    def shifted(self, component: UncertaintyComponent) -> "RigCalibration":
        """Return the calibration with one standard uncertainty of an influence added."""
        return self.replaced(self.vector + component.effect)

    def replaced(self, vector: Array) -> "RigCalibration":
        """Return the calibration with other parameter values."""
        cut = len(CAMERA_NAMES)
        residual = replace(self.model.residual, coefficients=vector[cut + len(RIG_NAMES) :])
        parameters = vector[cut : cut + len(RIG_NAMES)]
        projector = projector_point(parameters, near=self.model.projector_mm)
        model = RigModel(parameters, projector, residual)
        return replace(self, camera=self.camera.replaced(vector[:cut]), model=model)

    def changes(self, quantity: Callable[["RigCalibration"], ArrayLike]) -> Array:
        """Return a quantity's change under one standard uncertainty of each influence, shape (components, ...)."""
        base = np.asarray(quantity(self), float)
        moved = [np.asarray(quantity(self.shifted(component)), float) - base for component in self.components]
        return np.stack(moved) if moved else np.zeros((0, *base.shape))

    def budget(self, quantity: Callable[["RigCalibration"], float], *, unit: str, label: str) -> Budget:
        """Return a quantity with its uncertainty and the components of it: its change under each."""
        pairs = zip(self.components, self.changes(quantity), strict=True)
        components = [replace(component, effect=float(change)) for component, change in pairs]
        return combined(quantity(self), components, unit=unit, label=label)


@dataclass(frozen=True)
class Observations:
    """What a rig is fitted to, in pixels: the plate, then artefacts of known height.

    `u_px`, `v_px`, `phase_rad`, `cluster` hold one array per surface; `height_mm` one estimate each (0 for the
    plate), which names its influence. Where a surface is not level, `relief_mm` is added to its height pixel
    by pixel, and `components` holds uncertainty components beside the height's own: effects in mm, one number or
    one for each pixel. `form` is the plate's, which all that lies on it follows; None takes it for a plane without a
    word. `parts` splits a height's own u, which then only weighs it in the fit, into what it is made of: effects in mm,
    one for each pixel. A part of one source that several surfaces have is one and the same error of all of them.
    """

    u_px: tuple[Array, ...]
    v_px: tuple[Array, ...]
    phase_rad: tuple[Array, ...]
    cluster: tuple[NDArray[np.intp], ...]
    height_mm: tuple[Estimate, ...]
    relief_mm: tuple[float | Array, ...] = ()
    components: tuple[tuple[UncertaintyComponent, ...], ...] = ()
    form: PlateForm | None = None
    parts: tuple[tuple[UncertaintyComponent, ...] | None, ...] = ()

    def components_of(self, surface: int) -> tuple[UncertaintyComponent, ...]:
        """Return all components of the uncertainty of a surface's height, its own first."""
        height = self.height_mm[surface]
        own = (UncertaintyComponent.of(height),) if height.u > 0 else ()
        return (*own, *(self.components[surface] if self.components else ()))

    def errors(self) -> list[tuple[UncertaintyComponent, dict[int, float | Array]]]:
        """Return every error of the heights: its component, and by how much one u of it changes which surface, mm."""
        found: list[tuple[UncertaintyComponent, dict[int, float | Array]]] = []
        shared: dict[Source, dict[int, float | Array]] = {}
        for surface in range(len(self.height_mm)):
            parts = self.parts[surface] if self.parts else None
            own = self.components_of(surface)
            if parts is not None:
                own = (*parts, *own[int(self.height_mm[surface].u > 0) :])
            for one in own:
                changed = shared.setdefault(one.source, {}) if one.influence in _OF_WHOLE_SETS else {}
                if not changed:
                    found.append((one, changed))
                changed[surface] = one.effect
        return found

    def surfaces(
        self,
        camera: PlateCamera,
        *,
        raised: Mapping[int, float | Array] | None = None,
        bent_mm: Array | None = None,
    ) -> list[PhasePoints]:
        """Return the points as this camera sees them.

        Parameters
        ----------
        camera
            The camera on the plate.
        raised
            By how much the heights of which surface are changed, mm.
        bent_mm
            Coefficients that are added to the plate's form.
        """
        made = []
        for i, height in enumerate(self.height_mm):
            changes = tuple(component.effect for component in self.components_of(i))
            z = height.value + (self.relief_mm[i] if self.relief_mm else 0.0)
            if raised is not None and i in raised:
                z = z + raised[i]
            rays = camera.rays(self.u_px[i], self.v_px[i])
            z = z + self._form_mm(*rays.at(z), bent_mm)
            made.append(PhasePoints(rays, z, self.phase_rad[i], self.cluster[i], changes))
        return made

    def _form_mm(self, x_mm: Array, y_mm: Array, bent_mm: Array | None) -> float | Array:
        """Return the plate's form under points of the plate frame; the number 0 for a plane."""
        if self.form is None:
            return 0.0
        whole = self.form.coefficients_mm + (0.0 if bent_mm is None else bent_mm)
        return form_height(whole, self.form.box, x_mm, y_mm) if np.any(whole) else 0.0

    def thinned(self, number: int, *, seed: int = DRAW_SEED) -> "Observations":
        """Return at most so many points of every surface, drawn evenly."""
        rng = np.random.default_rng(seed)
        chosen = [np.sort(rng.permutation(u.size)[:number]) for u in self.u_px]

        def few(values: Sequence[Array]) -> tuple[Array, ...]:
            return tuple(v[c] if np.ndim(v) else v for v, c in zip(values, chosen, strict=True))

        def thin(row: Sequence[UncertaintyComponent], points: NDArray[np.intp]) -> tuple[UncertaintyComponent, ...]:
            return tuple(replace(c, effect=c.effect[points]) if np.ndim(c.effect) else c for c in row)  # type: ignore[index]

        components = tuple(map(thin, self.components, chosen)) if self.components else ()
        relief = few(self.relief_mm) if self.relief_mm else ()  # type: ignore[arg-type]
        clusters = tuple(k[c] for k, c in zip(self.cluster, chosen, strict=True))
        parts = tuple(
            None if row is None else thin(row, c) for row, c in zip(self.parts, chosen, strict=bool(self.parts))
        )
        return replace(
            self, u_px=few(self.u_px), v_px=few(self.v_px), phase_rad=few(self.phase_rad),
            cluster=clusters, relief_mm=relief, components=components, parts=parts,
        )  # fmt: skip

    def joined(self, other: "Observations") -> "Observations":
        """Return these surfaces followed by those of another."""
        return Observations(
            self.u_px + other.u_px,
            self.v_px + other.v_px,
            self.phase_rad + other.phase_rad,
            self.cluster + other.cluster,
            self.height_mm + other.height_mm,
            sum((o.relief_mm or (0.0,) * len(o.height_mm) for o in (self, other)), ()),
            sum((o.components or ((),) * len(o.height_mm) for o in (self, other)), ()),
            self.form,
            sum((o.parts or (None,) * len(o.height_mm) for o in (self, other)), ()),
        )


def calibrate_rig(
    observations: Observations,
    camera_fit: CameraFit,
    *,
    residual_degree: int = RESIDUAL_DEGREE,
    projector_near: Array | None = None,
    phase_sigma_rad: float = 0.0,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[RigCalibration, RigFit]:
    """Fit the rig to all surfaces at once and carry every stated uncertainty through the fit.

    Parameters
    ----------
    observations
        Plate first, then surfaces of known height.
    camera_fit
        The camera on the plate with the components of its uncertainty.
    residual_degree
        Total degree of the plate's smooth residual.
    projector_near
        Stated projector position in mm; only picks the point on the projector's line.
    phase_sigma_rad
        Typical noise of the phase; what the plate's residual has beyond it goes to every later height.

    Raises
    ------
    FitError
        The captures do not determine the rig.
    """

    def solve(
        camera: PlateCamera,
        raised: Mapping[int, float | Array] | None = None,
        start: RigFit | None = None,
    ) -> RigFit:
        return fit_rig(
            observations.surfaces(camera, raised=raised),
            residual_degree=residual_degree,
            projector_near=projector_near,
            start=start,
        )

    camera = camera_fit.camera
    fit = solve(camera)
    base = _joined(camera, fit.model)
    scatter = _scatter_effects(fit, base.size)
    components = [UncertaintyComponent(Influence.PHASE_SCATTER, effect, fit.dof) for effect in scatter]
    for height, raised in observations.errors():
        progress(f"sensitivity to {height.source.text}")
        effect = _joined(camera, solve(camera, raised, fit).model) - base
        components.append(replace(height, effect=effect))
    components = _gathered(components)
    if observations.form is not None:
        progress(f"sensitivity to {Influence.PLATE_FLATNESS.text}")
        axes = observations.form.axes_mm
        bent = bent_effects(observations, observations.form, camera_fit, fit, axes, degree=residual_degree)
        components += _form_components(observations.form, bent, base.size)
    for source, group in groupby(_camera_components(camera_fit), key=attrgetter("source")):
        progress(f"sensitivity to {source.text}")
        for component in group:
            moved = camera.replaced(camera.parameters + component.effect)
            components.append(replace(component, effect=_joined(moved, solve(moved, start=fit).model) - base))
    excess = math.sqrt(max(0.0, fit.plate_rms_rad**2 - phase_sigma_rad**2))
    return RigCalibration(camera, fit.model, tuple(components), excess), fit


def _gathered(components: list[UncertaintyComponent]) -> list[UncertaintyComponent]:
    """Return components with those of single strips, which are many, as the principal axes of each source's sum."""
    by_source: dict[Source, list[UncertaintyComponent]] = {}
    for one in components:
        by_source.setdefault(one.source, []).append(one)
    found: list[UncertaintyComponent] = []
    for source, same in by_source.items():
        if source.influence not in OF_SINGLE_STRIPS or len(same) < _MANY:
            found += same
            continue
        covariance = sum((np.outer(c.effect, c.effect) for c in same), np.zeros((same[0].effect.size,) * 2))
        # Each strip's height has its own degrees of freedom: together they have about as many as all of them.
        found += [replace(same[0], effect=axis, dof=sum(c.dof for c in same)) for axis in _axes(covariance)]
    return found


def bent_effects(  # noqa: PLR0913 -- a fit, what it was made from, and what of it is bent
    observations: Observations,
    form: PlateForm,
    camera_fit: CameraFit,
    fit: RigFit,
    axes_mm: Sequence[Array],
    *,
    degree: int = RESIDUAL_DEGREE,
) -> list[Array]:
    """Return what each of several further forms of the plate, added to what is known of it, does to all parameters.

    The grid's sheet lies on the plate as well: the camera changes with it.

    Parameters
    ----------
    observations, camera_fit, fit
        What the rig was fitted to, its camera, and the fit.
    form
        The plate's, whose box the coefficients are for.
    axes_mm
        Coefficients of further forms, (7,) each.
    degree
        Total degree of the plate's residual.
    """
    if not axes_mm:
        return []
    bent = replace(observations, form=form)
    base = _joined(camera_fit.camera, fit.model)
    changes = camera_fit.changed_by_heights(lambda x, y: np.stack([form_height(a, form.box, x, y) for a in axes_mm]))
    effects = []
    for axis, change in zip(axes_mm, changes, strict=True):
        camera = camera_fit.camera.replaced(camera_fit.camera.parameters + change)
        surfaces = bent.surfaces(camera, bent_mm=axis)
        near = fit.model.projector_mm
        model = fit_rig(surfaces, residual_degree=degree, projector_near=near, start=fit).model
        effects.append(_joined(camera, model) - base)
    return effects


def _form_components(form: PlateForm, effects: Sequence[Array], size: int) -> list[UncertaintyComponent]:
    """Return what the plate's form does; where nothing is stated, a component without effect that says so."""
    if not form.is_stated:
        return [UncertaintyComponent(Influence.PLATE_FLATNESS, np.zeros(size), detail=NOT_STATED)]
    return [UncertaintyComponent(Influence.PLATE_FLATNESS, effect, form.dof) for effect in effects]


def _joined(camera: PlateCamera, model: RigModel) -> Array:
    return np.concatenate([camera.parameters, model.parameters, model.residual.coefficients])


def _scatter_effects(fit: RigFit, size: int) -> list[Array]:
    """Principal axes of the rig's covariance from the scatter of residuals."""
    effects = []
    for axis in _axes(fit.covariance):
        effect = np.zeros(size)
        effect[len(CAMERA_NAMES) : len(CAMERA_NAMES) + len(RIG_NAMES)] = axis
        effects.append(effect)
    return effects


def _camera_components(fit: CameraFit) -> Sequence[UncertaintyComponent]:
    """Return the components of the camera's stated inputs, and the principal axes of what the crossings add."""
    effects = (component.effect for component in fit.components)
    left = fit.camera.covariance - sum((np.outer(e, e) for e in effects), np.zeros_like(fit.camera.covariance))
    scatter = (UncertaintyComponent(Influence.GRID_CROSSINGS, axis, fit.dof) for axis in _axes(left))
    # What the plate's form does to the camera is done to the rig with it, and counts there.
    return [*(c for c in fit.components if c.influence is not Influence.PLATE_FLATNESS), *scatter]


def _axes(covariance: Array) -> list[Array]:
    """Principal axes of a covariance, each one standard deviation long, the negligible left out."""
    size = np.sqrt(np.clip(np.diag(covariance), 0, None))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return [
        unit * vectors[:, k] * math.sqrt(values[k])
        for k in range(values.size)
        if values[k] > _NEGLIGIBLE * max(float(values.max()), 1e-300) and values[k] > 0
    ]


__all__ = ["Observations", "PlateResidual", "RigCalibration", "calibrate_rig"]
