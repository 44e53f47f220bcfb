from .demodulation.adapted import (
    ADAPTATION_RULES as ADAPTATION_RULES,
)
from .demodulation.adapted import (
    Adapted as Adapted,
)
from .demodulation.adapted import (
    demodulate_adapted as demodulate_adapted,
)
from .demodulation.corrections import (
    correct_phase_shifts as correct_phase_shifts,
)
from .demodulation.corrections import (
    equalise as equalise,
)
from .demodulation.demodulate import (
    PhaseMap as PhaseMap,
)
from .demodulation.demodulate import (
    Reason as Reason,
)
from .demodulation.demodulate import (
    demodulate as demodulate,
)
from .demodulation.fringe_period import (
    FringePeriod as FringePeriod,
)
from .demodulation.fringe_period import (
    carrier as carrier,
)
from .demodulation.fringe_period import (
    fringe_period as fringe_period,
)
from .demodulation.fringe_period import (
    phase_gradient as phase_gradient,
)
from .demodulation.noise import (
    Noise as Noise,
)
from .demodulation.noise import (
    estimate_noise as estimate_noise,
)
from .demodulation.noise import (
    noise_from_repeats as noise_from_repeats,
)
from .demodulation.phase_shifts import (
    PhaseShiftEstimate as PhaseShiftEstimate,
)
from .demodulation.phase_shifts import (
    estimate_phase_shifts as estimate_phase_shifts,
)
from .demodulation.repeated_sets import (
    compare_repeats as compare_repeats,
)
from .demodulation.repeated_sets import (
    findings_of_repeats as findings_of_repeats,
)
from .demodulation.repeated_sets import (
    mean_of_repeats as mean_of_repeats,
)
from .demodulation.row_bands import (
    demodulate_strips as demodulate_strips,
)
from .demodulation.schemes import (
    buckets as buckets,
)
from .demodulation.schemes import (
    carre as carre,
)
from .demodulation.schemes import (
    least_squares as least_squares,
)
from .demodulation.schemes import (
    scheme as scheme,
)
from .demodulation.smoothing import (
    smooth_phase as smooth_phase,
)
from .demodulation.waveform import (
    Waveform as Waveform,
)
from .demodulation.waveform import (
    correct_gamma as correct_gamma,
)
from .demodulation.waveform import (
    estimate_waveform as estimate_waveform,
)
from .demodulation.waveform import (
    phase_error as phase_error,
)
from .diagnostics.diagnosis import (
    Diagnosis as Diagnosis,
)
from .diagnostics.diagnosis import (
    diagnose as diagnose,
)
from .diagnostics.evidence import (
    Finding as Finding,
)
from .diagnostics.finding_kinds import (
    FindingKind as FindingKind,
)
from .diagnostics.looks import (
    Look as Look,
)
from .diagnostics.looks import (
    looked_for as looked_for,
)
from .diagnostics.set_summary import (
    PhaseSummary as PhaseSummary,
)
from .diagnostics.set_summary import (
    demand_phase as demand_phase,
)
from .diagnostics.set_summary import (
    summarise as summarise,
)
from .orders.absolute import (
    AbsolutePhase as AbsolutePhase,
)
from .orders.absolute import (
    absolute_phase as absolute_phase,
)
from .orders.absolute import (
    pieces_in_cycles as pieces_in_cycles,
)
from .orders.gray import (
    decode_gray as decode_gray,
)
from .orders.gray import (
    unwrap_gray as unwrap_gray,
)
from .orders.gray_orders import (
    orders_by_gray as orders_by_gray,
)
from .orders.guided import (
    unwrap_guided as unwrap_guided,
)
from .orders.multi_period import (
    LEAST_PLATE_PIXELS as LEAST_PLATE_PIXELS,
)
from .orders.multi_period import (
    NEAR_PLATE_RAD as NEAR_PLATE_RAD,
)
from .orders.multi_period import (
    FringeOrders as FringeOrders,
)
from .orders.multi_period import (
    PlateOrders as PlateOrders,
)
from .orders.multi_period import (
    decide_orders as decide_orders,
)
from .orders.multi_period import (
    plate_number as plate_number,
)
from .orders.raster_coordinate import (
    RasterCoordinate as RasterCoordinate,
)
from .orders.raster_coordinate import (
    raster_by_gray as raster_by_gray,
)
from .orders.raster_coordinate import (
    raster_coordinate as raster_coordinate,
)
from .orders.raster_frames import (
    raster_of_frames as raster_of_frames,
)
from .orders.temporal import (
    beat_period as beat_period,
)
from .orders.temporal import (
    beat_phase as beat_phase,
)
from .orders.temporal import (
    order_error_rate as order_error_rate,
)
from .orders.temporal import (
    unwrap_temporal as unwrap_temporal,
)
from .plate_look.look import (
    TILE_PX as TILE_PX,
)
from .plate_look.look import (
    PlateLook as PlateLook,
)
from .plate_look.look import (
    cells_of as cells_of,
)
from .plate_look.neighbours import (
    neighbour_scatter as neighbour_scatter,
)
from .plate_look.texture import (
    texture_of as texture_of,
)
from .single_frame.fourier import (
    fourier_phase as fourier_phase,
)
from .single_frame.line_carrier import (
    LineCarrier as LineCarrier,
)
from .single_frame.line_carrier import (
    demodulate_lines as demodulate_lines,
)
from .single_frame.plate_carrier import (
    SmoothPhase as SmoothPhase,
)
from .single_frame.plate_carrier import (
    fringed as fringed,
)
from .single_frame.plate_carrier import (
    plate_phase_on as plate_phase_on,
)
from .single_frame.plate_carrier import (
    plate_phases as plate_phases,
)
from .unwrapping.regions import (
    Regions as Regions,
)
from .unwrapping.regions import (
    smooth_regions as smooth_regions,
)
from .unwrapping.regions import (
    unwrap_regions as unwrap_regions,
)
from .unwrapping.spatial import (
    Unwrapped as Unwrapped,
)
from .unwrapping.spatial import (
    unwrap as unwrap,
)
