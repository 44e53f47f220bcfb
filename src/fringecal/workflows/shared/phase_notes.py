"""Between what a procedure found of a capture's frames and what a record keeps of it."""

from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from fringecal.phase import PlateLook, PlateOrders, Waveform
from fringecal.records import FindingRecord, LookRecord, OrdersRecord, StepsRecord, WaveRecord, packed, unpacked
from fringecal.workflows.shared.capture_diagnosis import CaptureDiagnosis


def steps_record(diagnosed: CaptureDiagnosis) -> StepsRecord:
    """Return what the record keeps of one capture's frames."""
    found = diagnosed.phase
    estimate = found.estimated
    measured = (
        {}
        if estimate is None
        else {
            "estimated_rad": _numbers(estimate.phase_shifts_rad),
            "u_rad": _numbers(estimate.u_rad),
            "modulation_per_frame": _numbers(estimate.gain_per_frame),
            "background_per_frame": _numbers(estimate.background_per_frame),
            "offset_per_frame": _numbers(estimate.offset_per_frame),
        }
    )
    return StepsRecord(
        capture=found.capture.name,
        stated_rad=tuple(found.capture.phase_shifts_rad),
        used="estimated" if found.used == "estimated" else "stated",
        undone=found.adapted.undone,
        notes=found.adapted.notes,
        findings=findings_of(diagnosed),
        **measured,
    )


def findings_of(diagnosed: CaptureDiagnosis) -> tuple[FindingRecord, ...]:
    """Return the findings of the diagnostics as the record keeps them."""
    return tuple(
        FindingRecord(**finding.document(), undone=finding.kind in diagnosed.corrected)
        for finding in diagnosed.findings
    )


def wave_record(wave: Waveform | None) -> WaveRecord | None:
    """Return the waveform as the record keeps it."""
    if wave is None:
        return None
    return WaveRecord(
        ratios_real=_numbers(wave.ratios.real),
        ratios_imaginary=_numbers(wave.ratios.imag),
        u=_numbers(wave.u),
        blocks=wave.n_blocks,
        exponent=wave.gamma,
        u_exponent=wave.u_gamma,
    )


def wave_of(written: WaveRecord | None) -> Waveform | None:
    """Return the waveform that a record holds."""
    if written is None:
        return None
    ratios = np.array(written.ratios_real) + 1j * np.array(written.ratios_imaginary)
    return Waveform(ratios, np.array(written.u), written.blocks)


def orders_record(orders: PlateOrders | None) -> OrdersRecord | None:
    """Return what the record keeps of how several periods number the fringes."""
    return None if orders is None else OrdersRecord(**asdict(orders))


def orders_of(written: OrdersRecord | None) -> PlateOrders | None:
    """Return how several periods number the fringes, as a record holds it."""
    return None if written is None else PlateOrders(**written.model_dump())


def look_record(look: PlateLook | None) -> LookRecord | None:
    """Return what the record keeps of how the plate looked: texture to half of its noise, light to 0.1 %."""
    if look is None:
        return None
    step = max(look.noise_levels / 2, _LEAST_STEP)
    lights = {name: (part, max(float(np.nanmax(part)), 1.0) * _LIGHT_STEP) for name, part in _lights(look).items()}
    return LookRecord(
        shape=look.shape,
        corners_px=tuple((int(u), int(v)) for u, v in look.corners_px),
        noise_levels=look.noise_levels,
        phase_shifts_rad=look.phase_shifts_rad,
        neighbour_scatter=look.neighbour_scatter if np.isfinite(look.neighbour_scatter) else None,
        texture=packed(look.texture, step),
        **{name: packed(part, unit) for name, (part, unit) in lights.items()},
    )


_LEAST_STEP = 1e-3  # grey levels: pictures without noise are rounded to this
_LIGHT_STEP = 1e-3  # of the brightest


def _lights(look: PlateLook) -> dict[str, NDArray]:
    return {"background": look.background, "modulation": look.modulation}


def look_of(written: LookRecord | None) -> PlateLook | None:
    """Return how the plate looked, as a record holds it."""
    if written is None:
        return None
    return PlateLook(
        written.shape,
        unpacked(written.background),
        unpacked(written.modulation),
        np.array(written.corners_px, np.intp).reshape(-1, 2),
        unpacked(written.texture).astype(np.float32),
        written.noise_levels,
        written.phase_shifts_rad,
        float("nan") if written.neighbour_scatter is None else written.neighbour_scatter,
    )


def _numbers(values: NDArray) -> tuple[float, ...]:
    return tuple(map(float, values))
