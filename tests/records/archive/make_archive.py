"""Archive a record of this version with its session: `python tests/records/archive/make_archive.py`.

Run once per release; what stands in tests/records/archive is never made again, since it shows that later versions still
open, apply and repeat it.
"""

from pathlib import Path

from fringecal import __version__
from fringecal.records.calibration_record import write_calibration
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.run import commission

CAPTURES = ("grid", "reference", "strips", "bars")


def main() -> None:
    camera = {"width_px": 280, "height_px": 200, "scale_mm_per_px": 1.2}
    rig = load_rig("thesis").at(camera=camera, projector={"pitch_mm": 12.0})
    shot = simulate_session(rig, CAPTURES, seed=2008, with_truth=False)
    folder = Path(__file__).parent / __version__
    write_session(folder / "session", shot.document, shot.frames, extra_files=shot.files)
    found = commission(load_session(folder / "session"))
    write_calibration(calibration_record(found, command=("fringecal", "commission", "session", "--out", ".")), folder)


if __name__ == "__main__":
    main()
