"""Fringe orders of objects that no test was tuned to: how many valid pixels are wrong, how many decidable ones valid.

Run: python benchmarks/object_orders.py [--from N] [--cases N] [--seed S] [--cache DIR]. A pixel is wrong if its step
over the plate is half a fringe or more off; decidable if the surface leads from the bare plate to it without a break.
"""

import argparse
import pickle
from pathlib import Path

import numpy as np
import pandas as pd

from fringecal.phase import demodulate
from fringecal.reconstruct import absolute_phase
from object_population import Case, draw_case, facts


def measured(case: Case) -> dict[str, float]:
    """Rates of one case."""
    phase = demodulate(case.frames.frames, case.phase_shifts_rad)
    found = absolute_phase(phase, case.calibration)
    truth, valid = case.true_step_rad(), found.reasons == 0
    decidable = case.decidable() & phase.valid
    wrong = valid & ~(np.abs(found.difference_rad - truth) < np.pi)
    return {
        "valid": int(valid.sum()),
        "wrong": int(wrong.sum()),
        "decidable": int(decidable.sum()),
        "decided": int((valid & decidable).sum()),
        "beyond": int((valid & ~decidable).sum()),
    }


def case_of(number: int, seed: int, cache: Path | None) -> Case:
    path = cache and cache / f"{seed}-{number}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    case = draw_case(number, seed=seed)
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
    parser.add_argument("--every", action="store_true", help="print every case")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.cases)
    cases = (case_of(n, arguments.seed, arguments.cache) for n in numbers)
    rows = pd.DataFrame([facts(case) | measured(case) for case in cases])
    if arguments.every:
        print(rows.to_string(index=False))
    sums = rows.groupby("kind")[["valid", "wrong", "decidable", "decided", "beyond"]].sum()
    sums.loc["all"] = sums.sum()
    sums["wrong per 10,000"] = 1e4 * sums["wrong"] / sums["valid"]
    sums["decided %"] = 100 * sums["decided"] / sums["decidable"]
    print(sums.round(2).to_string())
