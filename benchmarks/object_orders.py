"""Fringe orders of objects that no test was tuned to: how many valid pixels are wrong, how many decidable ones valid.

Run: python benchmarks/object_orders.py [--from N] [--cases N] [--seed S] [--cache DIR]. A pixel is wrong if its step
over the plate is half a fringe or more off; decidable if the surface leads from the bare plate to it without a break,
or, with a second period, wherever light falls.
"""

import argparse
import pickle
from pathlib import Path

import numpy as np
import pandas as pd

from fringecal.phase import PhaseMap, demodulate
from fringecal.reconstruct import absolute_phase
from fringecal.session import capture_of_arrays
from fringecal.workflows.shared import phase_of_capture
from object_population import Case, draw_case, facts


def phase_of(case: Case) -> PhaseMap:
    """Demodulate a case; with a second period, with the orders that it gives."""
    if not case.periods:
        return demodulate(case.frames.frames, case.phase_shifts_rad)
    shifts = case.spec.steps.nominal_deg
    capture = capture_of_arrays("o", "object", case.frames.frames, phase_shifts_deg=shifts, periods=case.periods)
    return phase_of_capture(capture).map


def measured(case: Case) -> dict[str, float]:
    """Rates of one case."""
    phase = phase_of(case)
    found = absolute_phase(phase, case.calibration)
    truth, valid = case.true_step_rad(), found.reasons == 0
    decidable = (case.frames.lit if case.periods else case.decidable()) & phase.valid
    wrong = valid & ~(np.abs(found.difference_rad - truth) < np.pi)
    return {
        "valid": int(valid.sum()),
        "wrong": int(wrong.sum()),
        "decidable": int(decidable.sum()),
        "decided": int((valid & decidable).sum()),
        "beyond": int((valid & ~decidable).sum()),
    }


def case_of(number: int, seed: int, cache: Path | None, *, second: bool = False) -> Case:
    path = cache and cache / f"{seed}-{number}{'-second' * second}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    case = draw_case(number, seed=seed, second=second)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(pickle.dumps(case))
    return case


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--second", action="store_true", help="with a second period")
    parser.add_argument("--every", action="store_true", help="print every case")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.cases)
    cases = (case_of(n, arguments.seed, arguments.cache, second=arguments.second) for n in numbers)
    rows = pd.DataFrame([facts(case) | measured(case) for case in cases])
    if arguments.every:
        print(rows.to_string(index=False))
    sums = rows.groupby("kind")[["valid", "wrong", "decidable", "decided", "beyond"]].sum()
    sums.loc["all"] = sums.sum()
    sums["wrong per 10,000"] = 1e4 * sums["wrong"] / sums["valid"]
    sums["decided %"] = 100 * sums["decided"] / sums["decidable"]
    print(sums.round(2).to_string())
