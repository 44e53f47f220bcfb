from .audit_record import (
    AUDIT_FILE as AUDIT_FILE,
)
from .audit_record import (
    AmountRecord as AmountRecord,
)
from .audit_record import (
    AuditRecord as AuditRecord,
)
from .audit_record import (
    CauseRecord as CauseRecord,
)
from .audit_record import (
    ChangeRecord as ChangeRecord,
)
from .audit_record import (
    write_audit as write_audit,
)
from .board_calibration import (
    BoardCalibrationRecord as BoardCalibrationRecord,
)
from .board_calibration import (
    PoseRecord as PoseRecord,
)
from .board_calibration import (
    RasterRecord as RasterRecord,
)
from .board_calibration import (
    VolumeRecord as VolumeRecord,
)
from .board_calibration import (
    board_calibration_of_bytes as board_calibration_of_bytes,
)
from .board_calibration import (
    is_board_calibration as is_board_calibration,
)
from .board_calibration import (
    read_board_calibration as read_board_calibration,
)
from .board_calibration import (
    states_board_calibration as states_board_calibration,
)
from .board_calibration import (
    write_board_calibration as write_board_calibration,
)
from .calibration_record import (
    CALIBRATION_FILE as CALIBRATION_FILE,
)
from .calibration_record import (
    AppearanceRecord as AppearanceRecord,
)
from .calibration_record import (
    CalibrationRecord as CalibrationRecord,
)
from .calibration_record import (
    ImageRecord as ImageRecord,
)
from .calibration_record import (
    parse_calibration as parse_calibration,
)
from .calibration_record import (
    read_calibration as read_calibration,
)
from .calibration_record import (
    write_calibration as write_calibration,
)
from .certificates.certificate_content import (
    Certificate as Certificate,
)
from .certificates.certificate_content import (
    Column as Column,
)
from .certificates.certificate_content import (
    Conformity as Conformity,
)
from .certificates.certificate_content import (
    Group as Group,
)
from .certificates.certificate_content import (
    Measured as Measured,
)
from .certificates.certificate_content import (
    Method as Method,
)
from .certificates.certificate_content import (
    ResultTable as ResultTable,
)
from .certificates.certificate_content import (
    Statement as Statement,
)
from .certificates.certificate_content import (
    UsedStandard as UsedStandard,
)
from .certificates.certificate_content import (
    rounded as rounded,
)
from .certificates.dcc import (
    certificate_xml as certificate_xml,
)
from .certificates.lab_template import (
    lab_template as lab_template,
)
from .certificates.laboratory import (
    NOT_STATED as NOT_STATED,
)
from .certificates.laboratory import (
    Laboratory as Laboratory,
)
from .certificates.laboratory import (
    Party as Party,
)
from .certificates.laboratory import (
    impossible_in as impossible_in,
)
from .certificates.laboratory import (
    missing_in as missing_in,
)
from .certificates.laboratory import (
    read_laboratory as read_laboratory,
)
from .documents import (
    record_bytes as record_bytes,
)
from .documents import (
    write_document as write_document,
)
from .documents import (
    written_document as written_document,
)
from .exports.cameramodel import (
    CAMERAMODEL_FILE as CAMERAMODEL_FILE,
)
from .exports.cameramodel import (
    rich_lens_text as rich_lens_text,
)
from .exports.cameramodel import (
    write_cameramodel as write_cameramodel,
)
from .exports.cameramodel import (
    write_lens as write_lens,
)
from .exports.cloud_files import (
    write_cloud as write_cloud,
)
from .exports.further_files import (
    FURTHER as FURTHER,
)
from .exports.further_files import (
    demand_further as demand_further,
)
from .exports.further_files import (
    write_further as write_further,
)
from .exports.regular_grid import (
    RegularGrid as RegularGrid,
)
from .exports.regular_grid import (
    demand_maps as demand_maps,
)
from .exports.regular_grid import (
    pixels_of_nodes as pixels_of_nodes,
)
from .exports.regular_grid import (
    regular_grid as regular_grid,
)
from .exports.regular_grid import (
    sample_spacing_mm as sample_spacing_mm,
)
from .exports.surface_files import (
    write_points as write_points,
)
from .exports.surface_files import (
    write_profiles as write_profiles,
)
from .exports.surface_files import (
    write_surfaces as write_surfaces,
)
from .files import (
    EARLIER as EARLIER,
)
from .files import (
    earlier_record as earlier_record,
)
from .files import (
    replacing as replacing,
)
from .files import (
    result_folder as result_folder,
)
from .files import (
    write_bytes as write_bytes,
)
from .files import (
    write_table as write_table,
)
from .files import (
    write_text as write_text,
)
from .foreign.lens_files import (
    lens_of_bytes as lens_of_bytes,
)
from .foreign.lens_files import (
    read_lens as read_lens,
)
from .foreign.point_pairs import (
    MOST_PAIRS_FILE as MOST_PAIRS_FILE,
)
from .foreign.point_pairs import (
    read_point_pairs as read_point_pairs,
)
from .foreign.read_pair import (
    read_pair as read_pair,
)
from .foreign.read_pair import (
    read_stated as read_stated,
)
from .foreign.stated_record import (
    PAIR_FILE as PAIR_FILE,
)
from .foreign.stated_record import (
    DoubtRecord as DoubtRecord,
)
from .foreign.stated_record import (
    PairDocument as PairDocument,
)
from .foreign.stated_record import (
    PairsRecord as PairsRecord,
)
from .foreign.write_pair import (
    write_pair as write_pair,
)
from .kinds_of_record import (
    Record as Record,
)
from .kinds_of_record import (
    read_record as read_record,
)
from .kinds_of_record import (
    record_file as record_file,
)
from .kinds_of_record import (
    record_of_bytes as record_of_bytes,
)
from .lens_record import (
    LENS_FILE as LENS_FILE,
)
from .lens_record import (
    BoardPictureRecord as BoardPictureRecord,
)
from .lens_record import (
    BoardSolution as BoardSolution,
)
from .lens_record import (
    LensDocument as LensDocument,
)
from .lens_record import (
    LensRecord as LensRecord,
)
from .lens_record import (
    ProjectionUncertainty as ProjectionUncertainty,
)
from .limits import (
    DEFAULT_LIMITS as DEFAULT_LIMITS,
)
from .limits import (
    Limits as Limits,
)
from .limits import (
    limits_for as limits_for,
)
from .look_record import (
    LookRecord as LookRecord,
)
from .look_record import (
    PackedArray as PackedArray,
)
from .look_record import (
    packed as packed,
)
from .look_record import (
    unpacked as unpacked,
)
from .parts import (
    BudgetRow as BudgetRow,
)
from .parts import (
    Check as Check,
)
from .parts import (
    Decision as Decision,
)
from .parts import (
    DigestState as DigestState,
)
from .parts import (
    EstimateRecord as EstimateRecord,
)
from .parts import (
    InputFile as InputFile,
)
from .parts import (
    SessionNote as SessionNote,
)
from .parts import (
    ValueU as ValueU,
)
from .parts import (
    VectorU as VectorU,
)
from .phase_record import (
    FindingRecord as FindingRecord,
)
from .phase_record import (
    OrdersRecord as OrdersRecord,
)
from .phase_record import (
    StepsRecord as StepsRecord,
)
from .phase_record import (
    WaveRecord as WaveRecord,
)
from .provenance import (
    PROCESSOR as PROCESSOR,
)
from .provenance import (
    sha256_of as sha256_of,
)
from .provenance import (
    software_versions as software_versions,
)
from .study_record import (
    Comparison as Comparison,
)
from .study_record import (
    RigResult as RigResult,
)
from .study_record import (
    StudyRecord as StudyRecord,
)
from .study_record import (
    open_study as open_study,
)
from .study_record import (
    read_rigs as read_rigs,
)
from .study_record import (
    write_rig as write_rig,
)
from .verification_record import (
    VERIFICATION_FILE as VERIFICATION_FILE,
)
from .verification_record import (
    CalibrationUsed as CalibrationUsed,
)
from .verification_record import (
    FilterRow as FilterRow,
)
from .verification_record import (
    ModelRow as ModelRow,
)
from .verification_record import (
    ProfileRecord as ProfileRecord,
)
from .verification_record import (
    ReadingRecord as ReadingRecord,
)
from .verification_record import (
    VerificationRecord as VerificationRecord,
)
from .verification_record import (
    read_verification as read_verification,
)
from .verification_record import (
    write_verification as write_verification,
)
