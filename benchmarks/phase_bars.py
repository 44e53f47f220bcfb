"""Figures of the phase room against closed forms and real pictures, one line for each.

Run: python benchmarks/phase_bars.py. Noise of N frames and its stated interval over 100 simulations, exact errors of
gamma, steps and brightness, steps of real sets, what is left of gamma, orders by evidence. Nothing is compared with
itself: the expected values are formulas or published numbers, written beside what was found.
"""

from pathlib import Path

import cv2
import numpy as np

from fringecal.phase import (
    Noise,
    correct_gamma,
    decide_orders,
    demodulate,
    demodulate_adapted,
    diagnose,
    estimate_phase_shifts,
    estimate_waveform,
    order_error_rate,
    unwrap_guided,
)

DATA = Path(__file__).parents[1] / "tests" / "data"
ANGLE = np.linspace(-np.pi, np.pi, 721)
THREE = np.deg2rad([0, 120, 240])


def wrap(x):
    return np.angle(np.exp(1j * x))


def taken(phase, steps, rng, background=120.0, modulation=80.0, sigma=1.0, gain=0.0, wave=np.cos):
    frames = background + modulation * wave(phase + steps[:, None, None])
    noisy = frames + rng.standard_normal(frames.shape) * np.sqrt(sigma**2 + gain * np.maximum(frames, 0))
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def noise_of_frames(simulations=100):
    v, u = np.mgrid[:64, :96]
    truth = 2 * np.pi * (u + 0.2 * v) / 13
    print(
        f"phase noise over {simulations} simulations of 64 x 96 px; with gain: variance 0.25 I + 1 + 1/12 of rounding"
    )
    for n in (3, 4, 5, 8):
        steps = 2 * np.pi * np.arange(n) / n
        for gain in (0.0, 0.25):
            squares, inside, stated = [], [], []
            for seed in range(simulations):
                frames = taken(truth, steps, np.random.default_rng(seed), sigma=2.0 if gain == 0 else 1.0, gain=gain)
                noise = Noise(np.hypot(2.0 if gain == 0 else 1.0, 12**-0.5), gain)
                found = demodulate(frames, steps, noise=noise)
                error = wrap(found.phase - truth)
                squares.append(np.mean(error**2))
                stated.append(np.mean(found.sigma**2))
                inside.append(np.mean(np.abs(error) < 1.96 * found.sigma))
            rms, said = np.sqrt(np.mean(squares)), np.sqrt(np.mean(stated))
            variance = gain * 120 + noise.read_sigma**2
            formula = np.sqrt(2 * variance / n) / 80
            print(
                f"  N = {n}, gain {gain:4.2f}: {rms:.5f} rad, formula {formula:.5f} ({rms / formula - 1:+.2%}; "
                f"stated {said / rms - 1:+.2%}), 95 % interval holds {np.mean(inside):.2%}"
            )


def exact_errors():
    print("exact errors (formula - found), deg")
    for exponent in (1.1, 1.5, 2.2, 2.8):
        ratios = [1.0]
        for k in range(1, 9):
            ratios.append(ratios[-1] * (exponent - k) / (exponent + k + 1))
        a = dict(enumerate(ratios, start=1))
        above = -(a[2] - a[4]) * np.sin(3 * ANGLE) - (a[5] - a[7]) * np.sin(6 * ANGLE)
        below = a[1] + (a[2] + a[4]) * np.cos(3 * ANGLE) + (a[5] + a[7]) * np.cos(6 * ANGLE)
        frames = 200 * (0.5 + 0.5 * np.cos(ANGLE + THREE[:, None, None])) ** exponent
        off = np.rad2deg(wrap(demodulate(frames, THREE, noise=Noise(0.1)).phase[0] - ANGLE))
        formula = np.rad2deg(np.arctan2(above, below))
        print(f"  gamma {exponent}: {np.abs(off - formula).max():.4f} of {np.abs(formula).max():.2f} (bar 0.02)")
    turn = ANGLE[:-1]
    cases = {
        "steps of three 121 deg apart": (np.deg2rad([0, 1.0, -1.0]), 1.0, 2, np.deg2rad(1) / np.sqrt(3)),
        "a frame 1 % brighter": (np.zeros(3), np.array([1, 1, 1.01]), 1, np.deg2rad(0.72)),
    }
    for title, (off, lamp, order, formula) in cases.items():
        light = 100 + 53 * np.cos(turn + (THREE + off)[:, None, None])
        found = demodulate(light * np.reshape(lamp, (-1, 1, 1)), THREE, noise=Noise(0.1)).phase[0]
        size = 2 * np.abs(np.fft.rfft(wrap(found - turn))[order]) / turn.size
        print(f"  {title}: order {order} of {np.rad2deg(size):.4f}, formula {np.rad2deg(formula):.4f}")


def real(name, files):
    return np.stack([cv2.imread(str(DATA / name / file), cv2.IMREAD_GRAYSCALE) for file in files])


