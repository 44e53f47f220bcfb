from .raster_sessions import (
    SimulatedRasterSession as SimulatedRasterSession,
)
from .raster_sessions import (
    raster_truth as raster_truth,
)
from .raster_sessions import (
    simulate_raster_session as simulate_raster_session,
)
from .rig.drawn_camera import (
    build_camera as build_camera,
)
from .rig.drawn_camera import (
    ray as ray,
)
from .rig.drawn_projector import (
    build_projector as build_projector,
)
from .rig.drawn_projector import (
    phase_at as phase_at,
)
from .rig.raster_device import (
    flat_pose as flat_pose,
)
from .rig.raster_device import (
    projector_pose as projector_pose,
)
from .rig.raster_spec import (
    RasterRigSpec as RasterRigSpec,
)
from .rig.rig_files import (
    is_raster_rig as is_raster_rig,
)
from .rig.rig_files import (
    list_raster_rigs as list_raster_rigs,
)
from .rig.rig_files import (
    list_rigs as list_rigs,
)
from .rig.rig_files import (
    load_raster_rig as load_raster_rig,
)
from .rig.rig_files import (
    load_rig as load_rig,
)
from .rig.rig_spec import (
    PlateSpec as PlateSpec,
)
from .rig.rig_spec import (
    RigSpec as RigSpec,
)
from .rig.rig_spec import (
    StepsSpec as StepsSpec,
)
from .rig.truth import (
    Truth as Truth,
)
from .rig.truth import (
    apparent_angle_deg as apparent_angle_deg,
)
from .rig.truth import (
    projection_angle_deg as projection_angle_deg,
)
from .rig.truth import (
    truth_of as truth_of,
)
from .scene.capture_scenes import (
    stated_target as stated_target,
)
from .scene.leaf import (
    Leaf as Leaf,
)
from .scene.leaf import (
    leaf_scene as leaf_scene,
)
from .scene.objects import (
    scene_of as scene_of,
)
from .scene.scene import (
    HeightField as HeightField,
)
from .scene.scene import (
    plate as plate,
)
from .sessions import (
    SimulatedSession as SimulatedSession,
)
from .sessions import (
    simulate_session as simulate_session,
)
from .thesis_images import (
    THIRDS_RAD as THIRDS_RAD,
)
from .thesis_images import (
    analytic_images as analytic_images,
)
from .thesis_images import (
    rectangle_px as rectangle_px,
)
from .thesis_images import (
    zigzag_px as zigzag_px,
)
from .tracing.raster_render import (
    RasterFrames as RasterFrames,
)
from .tracing.raster_render import (
    render_raster as render_raster,
)
from .tracing.ray_tracer import (
    plate_points as plate_points,
)
from .tracing.ray_tracer import (
    render as render,
)
