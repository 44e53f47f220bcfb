# %% [markdown]
# # A new artefact
#
# An artefact of your own: state its certified numbers, measure it, and set its errors beside the certificate. Run it
# from the root of the source tree.

# %%
import fringecal
from fringecal.simulate import load_rig, simulate_session
from fringecal.targets import parse_target

block = parse_target(
    {
        "format": 1,
        "kind": "steps",
        "name": "three steps",
        "certificate": "gauge blocks wrung together, 2026",
        "heights_mm": {"value": [2.0, 5.0, 9.0], "u": 0.002},
        "width_mm": {"value": 40.0, "u": 0.05},
        "length_mm": {"value": 60.0, "u": 0.05},
    }
)

# %% [markdown]
# The virtual rig photographs it; a real one is laid on the plate, anywhere and at any angle.

# %%
rig = load_rig("docs/tutorial-rig.toml")
shown = {
    "name": "block",
    "kind": "artefact",
    "target": block.model_dump(mode="json"),
    "position_mm": (10.0, 5.0),
    "rotation_deg": 15.0,
}
captures = [capture.model_dump() for capture in rig.capture if capture.name in ("grid", "plate", "strips")]
taken = simulate_session(rig.at(capture=[*captures, shown]), seed=1)
frames = {name: capture.frames for name, capture in taken.captures.items()}

# %%
calibration = fringecal.calibrate(
    grid=frames["grid"][0],
    plate=frames["plate"],
    strips=frames["strips"],
    phase_shifts_deg=(0, 120, 240),
    camera_height_mm=fringecal.known(1500.0, u=5.0),
)
result = calibration.verify(frames["block"], block)
print(result)
print(result.table[["measured", "certified", "error", "u", "En"]])
