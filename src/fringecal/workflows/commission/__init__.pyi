from .angle_findings import (
    AngleFindings as AngleFindings,
)
from .angle_findings import (
    Estimator as Estimator,
)
from .angle_findings import (
    angle_map as angle_map,
)
from .angle_findings import (
    angles_of as angles_of,
)
from .angle_findings import (
    gather_angles as gather_angles,
)
from .angle_tables import (
    CONVENTION as CONVENTION,
)
from .angle_tables import (
    angle_section as angle_section,
)
from .angle_tables import (
    breaks_section as breaks_section,
)
from .artefact_sections import (
    verified_sections as verified_sections,
)
from .by_board.board_judged import (
    board_checks as board_checks,
)
from .by_board.board_run import (
    BoardCommissioning as BoardCommissioning,
)
from .by_board.board_run import (
    commission_boards as commission_boards,
)
from .by_board.board_run import (
    is_board_session as is_board_session,
)
from .by_board.board_sections import (
    board_report as board_report,
)
from .by_board.board_written import (
    board_calibration_record as board_calibration_record,
)
from .calibrated_session import (
    CalibratedSession as CalibratedSession,
)
from .calibrated_session import (
    calibrate_session as calibrate_session,
)
from .camera import (
    SCALED as SCALED,
)
from .camera import (
    camera_knowledge as camera_knowledge,
)
from .camera import (
    grid_with_pitch as grid_with_pitch,
)
from .camera import (
    measure_camera as measure_camera,
)
from .further import (
    strips_captures as strips_captures,
)
from .further import (
    strips_target as strips_target,
)
from .record import (
    calibration_record as calibration_record,
)
from .report import (
    commission_report as commission_report,
)
from .run import (
    Commissioning as Commissioning,
)
from .run import (
    commission as commission,
)
from .run import (
    judged_session as judged_session,
)
from .testability import (
    unseen_sentence as unseen_sentence,
)
