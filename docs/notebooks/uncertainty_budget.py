# %% [markdown]
# # Looking into an uncertainty budget
#
# Where the uncertainty of angle, scale and heights comes from, and what would bring it down. Run it from the root of
# the source tree.

# %%
import numpy as np

import fringecal
from fringecal.projector import check_by_monte_carlo
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

# %% [markdown]
# ## The projection angle
# Contribution of each source to u, and its share of the variance.

# %%
print(calibration.budget("projection.angle"))
figure = calibration.plot("projection.angle")

# %% [markdown]
# ## A budget of one's own
# Any quantity that can be computed from the calibrated rig has one: the change of the quantity by one standard
# uncertainty of every component. Here: the height read at the picture's centre from a phase difference of one fringe.

# %%
rig = calibration.rig
centre = rig.camera.centre_px
phase = float(rig.model.phase(*rig.camera.rays(*centre).at(0.0), 0.0)) - 2 * np.pi


def height_of_one_fringe(shifted):
    """Height at the centre whose phase is one fringe from the plate's, mm."""
    return float(shifted.model.height(phase, shifted.camera.rays(*centre)))


budget = rig.budget(height_of_one_fringe, unit="mm", label="height of one fringe")
print(budget.result)
print(budget.table())

# %% [markdown]
# ## The same by Monte Carlo
# A budget is of first order. Rigs that are drawn at random, all components at once, show whether that is enough: the
# standard uncertainties agree, and so do both ends of the 95 % interval.

# %%
checked = check_by_monte_carlo(rig, {"height / mm": height_of_one_fringe}, np.random.default_rng(1), trials=2000)
print(checked["height / mm"].monte_carlo)
print(f"u by first order over u of the draws: {checked['height / mm'].u_ratio:.2f}")

# %% [markdown]
# ## What to measure next
# Forecasts of u at several heights, and what one more artefact would buy.

# %%
for sentence in calibration.found.advice.sentences:
    print(sentence)
