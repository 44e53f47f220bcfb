# %% [markdown]
# # Commissioning in a notebook
#
# From pictures in memory to a calibrated rig in one call. The pictures are a virtual rig's here; at the bench they
# come from your camera's driver as arrays. Nothing is written to disk until you say so. Run it from the root of the
# source tree, as a script or cell by cell (jupytext opens it as a notebook).

# %%
import fringecal
from fringecal.simulate import load_rig, simulate_session

taken = simulate_session(load_rig("docs/tutorial-rig.toml"), seed=1)
frames = {name: capture.frames for name, capture in taken.captures.items()}

# %% [markdown]
# ## Calibrate
# A grid by room light, then the bare plate and strips of known height under fringes. What is known beforehand is
# stated with its standard uncertainty; the bars take no part in the fit and judge it.

# %%
calibration = fringecal.calibrate(
    grid=frames["grid"][0],
    plate=frames["plate"],
    strips=frames["strips"],
    artefacts={"bars": (frames["bars"], "angle-bars")},
    phase_shifts_deg=(0, 120, 240),
    camera_height_mm=fringecal.known(1500.0, u=5.0),
    projector_mm=fringecal.known([0.0, 1222.0, 1000.0], u=3.0),
)
print(calibration)
print(calibration.estimates)

# %% [markdown]
# ## What was judged
# Every check with its limit and the rule by which it was decided.

# %%
print(calibration.checks[["value", "limit", "decision"]])

# %% [markdown]
# ## Measure
# x, y, z and the standard uncertainty of z at every pixel, NaN where masked.

# %%
leaf = calibration.measure(frames["leaf"])
print(leaf)
highest = leaf.z == leaf.z[leaf.mask].max()
print(f"highest point {leaf.z[highest][0]:.3f} mm, u {leaf.u_z[highest][0]:.3f} mm")
figure = leaf.plot()

# %% [markdown]
# ## Keep
# `calibration.save(folder)` writes the record that every verb of the command takes, `fringecal.Calibration.load`
# reads it back, and `calibration.report(folder)` writes the report.
