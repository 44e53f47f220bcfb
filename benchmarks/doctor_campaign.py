"""How often the doctor names an injected fault, and how often it names one on a clean set.

Run: python benchmarks/doctor_campaign.py [--sets N] [--clean N] [--rounds N] [--rows FILE]. Every fault of the
doctor's list goes into N random analytic plates (those of `tests/phase/test_doctor.py`), N plates rendered with the
virtual rigs, and `rounds` times into the real captures of `tests/data`; then as many clean analytic and rendered plates
are looked at. One row for each set goes to FILE as it is found; the table at the end counts by fault and kind of set.
"""

import argparse
import collections
import csv
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from fringecal.phase import compare_repeats, demodulate, diagnose, findings_of_repeats
from fringecal.simulate import load_rig, simulate_session

ROOT = Path(__file__).parents[1] / "tests"
DATA = ROOT / "data"
BETWEEN_REPEATS = "vibration between repeats"
REAL = {
    "lens board": ("fpp_tools_lens", (0, 90, 180, 270), slice(0, 4), np.s_[170:300, 90:720]),
    "wall, short": ("kamino_object1", (-120, 0, 120), slice(0, 3), np.s_[30:400, 420:1400]),
    "wall, long": ("kamino_object1", (-120, 0, 120), slice(3, 6), np.s_[30:400, 420:1900]),
    "wall, gamma 0.75": ("kamino_gamma_plane", (-120, 0, 120), slice(0, 3), np.s_[:, :]),
    "wall, gamma 1.25": ("kamino_gamma_plane", (-120, 0, 120), slice(3, 6), np.s_[:, :]),
}
# Two lengths of a block side by side: a change of the steps along the picture cannot be told from a bent carrier.
SIX_FRINGES = ("wall, gamma 0.75", "wall, gamma 1.25")
RIGS = ("thesis", "oblique", "telecentric")
STEPS = ((0, 120, 240), (0, 90, 180, 270), (0, 72, 144, 216, 288), (0, 45, 90, 135, 180, 225, 270, 315))


def names_of(found):
    """Kinds of the findings, as files name them."""
    return tuple(kind.value for kind in found.kinds())


def bench_module():
    path = ROOT / "phase" / "test_doctor.py"
    spec = importlib.util.spec_from_file_location("doctor_faults", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def real_set(name):
    folder, steps, which, part = REAL[name]
    files = sorted(path for path in (DATA / folder).iterdir() if path.suffix in (".png", ".jpg"))[which]
    return np.stack([cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)[part] for file in files]), np.deg2rad(steps)


def rendered(seed, **faults):
    """Take a plate with one of the virtual rigs at random pitch, direction, noise and number of steps."""
    rng = np.random.default_rng(seed)
    steps = STEPS[rng.integers(len(STEPS))]
    rig = load_rig(RIGS[rng.integers(len(RIGS))])
    scale = 2 * rig.camera.scale_mm_per_px
    projector = {
        "pitch_mm": float(scale * rng.uniform(9, 25)),
        "across_deg": float(rng.uniform(0, 180)),
        "contrast": float(rng.uniform(0.6, 0.95)),
        "gamma": float(faults.get("gamma", 1.0)),
        "defocus_mm": 0.0,
        "distortion": (0.0, 0.0),
    }
    errors = {key: faults.get(key, ()) for key in ("error_deg", "tilt_deg")}
    capture = [one.model_dump() for one in rig.capture if one.kind == "reference"][:1]
    rig = rig.at(
        camera={"width_px": 320, "height_px": 260, "scale_mm_per_px": scale},
        projector=projector,
        steps={"nominal_deg": steps} | errors,
        light={"flicker": 0.0},
        noise={"read_levels": float(rng.uniform(0.4, 1.5))},
        capture=capture,
    )
    (shot,) = simulate_session(rig, seed=seed, with_truth=False).captures.values()
    return shot.frames, np.deg2rad(steps)


def grey(values):
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def in_pictures(frames, steps, rng) -> Iterator:
    """Give every fault that can be put into pictures already taken, by name."""
    n, bright = len(frames), frames.astype(float)
    i, j = rng.choice(n, 2, replace=False)
    order = np.arange(n)
    order[[i, j]] = j, i
    one = np.where(np.arange(n) == i, 1.0, 0.0)[:, None, None]
    mean = bright.mean(axis=0)
    map_ = demodulate(frames, steps, max_residual=np.inf)
    phase, light = np.nan_to_num(map_.phase), np.where(map_.valid, map_.modulation, 0)
    noise = rng.standard_normal(frames.shape)
    sign = rng.choice([-1, 1])

    def again(wave):
        """Draw the same scene with another wave: same background, modulation and phase."""
        return grey(np.where(map_.valid, map_.background + light * wave, bright) + 0.5 * noise)

    delta = steps[:, None, None]
    across = np.linspace(-0.5, 0.5, frames.shape[2])
    turn = np.arange(n)[:, None, None] * np.deg2rad(rng.uniform(3, 8)) * across
    flat = rng.uniform(0.3, 0.7)
    yield "swapped frames", frames[order]
    yield "stale frame", np.where(one > 0, frames[j], frames)
    yield "duplicate frames", grey(np.where(one > 0, bright[j] + noise, bright))
    yield "lamp drift", grey(bright * (1 + sign * rng.uniform(0.02, 0.08) * one))
    yield "vibration", grey(bright - rng.uniform(0.1, 0.3) * one * (bright - mean))
    yield "gamma", grey(255 * (bright / 255) ** rng.uniform(1.3, 1.7))
    yield "saturation", grey(bright * 1.4 * 255 / np.percentile(bright.max(axis=0), 98))
    yield "defocus", grey(0.85 * mean + 0.15 * bright)
    # A set whose own light is no cosine keeps its gamma: it is moved, not drawn anew.
    turned = np.deg2rad(rng.uniform(3, 8)) * sign * one
    yield "wrong steps", again(np.cos(phase + delta + turned))
    yield "uneven steps", again(np.cos(phase + delta + turn))
    yield "clipped slide", again(np.clip(np.cos(phase + delta), -flat, flat) / (0.5 + 0.5 * flat))
    few = 2 * np.pi * rng.uniform(1.3, 2.8) * across[None, None] + 0 * mean
    yield "too many pixels per fringe", again(np.cos(few + delta))
    fine = 2 * np.pi * np.arange(frames.shape[2]) / rng.uniform(3.3, 5)
    yield "too few pixels per fringe", again(np.cos(fine + delta))