def real_sets():
    lens = real("fpp_tools_lens", [f"lens_orig_{angle:03d}.jpg" for angle in (0, 90, 180, 270)])
    steps = estimate_phase_shifts(lens, np.deg2rad([0, 90, 180, 270]))
    print(
        f"fpp_tools_lens: steps {np.rad2deg(steps.phase_shifts_rad).round(2)}, published 0, 90.4, 180.3, 270.1 +- 0.5"
    )
    wall = real("kamino_object1", [f"pat{k:02d}.png" for k in range(3)])
    found = np.rad2deg(estimate_phase_shifts(wall, np.deg2rad([-120, 0, 120])).phase_shifts_rad)
    print(f"kamino_object1: steps {found.round(2)}, stated -120, 0, 120")
    plane, stated = real("kamino_gamma_plane", [f"pat{k:02d}.png" for k in range(3)]), np.deg2rad([-120, 0, 120])
    wave = estimate_waveform(plane, stated)
    bare = demodulate(plane, stated)
    ripples = [ripple_of(one, bare.phase) for one in (bare, correct_gamma(bare, stated, wave))]
    names = [kind.value for kind in diagnose(plane, stated).kinds()]
    print(f"kamino gamma 0.75: named {names}; ripple {ripples[0]:.4f} -> {ripples[1]:.4f} rad rms along a row, "
          f"{ripples[0] / ripples[1]:.1f} times less (bar 3)")  # fmt: skip


def _longest(valid):
    """Ends of the longest run of valid pixels."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], valid.astype(int), [0]])))
    return max(edges.reshape(-1, 2).tolist(), key=lambda ends: ends[1] - ends[0], default=(0, 0))


def ripple_of(map_, plain):
    """Rms of the orders 1 to 6 of the residual against a quartic, along the longest row without a gap."""
    valid = np.isfinite(map_.phase) & np.isfinite(plain)
    row = max(range(len(valid)), key=lambda k: _longest(valid[k])[1] - _longest(valid[k])[0])
    use = np.zeros(valid.shape[1], bool)
    use[slice(*_longest(valid[row]))] = True
    phase = np.unwrap(map_.phase[row][use])
    x = np.linspace(-1, 1, use.size)[use]
    waves = [f(k * plain[row][use]) for k in range(1, 7) for f in (np.cos, np.sin)]
    basis = np.column_stack([*(x**k for k in range(5)), *waves])
    fit = np.linalg.lstsq(basis, phase)[0]
    return float(np.std(basis[:, 5:] @ fit[5:]))


def gamma_left():
    rng = np.random.default_rng(3)
    v, u = np.mgrid[:400, :600]
    truth = 2 * np.pi * (u + 0.15 * v) / 16
    albedo = np.where((u // 150 + v // 100) % 2 == 0, 1.0, 0.3)
    frames = 230 * albedo * (0.5 + 0.5 * np.cos(truth + THREE[:, None, None])) ** 2.2
    shot = np.clip(np.rint(frames + rng.standard_normal(frames.shape)), 0, 255).astype(np.uint8)
    found = demodulate_adapted(shot, THREE).map
    plain = demodulate(shot, THREE)
    for title, part in (("bright", albedo == 1), ("dark", albedo < 1)):
        sides = []
        for map_ in (plain, found):
            error = wrap(map_.phase - truth)[part]
            use = np.isfinite(error)
            basis = np.column_stack([f(k * truth[part][use]) for k in range(1, 7) for f in (np.cos, np.sin)])
            fit = np.linalg.lstsq(basis, error[use] - error[use].mean())[0]
            sides.append(float(np.std(basis @ fit)))
        print(f"gamma 2.2, three steps, {title} parts: ripple {sides[0]:.4f} -> {sides[1]:.4f} rad rms (bar 0.02)")


def orders():
    rng = np.random.default_rng(8)
    v, u = np.mgrid[:400, :400] / 400
    plate = 2 * np.pi * v * 20
    on = sum((np.abs(u - 0.14 - 0.18 * k) < 0.045) & (np.abs(v - 0.5) < 0.4) for k in range(5))
    truth = plate + on * (3.9 + 0.5 * v)
    for sigma in (0.05, 0.1, 0.3):
        fine, coarse = (wrap(r * truth + sigma * rng.standard_normal(truth.shape)) for r in (1, 1 / 8))
        guided, _ = unwrap_guided(fine, plate, -0.7, 5.1)
        by_two = decide_orders([fine, coarse], np.full((2, *truth.shape), sigma), (1, 8))
        turns = np.rint((by_two.phase - truth) / (2 * np.pi))
        alone = fine + 2 * np.pi * np.rint((8 * (truth / 8 + wrap(coarse - truth / 8)) - fine) / (2 * np.pi))
        heights, two = (np.abs(guided - truth) < np.pi).mean(), (turns % 8 == 0).mean()
        single, predicted = (np.abs(alone - truth) < np.pi).mean(), 1 - float(order_error_rate(sigma, sigma, 8))
        print(
            f"five strips, noise {sigma:4.2f} rad: right by known heights {heights:.3%}, by two periods {two:.3%}, "
            f"each pixel alone {single:.2%} (predicted {predicted:.2%})"
        )


if __name__ == "__main__":
    noise_of_frames()
    exact_errors()
    real_sets()
    gamma_left()
    orders()
