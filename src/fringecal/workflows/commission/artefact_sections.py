"""Artefacts of the session in a commissioning report: error tables, profiles and maps, one section for each."""

from fringecal.report import Section
from fringecal.workflows.commission.plate_repeats import PlateRepeats
from fringecal.workflows.shared import concise
from fringecal.workflows.verify import (
    Verification,
    Verified,
    artefact_surface_section,
    errors_section,
    numbers_section,
    profiles_section,
    surface_section,
)

_BAR_FIGURE = "Height error on the bars"
_FORM_FIGURE = "Distance from the fitted form"


def verified_sections(found: Verified) -> tuple[Section, ...]:
    """Show every artefact beside its certificate, and name those that could not be measured."""
    bars = (_bars_section(one) for one in found.bars)
    others = (
        Section(
            f"Verification on {one.target.name}",
            (one.sentence, *numbers_section(one).sentences[1:]),
            numbers_section(one).tables,
            tuple(figure for figure in artefact_surface_section(one).figures if figure.caption == _FORM_FIGURE),
        )
        for one in found.artefacts
    )
    failed = tuple(f"{name}: {reason}" for name, reason in found.failures)
    return (*bars, *others, *((Section("Artefacts that could not be measured", failed),) if failed else ()))


def _bars_section(found: Verification) -> Section:
    errors = errors_section(found.errors)
    maps = (figure for figure in surface_section(found).figures if figure.caption == _BAR_FIGURE)
    return Section(
        f"Verification on {found.target.name}",
        (found.errors.sentence, *errors.sentences),
        errors.tables[:2],  # per profile; flanks and terms are for `fringecal verify`
        (*profiles_section(found.errors).figures, *maps),
        side_by_side=True,
    )


def repeats_section(found: PlateRepeats | None) -> tuple[Section, ...]:
    """Give the noise and the plate form that the repeats of the bare plate show."""
    if found is None:
        return ()
    shifts = ", ".join(f"{shift:+z.4f}" for shift in found.shift_rad)
    return (
        Section(
            "Repeats of the bare plate",
            (
                f"From {found.sets} repeats the phase of one set scatters by {found.noise_rad:.4f} rad (rms over the "
                f"picture); the camera's noise predicts {found.predicted_rad:.4f} rad, ratio {concise(found.ratio)}.",
                f"The mean phase moved by {shifts} rad from repeat to repeat.",
                f"What all repeats have in common and no model explains is {concise(found.form_mm)} rms as a height: "
                "the plate's form, finer than the smooth residual that the model takes up.",
            ),
        ),
    )
