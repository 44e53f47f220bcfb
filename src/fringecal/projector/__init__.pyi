from .advice import (
    HEIGHTS_MM as HEIGHTS_MM,
)
from .advice import (
    Advice as Advice,
)
from .advice import (
    advise as advise,
)
from .angle.angle_table import (
    AxisAngle as AxisAngle,
)
from .angle.angle_table import (
    both_axes as both_axes,
)
from .angle.angle_theory import (
    DISPLACEMENT_PROBABILITY as DISPLACEMENT_PROBABILITY,
)
from .angle.angle_theory import (
    Displacement as Displacement,
)
from .angle.angle_theory import (
    displaced_by as displaced_by,
)
from .angle.angle_theory import (
    displacement as displacement,
)
from .angle.angle_theory import (
    projector_estimates as projector_estimates,
)
from .angle.angle_theory import (
    reflected_source as reflected_source,
)
from .angle.angle_theory import (
    seen_axes as seen_axes,
)
from .angle.breaks import (
    OFF as OFF,
)
from .angle.breaks import (
    Breaks as Breaks,
)
from .angle.other_causes import (
    with_other_causes as with_other_causes,
)
from .angle.phase_breaks import (
    phase_breaks as phase_breaks,
)
from .angle.phase_breaks import (
    runs_along_rows as runs_along_rows,
)
from .angle.picture_breaks import (
    PictureEstimator as PictureEstimator,
)
from .angle.picture_breaks import (
    picture_breaks as picture_breaks,
)
from .angle.projection_angle import (
    OriginAngles as OriginAngles,
)
from .angle.projection_angle import (
    ProjectorPosition as ProjectorPosition,
)
from .angle.projection_angle import (
    angle_budget as angle_budget,
)
from .angle.projection_angle import (
    angles_at_origin as angles_at_origin,
)
from .angle.projection_angle import (
    apparent_angle as apparent_angle,
)
from .angle.projection_angle import (
    fringe_pitch_mm as fringe_pitch_mm,
)
from .angle.projection_angle import (
    projection_angle as projection_angle,
)
from .angle.projection_angle import (
    theoretical_angle as theoretical_angle,
)
from .board_rig.board_fit import (
    BoardRigFit as BoardRigFit,
)
from .board_rig.board_fit import (
    PoseFit as PoseFit,
)
from .board_rig.board_fit import (
    fit_board_rig as fit_board_rig,
)
from .board_rig.board_poses import (
    BoardPose as BoardPose,
)
from .board_rig.board_poses import (
    BoardStatement as BoardStatement,
)
from .board_rig.fault_kinds import (
    RigFault as RigFault,
)
from .board_rig.fault_kinds import (
    RigFaultKind as RigFaultKind,
)
from .board_rig.next_poses import (
    PoseAdvice as PoseAdvice,
)
from .board_rig.next_poses import (
    advise_poses as advise_poses,
)
from .board_rig.pose_arrangements import (
    pose_arrangement as pose_arrangement,
)
from .board_rig.rig_faults import (
    rig_faults as rig_faults,
)
from .board_rig.rig_value import (
    BOARD_RIG_NAMES as BOARD_RIG_NAMES,
)
from .board_rig.rig_value import (
    BoardRig as BoardRig,
)
from .board_rig.triangulation import (
    RigPoints as RigPoints,
)
from .board_rig.triangulation import (
    outside_limit_mm as outside_limit_mm,
)
from .board_rig.triangulation import (
    outside_volume as outside_volume,
)
from .board_rig.triangulation import (
    rig_points as rig_points,
)
from .forecast import (
    forecast_height as forecast_height,
)
from .height_models import (
    HEIGHT_MODELS as HEIGHT_MODELS,
)
from .height_models import (
    fitted_to as fitted_to,
)
from .height_models import (
    height_changes as height_changes,
)
from .height_models import (
    height_model as height_model,
)
from .joint_fit import (
    RigFit as RigFit,
)
from .joint_fit import (
    fit_rig as fit_rig,
)
from .move_kinds import (
    STRIP_SETS as STRIP_SETS,
)
from .move_kinds import (
    Move as Move,
)
from .moves import (
    RigState as RigState,
)
from .moves import (
    has_projector_position as has_projector_position,
)
from .moves import (
    moved as moved,
)
from .orders.order_decision import (
    OrderDecision as OrderDecision,
)
from .orders.strip_orders import (
    MeasuredStep as MeasuredStep,
)
from .orders.strip_orders import (
    OrderedStrips as OrderedStrips,
)
from .orders.strip_orders import (
    order_like_strips as order_like_strips,
)
from .orders.strip_orders import (
    order_strips as order_strips,
)
from .orders.whole_fringes import (
    explained as explained,
)
from .plate_form import (
    FORM_TERMS as FORM_TERMS,
)
from .plate_form import (
    PlateForm as PlateForm,
)
from .plate_form import (
    form_height as form_height,
)
from .plate_form import (
    form_of_flatness as form_of_flatness,
)
from .plate_form import (
    unknown_form as unknown_form,
)
from .rig_calibration import (
    NOT_STATED as NOT_STATED,
)
from .rig_calibration import (
    Observations as Observations,
)
from .rig_calibration import (
    RigCalibration as RigCalibration,
)
from .rig_calibration import (
    calibrate_rig as calibrate_rig,
)
from .rig_kernels import (
    foot_of_ray as foot_of_ray,
)
from .rig_model import (
    RIG_NAMES as RIG_NAMES,
)
from .rig_model import (
    PlateResidual as PlateResidual,
)
from .rig_model import (
    RigModel as RigModel,
)
from .rig_monte_carlo import (
    check_by_monte_carlo as check_by_monte_carlo,
)
from .rig_monte_carlo import (
    draw_quantities as draw_quantities,
)
from .sampling import (
    pick_points as pick_points,
)
from .standards.artefact_phase import (
    ArtefactPhase as ArtefactPhase,
)
from .standards.artefact_phase import (
    observe_artefact as observe_artefact,
)
from .standards.artefact_phase import (
    observe_strips as observe_strips,
)
from .standards.strip_heights import (
    height_parts as height_parts,
)
from .standards.strip_heights import (
    is_split as is_split,
)
from .standards.strip_heights import (
    total_u as total_u,
)
from .standards.strip_phase import (
    StripPhase as StripPhase,
)
from .standards.strip_phase import (
    measure_strips as measure_strips,
)
from .standards.strip_phase import (
    numberings as numberings,
)
from .standards.strip_spacing import (
    StripSpacing as StripSpacing,
)
from .standards.strip_spacing import (
    strip_spacing as strip_spacing,
)
from .stated.pair_doubts import (
    PairsFound as PairsFound,
)
from .stated.pair_doubts import (
    PointPairs as PointPairs,
)
from .stated.pair_doubts import (
    doubts_by_pairs as doubts_by_pairs,
)
from .stated.pair_doubts import (
    judge_pairs as judge_pairs,
)
from .stated.pair_doubts import (
    pair_doubts as pair_doubts,
)
from .stated.stated_pair import (
    StatedPair as StatedPair,
)
from .stated.stated_pair import (
    stated_from_rig as stated_from_rig,
)
