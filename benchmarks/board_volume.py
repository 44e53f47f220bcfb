"""The 5 Mpx rig dlp from frames to verified lengths: drawn, commissioned from its folder, and measured in its volume.

    python benchmarks/board_volume.py --rig dlp-small --folder volume          # minutes; --rig dlp, an hour
    python benchmarks/board_volume.py --folder volume --only measure            # again, on what is drawn

Fifteen poses of a board, 3 steps of 3 periods along both axes, one grey level of noise; then, in poses of their own, a
plane that fills the picture, a ball of 25 mm radius and a ball bar. Captures are drawn one at a time, each in a process
of its own, into `folder/session`; what is there is not drawn again. `fringecal commission` runs as a command. Of the
planes, the distance from the plane of best fit is stated twice: of single pixels, and of what is left of it when the
noise is averaged over windows of 1/40 of the picture, which is the calibration's.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from fringecal.records import read_board_calibration
from fringecal.session import load_session, write_session
from fringecal.simulate import RasterRigSpec, load_raster_rig, simulate_raster_session
from fringecal.workflows.verify import VolumeVerification, verify_in_volume

BAR_S, BAR_SHARE = 90.0, 1 / 20_000
PLANES = {
    "plane-1": ((0.0, 0.0, 600.0), (3.0, -4.0, 0.0)),
    "plane-2": ((0.0, 0.0, 575.0), (18.0, 12.0, 0.0)),
    "plane-3": ((0.0, 0.0, 625.0), (-15.0, -20.0, 0.0)),
}
FLAT = {"format": 1, "kind": "flat", "name": "flat", "certificate": "virtual", "flatness_mm": {"value": 0, "u": 0.0005}}
BALL = {"format": 1, "kind": "sphere", "name": "ball", "certificate": "virtual",
        "diameter_mm": {"value": 50.0, "u": 0.0005}}  # fmt: skip
BAR = {"format": 1, "kind": "ball-bar", "name": "bar", "certificate": "virtual",
       "diameters_mm": {"value": [30.0, 30.0], "u": 0.0005}, "spacing_mm": {"value": 120.0, "u": 0.0005}}  # fmt: skip
SIGHTS = {
    "ball-1": (BALL, (10.0, -5.0, 625.0), (8.0, -10.0, 20.0)),
    "bar-1": (BAR, (0.0, 0.0, 620.0), (-6.0, 9.0, 25.0)),
}


def rig_named(name: str) -> RasterRigSpec:
    """The shipped rig's poses, and planes and balls of this benchmark."""
    rig = load_raster_rig(name)
    kept: list[dict[str, object]] = [one.model_dump() for one in rig.capture if one.kind == "board"]
    for label, (place, turn) in PLANES.items():
        kept.append({"name": label, "kind": "artefact", "target": FLAT, "position_mm": place, "turn_deg": turn})
    for label, (target, place, turn) in SIGHTS.items():
        kept.append({"name": label, "kind": "artefact", "target": target, "position_mm": place, "turn_deg": turn})
    return rig.at(capture=kept)


def draw(name: str, label: str, folder: Path, seed: int) -> None:
    """Draw one capture into a folder of its own."""
    start = time.process_time()
    made = simulate_raster_session(rig_named(name), [label], seed=seed, with_truth=False)
    write_session(folder / "parts" / label, made.document, made.frames, extra_files=made.files, overwrite=True)
    took, peak = time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{label}: drawn in {took:.1f} s of processor time, {peak:.1f} GB", flush=True)


def drawn(name: str, folder: Path, seed: int, prefix: list[str]) -> Path:
    """Draw what is missing, and put the captures together in one session of links."""
    rig, whole = rig_named(name), folder / "session"
    for capture in rig.capture:
        if not (folder / "parts" / capture.name / "session.toml").is_file():
            own = [sys.executable, __file__, "--rig", name, "--folder", str(folder), "--seed", str(seed)]
            subprocess.run([*prefix, *own, "--draw", capture.name], check=True)
    whole.mkdir(parents=True, exist_ok=True)
    text = ""
    for capture in rig.capture:
        part = folder / "parts" / capture.name
        head, _, tables = (part / "session.toml").read_text().partition("[[capture]]")
        text = (text or head) + "[[capture]]" + tables.rstrip() + "\n\n"
        for file in part.iterdir():
            if file.name != "session.toml" and not (whole / file.name).exists():
                os.link(file, whole / file.name)
    (whole / "session.toml").write_text(text)
    return whole


