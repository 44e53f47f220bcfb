"""Virtual rigs: a small ray tracer of its own, never used by the code it tests."""

from fringecal.simulate.analytic import AnalyticImages, analytic_images, rectangle_px, zigzag_px
from fringecal.simulate.leaf import Leaf, leaf_scene
from fringecal.simulate.library import list_rigs, load_rig
from fringecal.simulate.objects import scene_of
from fringecal.simulate.render import Frames, plate_points, render
from fringecal.simulate.rig import RigSpec
from fringecal.simulate.scene import HeightField, Scene, Solid, plate
from fringecal.simulate.sessions import SimulatedSession, simulate_session
from fringecal.simulate.truth import Truth, apparent_angle_deg, projection_angle_deg, truth_of

__all__ = [
    "AnalyticImages",
    "analytic_images",
    "rectangle_px",
    "zigzag_px",
    "Frames",
    "HeightField",
    "Leaf",
    "RigSpec",
    "Scene",
    "SimulatedSession",
    "Solid",
    "Truth",
    "apparent_angle_deg",
    "leaf_scene",
    "list_rigs",
    "load_rig",
    "plate",
    "plate_points",
    "projection_angle_deg",
    "render",
    "scene_of",
    "simulate_session",
    "truth_of",
]
