"""How often the doctor names an injected fault, and how often it names one on a clean set.

Run: python benchmarks/phase_doctor.py [--sets N] [--real ROUNDS]. Every fault of `tests/phase/test_doctor.py` on N
random virtual sets, vibration between three repeats, and N clean ones; with --real, faults put into the real captures
of `tests/data` as well, and what the doctor says of those as they are.
"""

import argparse
import collections
import importlib.util
from pathlib import Path

import cv2
import numpy as np

from fringecal.phase import compare_repeats, demodulate, diagnose, findings_of_repeats

ROOT = Path(__file__).parents[1] / "tests"
DATA = ROOT / "data"
REAL = {
    "fpp_tools_lens": ((0, 90, 180, 270), "*.jpg", slice(0, 4), np.s_[170:300, 90:720]),
    "kamino_object1": ((-120, 0, 120), "*.png", slice(0, 3), np.s_[30:400, 420:1400]),
    "kamino_gamma_plane": ((-120, 0, 120), "*.png", slice(0, 3), np.s_[:, :]),
}


def bench_module():
    path = ROOT / "phase" / "test_doctor.py"
    spec = importlib.util.spec_from_file_location("doctor_faults", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def real_set(name):
    steps, pattern, which, part = REAL[name]
    files = sorted((DATA / name).glob(pattern))[which]
    return np.stack([cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)[part] for file in files]), np.deg2rad(steps)


def grey(values):
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def real_faults(frames, steps, rng):
    """Give every fault that can be put into pictures already taken, by name."""
    n, bright = len(frames), frames.astype(float)
    i, j = rng.choice(n, 2, replace=False)
    order = np.arange(n)
    order[[i, j]] = j, i
    one = np.where(np.arange(n) == i, 1.0, 0.0)[:, None, None]
    mean = bright.mean(axis=0)
    map_ = demodulate(frames, steps, max_misfit=np.inf)
    phase, light = np.nan_to_num(map_.phase), map_.modulation
    turned = (steps + np.deg2rad(5) * (np.arange(n) == i))[:, None, None]
    noise = rng.standard_normal(frames.shape)
    yield "swapped frames", frames[order]
    yield "stale frame", np.where(one > 0, frames[j], frames)
    yield "duplicate frames", grey(np.where(one > 0, bright[j] + noise, bright))
    yield "lamp drift", grey(bright * (1 + 0.05 * one))
    yield "vibration", grey(bright - 0.2 * one * (bright - mean))
    yield "gamma", grey(255 * (bright / 255) ** 1.8)
    yield "saturation", grey(bright * 1.4 * 255 / np.percentile(bright.max(axis=0), 98))
    yield "defocus", grey(0.85 * mean + 0.15 * bright)
    yield "wrong steps", grey(map_.background + light * np.cos(phase + turned) + 0.5 * noise)


def shaken(frames, steps, rng, moved_rad=0.05):
    """Take a set three times, each frame of the repeats moved a little."""
    map_ = demodulate(frames, steps, max_misfit=np.inf)
    phase = np.nan_to_num(map_.phase)
    sets = []
    for _ in range(3):
        delta = (steps + moved_rad * rng.standard_normal(len(steps)))[:, None, None]
        wave = map_.background + map_.modulation * np.cos(phase + delta)
        sets.append(grey(np.where(map_.valid, wave, frames) + 0.7 * rng.standard_normal(frames.shape)))
    return np.stack(sets)


def repeats_named(frames, steps, rng, moved_rad):
    names = [one.name for one in findings_of_repeats(compare_repeats(shaken(frames, steps, rng, moved_rad), steps))]
    return "vibration between repeats" in names


def virtual(sets):
    injected = bench_module()
    false, rng = collections.Counter(), np.random.default_rng(1)
    for seed in range(sets):
        bench = injected.Bench(5000 + seed)
        frames = bench.shoot()
        false.update(diagnose(frames, bench.steps).names())
        false.update(["vibration between repeats"] * repeats_named(frames, bench.steps, rng, 0.0))
    print(f"false names on {sets} clean sets: {dict(false) or 'none'}")
    named, total = collections.Counter(), collections.Counter()
    for seed in range(sets):
        bench = injected.Bench(9000 + seed)
        for name, frames, plate in injected.faults(bench):
            total[name] += 1
            named[name] += name in diagnose(frames, bench.steps, reference=plate).names()
        total["vibration between repeats"] += 1
        named["vibration between repeats"] += repeats_named(bench.shoot(), bench.steps, rng, 0.05)
    for name, count in total.items():
        print(f"{name:28s} named in {named[name]:4d} of {count} = {named[name] / count:.1%}")


def real(rounds):
    rng = np.random.default_rng(2)
    for name in REAL:
        frames, steps = real_set(name)
        found = diagnose(frames, steps)
        print(f"{name} as it is: {', '.join(found.names()) or 'nothing'}; {'; '.join(found.notes)}")
        missed, count = [], 0
        for _ in range(rounds):
            for fault, pictures in real_faults(frames, steps, rng):
                # Three frames in another order look perfect alone: the plate beside them tells.
                names = diagnose(pictures, steps, reference=frames if fault == "swapped frames" else None).names()
                missed += [] if fault in names else [fault]
                count += 1
            missed += [] if repeats_named(frames, steps, rng, 0.05) else ["vibration between repeats"]
            count += 1
        print(f"  {count - len(missed)} of {count} injected faults named; missed: {dict(collections.Counter(missed))}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--real", type=int, default=0, metavar="ROUNDS")
    chosen = parser.parse_args()
    if chosen.sets:
        virtual(chosen.sets)
    if chosen.real:
        real(chosen.real)