def commissioned(session: Path, out: Path, prefix: list[str]) -> None:
    """Run the command, and print how long it took, and its peak of memory."""
    start = time.perf_counter()
    words = [*prefix, sys.executable, "-m", "fringecal", "commission", str(session), "--out", str(out), "--json"]
    done = subprocess.run(words, check=False, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise SystemExit(done.stderr)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    took, own = time.perf_counter() - start, used.ru_utime + used.ru_stime
    print(f"commissioned in {took:.0f} s, {own:.0f} s of processor time (bar {BAR_S:.0f} s on two cores, so "
          f"{2 * BAR_S:.0f}), peak {used.ru_maxrss / 1e6:.1f} GB, exit code {done.returncode}", flush=True)  # fmt: skip


def measured(session: Path, calibration: Path) -> None:
    """Measure planes and balls, and print their errors beside the bars."""
    written, loaded = read_board_calibration(calibration), load_session(session)
    print(f"residual {written.stereo_rms_px:.4f} px, u of a point {written.volume.u_least_mm:.4f} to "
          f"{written.volume.u_largest_mm:.4f} mm, baseline {written.baseline_mm.value:.4f} mm u "
          f"{written.baseline_mm.u:.4f}", flush=True)  # fmt: skip
    for name in (*PLANES, *SIGHTS):
        if name not in loaded.captures:
            continue
        found = verify_in_volume(loaded, name, written)
        if name in PLANES:
            plane(name, found)
        for one in found.readings:
            if one.en is not None:
                print(f"  {name}: {one.name} error {1e3 * one.error:+.1f} um, U {2e3 * one.u_measured:.1f} um, "
                      f"En {one.en:+.2f}", flush=True)  # fmt: skip
        print(f"  {name}: pixels' departures over their u {found.departures.ratio:.2f}", flush=True)


def plane(name: str, found: VolumeVerification) -> None:
    """Print how flat a plane is: single pixels, and what the mean over windows leaves beside their noise."""
    off, volume = found.residual_mm, found.seen.volume
    side = max(2, off.shape[1] // 40)
    rows, columns = off.shape[0] // side, off.shape[1] // side
    tiles = off[: rows * side, : columns * side].reshape(rows, side, columns, side)
    tiles = tiles.transpose(0, 2, 1, 3).reshape(rows * columns, side**2)
    tiles = tiles[np.isfinite(tiles).mean(axis=1) > 0.8]
    means, sd = np.nanmean(tiles, axis=1), float(np.nanstd(off))
    noise = float(np.sqrt(np.mean(np.nanvar(tiles, axis=1) / np.isfinite(tiles).sum(axis=1))))
    left = float(np.sqrt(max(np.mean(means**2) - noise**2, 0.0)))
    seen = np.isfinite(off)
    diagonal = float(np.hypot(*(np.ptp(axis[seen]) for axis in (volume.x, volume.y))))
    print(f"{name}: pixels sd {1e3 * sd:.1f} um; noise removed {1e3 * left:.1f} um, 1:{diagonal / max(left, 1e-9):.0f} "
          f"of the field's diagonal {diagonal:.0f} mm (bar 1:{1 / BAR_SHARE:.0f})", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", default="dlp-small")
    parser.add_argument("--folder", type=Path, default=Path("board-volume"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--prefix", default="", help="put before each command, such as nice")
    parser.add_argument("--draw", help="draw this capture alone")
    parser.add_argument("--only", choices=["draw", "commission", "measure"])
    options = parser.parse_args()
    if options.draw:
        draw(options.rig, options.draw, options.folder, options.seed)
        return
    session, calibration = options.folder / "session", options.folder / "calibration"
    if options.only in (None, "draw"):
        drawn(options.rig, options.folder, options.seed, options.prefix.split())
    if options.only in (None, "commission"):
        commissioned(session, calibration, options.prefix.split())
    if options.only in (None, "measure"):
        measured(session, calibration)


if __name__ == "__main__":
    main()
