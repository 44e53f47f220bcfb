from .appearance import (
    BLUR_FROM as BLUR_FROM,
)
from .appearance import (
    appearance_of as appearance_of,
)
from .assumptions import (
    assumption_sentences as assumption_sentences,
)
from .capture_diagnosis import (
    CaptureDiagnosis as CaptureDiagnosis,
)
from .capture_diagnosis import (
    diagnose_capture as diagnose_capture,
)
from .capture_diagnosis import (
    height_per_rad_mm as height_per_rad_mm,
)
from .capture_diagnosis import (
    plate_beside as plate_beside,
)
from .capture_phase import (
    BORDER_PX as BORDER_PX,
)
from .capture_phase import (
    CapturePhase as CapturePhase,
)
from .capture_phase import (
    frames_of as frames_of,
)
from .capture_phase import (
    phase_of_capture as phase_of_capture,
)
from .capture_phase import (
    shortest_period as shortest_period,
)
from .capture_phase import (
    within_border as within_border,
)
from .causes import (
    caused_by_frames as caused_by_frames,
)
from .causes import (
    caused_by_frames_of as caused_by_frames_of,
)
from .causes import (
    too_few_pixels as too_few_pixels,
)
from .command_words import (
    command_line as command_line,
)
from .command_words import (
    given as given,
)
from .field_places import (
    RIM as RIM,
)
from .judgement import (
    judged as judged,
)
from .judgement import (
    judged_below as judged_below,
)
from .judgement import (
    judged_en as judged_en,
)
from .judgement import (
    rms_estimate as rms_estimate,
)
from .phase_notes import (
    findings_of as findings_of,
)
from .phase_notes import (
    look_record as look_record,
)
from .phase_notes import (
    orders_record as orders_record,
)
from .phase_notes import (
    steps_record as steps_record,
)
from .phase_notes import (
    wave_record as wave_record,
)
from .raster_phase import (
    AxisPhase as AxisPhase,
)
from .raster_phase import (
    lit_by_projector as lit_by_projector,
)
from .raster_phase import (
    raster_of_capture as raster_of_capture,
)
from .raster_phase import (
    raster_of_maps as raster_of_maps,
)
from .record_parts import (
    budget_rows as budget_rows,
)
from .record_parts import (
    inputs_of as inputs_of,
)
from .record_parts import (
    session_note as session_note,
)
from .same_rig import (
    demand_same_picture as demand_same_picture,
)
from .same_rig import (
    demand_same_rig as demand_same_rig,
)
from .sections.diagnostics_section import (
    findings_section as findings_section,
)
from .sections.report_parts import (
    budget_table as budget_table,
)
from .sections.report_parts import (
    checks_table as checks_table,
)
from .sections.report_parts import (
    concise as concise,
)
from .sections.report_parts import (
    estimates_table as estimates_table,
)
from .sections.report_parts import (
    inputs_of_capture as inputs_of_capture,
)
from .sections.report_parts import (
    phase_section as phase_section,
)
from .sections.report_parts import (
    severest as severest,
)
from .sections.rig_view import (
    field_mm as field_mm,
)
from .sections.rig_view import (
    rig_figure as rig_figure,
)
from .sections.surface_items import (
    height_item as height_item,
)
from .sections.surface_items import (
    readable_surface as readable_surface,
)
from .sections.surface_items import (
    surface_item as surface_item,
)
from .stated_projector import (
    displaced as displaced,
)
from .stated_projector import (
    projector_of as projector_of,
)
from .stored_board_rig import (
    board_rig_of as board_rig_of,
)
from .stored_calibration import (
    calibration_of as calibration_of,
)
from .treatment import (
    UNTREATED as UNTREATED,
)
from .treatment import (
    Treatment as Treatment,
)
from .treatment import (
    effect_on_phase as effect_on_phase,
)
from .treatment import (
    filtered_heights as filtered_heights,
)
from .treatment import (
    filtered_phase as filtered_phase,
)
from .treatment import (
    minus_plate as minus_plate,
)
from .volume_capture import (
    VolumeCapture as VolumeCapture,
)
from .volume_capture import (
    demand_for_rig as demand_for_rig,
)
from .volume_capture import (
    points_of_capture as points_of_capture,
)
