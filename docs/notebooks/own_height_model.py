# %% [markdown]
# # A height model of one's own
#
# The rig model turns phase into height exactly. Simpler laws stand in the literature; here one of them, a straight
# line through phase difference at every pixel, is held against the rig model over the field. Run it from the root of
# the source tree.

# %%
import numpy as np

import fringecal
from fringecal.projector import height_model
from fringecal.simulate import load_rig, simulate_session

taken = simulate_session(load_rig("docs/tutorial-rig.toml"), ["grid", "plate", "strips"], seed=1)
frames = {name: capture.frames for name, capture in taken.captures.items()}
calibration = fringecal.calibrate(
    grid=frames["grid"][0],
    plate=frames["plate"],
    strips=frames["strips"],
    phase_shifts_deg=(0, 120, 240),
    camera_height_mm=fringecal.known(1500.0, u=5.0),
)
rig = calibration.rig

# %% [markdown]
# ## The law
# `z = (phi - phi_plate) / (d phi / d z)`, the slope taken on the plate along the pixel's ray.


# %%
def linear_height(phase, rays):
    """Height by the slope of the phase on the plate, mm."""
    along_x, along_y, along_z = rig.model.gradient(rays.ax, rays.ay, 0.0)
    slope = along_z + along_x * rays.bx + along_y * rays.by
    return (phase - rig.model.phase(rays.ax, rays.ay, 0.0)) / slope


# %% [markdown]
# ## Against the rig model, and the thesis's constant angle
# Phase of a flat at each height, as the rig model has it, read by each law: the error over the field.

# %%
u, v = np.meshgrid(np.linspace(0, rig.camera.width_px - 1, 9), np.linspace(0, rig.camera.height_px - 1, 7))
rays = rig.camera.rays(u, v)
constant = height_model(rig, "constant-angle").height
for height_mm in (2.0, 10.0, 30.0):
    phase = rig.model.phase(*rays.at(height_mm), height_mm)
    for name, law in (("own line", linear_height), ("constant angle", constant)):
        percent = 100 * (law(phase, rays) / height_mm - 1)
        print(f"{height_mm:4.0f} mm, {name}: {percent.min():+.2f} to {percent.max():+.2f} %")
