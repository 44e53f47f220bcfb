from .against_plate.capture_held import (
    CaptureHeld as CaptureHeld,
)
from .against_plate.capture_held import (
    capture_held as capture_held,
)
from .against_plate.frame_faults import (
    FrameFault as FrameFault,
)
from .against_plate.frame_faults import (
    FrameFinding as FrameFinding,
)
from .against_plate.frame_motion import (
    FrameMotion as FrameMotion,
)
from .against_plate.picture_pose import (
    PictureHeld as PictureHeld,
)
from .against_plate.picture_pose import (
    Pose as Pose,
)
from .against_plate.picture_pose import (
    PoseKind as PoseKind,
)
from .against_plate.texture_shift import (
    CLEAR as CLEAR,
)
from .against_plate.texture_shift import (
    REACH_PX as REACH_PX,
)
from .extent import (
    Extent as Extent,
)
from .extent import (
    extent_of as extent_of,
)
from .filter_effects import (
    DRAWS as DRAWS,
)
from .filter_effects import (
    FilterEffect as FilterEffect,
)
from .filter_effects import (
    effect_of_filter as effect_of_filter,
)
from .height_map import (
    HeightMap as HeightMap,
)
from .height_map import (
    Reason as Reason,
)
from .object_phase import (
    ObjectPhase as ObjectPhase,
)
from .object_phase import (
    absolute_phase as absolute_phase,
)
from .perturbed import (
    points_by_component as points_by_component,
)
from .phase_to_height import (
    height_of_phase as height_of_phase,
)
from .phase_to_height import (
    reconstruct_height as reconstruct_height,
)
from .plate_in_view import (
    VisiblePlate as VisiblePlate,
)
from .plate_in_view import (
    visible_plate as visible_plate,
)
from .point_cloud import (
    CAMERA_FRAME as CAMERA_FRAME,
)
from .point_cloud import (
    PLATE_FRAME as PLATE_FRAME,
)
from .point_cloud import (
    PointCloud as PointCloud,
)
from .point_cloud import (
    cloud_of_map as cloud_of_map,
)
from .sections import (
    Section as Section,
)
from .sections import (
    row_section as row_section,
)
from .tie_to_plate import (
    surface_over_plate as surface_over_plate,
)
from .tie_to_plate import (
    tied_to_plate as tied_to_plate,
)
from .volume.over_plate import (
    PlateFrame as PlateFrame,
)
from .volume.over_plate import (
    PlateHeights as PlateHeights,
)
from .volume.over_plate import (
    heights_over as heights_over,
)
from .volume.over_plate import (
    plate_frame as plate_frame,
)
from .volume.volume_map import (
    VolumeMap as VolumeMap,
)
from .volume.volume_map import (
    volume_points as volume_points,
)