def shaken(frames, steps, rng, moved_rad):
    """Take a set three times, each frame of the repeats moved a little."""
    map_ = demodulate(frames, steps, max_residual=np.inf)
    phase = np.nan_to_num(map_.phase)
    sets = []
    for _ in range(3):
        delta = (steps + moved_rad * rng.standard_normal(len(steps)))[:, None, None]
        wave = map_.background + map_.modulation * np.cos(phase + delta)
        sets.append(grey(np.where(map_.valid, wave, frames) + 0.7 * rng.standard_normal(frames.shape)))
    return np.stack(sets)


def seen_in_repeats(frames, steps, rng, moved_rad):
    return [
        one.kind.value for one in findings_of_repeats(compare_repeats(shaken(frames, steps, rng, moved_rad), steps))
    ]


def analytic_faults(seed):
    injected = bench_module()
    bench = injected.Bench(9000 + seed)
    for name, frames, plate in injected.faults(bench):
        yield name, names_of(diagnose(frames, bench.steps, reference=plate))
    yield BETWEEN_REPEATS, seen_in_repeats(bench.shoot(), bench.steps, bench.rng, 0.05)


def rendered_faults(seed):
    rng = np.random.default_rng(seed)
    frames, steps = rendered(seed)
    drawn = ("gamma", "wrong steps", "uneven steps")
    for name, pictures in in_pictures(frames, steps, rng):
        if name not in drawn:
            yield name, names_of(diagnose(pictures, steps, reference=frames if name == "swapped frames" else None))
    off = tuple(float(rng.uniform(3, 8)) * (k == 1) for k in range(len(steps)))
    turn = tuple((float(k * rng.uniform(3, 8)), 0.0) for k in range(len(steps)))
    ways = {"gamma": float(rng.uniform(1.4, 2.4))}, {"error_deg": off}, {"tilt_deg": turn}
    for name, faults in zip(drawn, ways, strict=True):
        yield name, names_of(diagnose(rendered(seed, **faults)[0], steps))
    yield BETWEEN_REPEATS, seen_in_repeats(frames, steps, rng, 0.05)


def real_faults(name, rng):
    frames, steps = real_set(name)
    for fault, pictures in in_pictures(frames, steps, rng):
        if fault == "uneven steps" and name in SIX_FRINGES:
            continue
        # Three frames in another order look perfect alone: the plate beside them tells.
        yield fault, names_of(diagnose(pictures, steps, reference=frames if fault == "swapped frames" else None))
    yield BETWEEN_REPEATS, seen_in_repeats(frames, steps, rng, 0.05)


def cases(sets, clean, rounds):
    """Give kind of set, which one, the fault put in, and what was named."""
    for seed in range(sets):
        for fault, names in analytic_faults(seed):
            yield "analytic", seed, fault, names
        for fault, names in rendered_faults(seed):
            yield "rendered", seed, fault, names
    rng = np.random.default_rng(2)
    for turn in range(rounds):
        for name in REAL:
            for fault, names in real_faults(name, rng):
                yield "real", f"{name} {turn + 1}", fault, names
    injected = bench_module()
    for seed in range(clean):
        bench = injected.Bench(5000 + seed)
        yield "analytic", seed, "", names_of(diagnose(bench.shoot(), bench.steps))
        frames, steps = rendered(5000 + seed)
        yield "rendered", seed, "", names_of(diagnose(frames, steps))


def main(sets, clean, rounds, rows):
    total, named, false = collections.Counter(), collections.Counter(), collections.Counter()
    kinds = ("analytic", "rendered", "real")
    writer = csv.writer(rows)
    for kind, which, fault, names in cases(sets, clean, rounds):
        writer.writerow([kind, which, fault, "; ".join(names)])
        rows.flush()
        total[kind, fault] += 1
        named[kind, fault] += fault in names
        false.update(names if not fault else [])
    print(f"{'fault':28s}" + "".join(f"{kind:>16s}" for kind in kinds))
    for fault in dict.fromkeys(fault for _, fault in total if fault):
        cells = (f"{named[kind, fault]} of {total[kind, fault]}" for kind in kinds)
        print(f"{fault:28s}" + "".join(f"{cell:>16s}" for cell in cells))
    hits = {kind: sum(named[kind, fault] for k, fault in total if k == kind and fault) for kind in kinds}
    all_of = {kind: sum(total[kind, fault] for k, fault in total if k == kind and fault) for kind in kinds}
    print(f"{'all':28s}" + "".join(f"{hits[k] / max(all_of[k], 1):>16.1%}" for k in kinds))
    print(f"false names on {total['analytic', ''] + total['rendered', '']} clean sets: {dict(false) or 'none'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--clean", type=int, default=25)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rows", type=argparse.FileType("w"), default=sys.stderr)
    chosen = parser.parse_args()
    main(chosen.sets, chosen.clean, chosen.rounds, chosen.rows)
