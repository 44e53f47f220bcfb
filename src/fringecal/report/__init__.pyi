from .figures.advice_figures import (
    field_uncertainty as field_uncertainty,
)
from .figures.advice_figures import (
    forecast_bars as forecast_bars,
)
from .figures.advice_figures import (
    gain_lines as gain_lines,
)
from .figures.analytic_figures import (
    analytic_overview as analytic_overview,
)
from .figures.angle_figures import (
    angle_field as angle_field,
)
from .figures.angle_figures import (
    angle_plot as angle_plot,
)
from .figures.angle_figures import (
    breaks_overlay as breaks_overlay,
)
from .figures.audit_figures import (
    cause_bars as cause_bars,
)
from .figures.audit_figures import (
    change_bars as change_bars,
)
from .figures.contours import (
    contour_map as contour_map,
)
from .figures.grid_figures import (
    distortion_quiver as distortion_quiver,
)
from .figures.grid_figures import (
    grid_overlay as grid_overlay,
)
from .figures.grid_figures import (
    neglect_map as neglect_map,
)
from .figures.grid_figures import (
    residual_quiver as residual_quiver,
)
from .figures.grid_figures import (
    scale_map as scale_map,
)
from .figures.grid_figures import (
    section_plot as section_plot,
)
from .figures.history_figures import (
    control_charts as control_charts,
)
from .figures.history_figures import (
    drift_figure as drift_figure,
)
from .figures.lens_figures import (
    boards_overlay as boards_overlay,
)
from .figures.lens_figures import (
    lens_coverage as lens_coverage,
)
from .figures.lens_figures import (
    lens_uncertainty_map as lens_uncertainty_map,
)
from .figures.maps import (
    classification_overlay as classification_overlay,
)
from .figures.maps import (
    error_map as error_map,
)
from .figures.maps import (
    height_map as height_map,
)
from .figures.maps import (
    residual_map as residual_map,
)
from .figures.maps import (
    uncertainty_map as uncertainty_map,
)
from .figures.order_figures import (
    orders_overview as orders_overview,
)
from .figures.phase_figures import (
    diagnostics_overview as diagnostics_overview,
)
from .figures.phase_figures import (
    phase_overview as phase_overview,
)
from .figures.profile_figures import (
    profile_plot as profile_plot,
)
from .figures.profile_figures import (
    sections_plot as sections_plot,
)
from .figures.rig_drawing import (
    Pupil as Pupil,
)
from .figures.rig_drawing import (
    rig_drawing as rig_drawing,
)
from .figures.study_figures import (
    coverage_bars as coverage_bars,
)
from .figures.study_figures import (
    z_histograms as z_histograms,
)
from .figures.surface_view import (
    surface_view as surface_view,
)
from .figures.table_bars import (
    budget_bars as budget_bars,
)
from .figures.table_bars import (
    comparison_bars as comparison_bars,
)
from .figures.volume_figures import (
    DepthSection as DepthSection,
)
from .figures.volume_figures import (
    depth_drawing as depth_drawing,
)
from .figures.volume_figures import (
    picture_map as picture_map,
)
from .figures.volume_figures import (
    volume_drawing as volume_drawing,
)
from .html import (
    render_html as render_html,
)
from .html import (
    write_html as write_html,
)
from .pages.dashboard import (
    message_page as message_page,
)
from .pages.dashboard import (
    rig_page as rig_page,
)
from .pages.dashboard import (
    rigs_page as rigs_page,
)
from .pages.record_page import (
    record_page as record_page,
)
from .pages.session_pages import (
    RunParts as RunParts,
)
from .pages.session_pages import (
    Seal as Seal,
)
from .pages.session_pages import (
    run_page as run_page,
)
from .pages.session_pages import (
    session_page as session_page,
)
from .pages.session_pages import (
    sessions_page as sessions_page,
)
from .pdf import (
    write_pdf as write_pdf,
)
from .readable import (
    Layer as Layer,
)
from .readable import (
    ReadableMap as ReadableMap,
)
from .readable import (
    readable_picture as readable_picture,
)
from .readable import (
    readable_plate as readable_plate,
)
from .report_files import (
    REPORT_FILE as REPORT_FILE,
)
from .report_files import (
    SHEETS_FILE as SHEETS_FILE,
)
from .report_files import (
    write_report as write_report,
)
from .structure import (
    AS_U as AS_U,
)
from .structure import (
    DOF as DOF,
)
from .structure import (
    Decision as Decision,
)
from .structure import (
    Fact as Fact,
)
from .structure import (
    FigureItem as FigureItem,
)
from .structure import (
    InputFile as InputFile,
)
from .structure import (
    Live as Live,
)
from .structure import (
    Report as Report,
)
from .structure import (
    Section as Section,
)
from .structure import (
    Table as Table,
)
from .structure import (
    Verdict as Verdict,
)
from .structure import (
    slug as slug,
)
from .style import (
    symmetric_limit as symmetric_limit,
)
from .views import (
    figure_bytes as figure_bytes,
)
