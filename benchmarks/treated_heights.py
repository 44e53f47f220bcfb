"""Whether u(z) holds for filters and height models: coverage of 95 % intervals of single pixels, over random objects.

Run: python benchmarks/treated_heights.py [--cases 20] [--seed 0]. Rigs and objects are those of
`object_population.py`, with exact calibrations, so that intervals hold noise, filters and models alone. Printed for
every treatment: pixels, the share within `1.96 u(z)` of the truth, that of the worst case, and the median of u(z) over
that of the untreated heights. Pixels in a wrong fringe order are left
out: `object_orders.py` counts them.
"""

import argparse
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from fringecal.errors import FringecalError
from fringecal.reconstruct import HeightMap
from fringecal.session import capture_of_arrays, session_of_captures
from fringecal.workflows.reconstruct import reconstruct
from fringecal.workflows.shared import Treatment
from object_orders import case_of
from object_population import Case, facts, fringe_height_mm

FILTERS = ("none", "median", "mean", "median+mean")
MODELS = ("constant-angle", "column-angle", "pixelwise", "pixelwise-three-term", "cubic")
TREATMENTS = [("projective", *pair) for pair in product(FILTERS, FILTERS)] + [
    *((model, "none", "none") for model in MODELS),
    ("constant-angle", "median", "mean"),
]
K = 1.96


def surface_of(case: Case, model: str, before: str, after: str) -> HeightMap:
    """Measure a case."""
    capture = capture_of_arrays("object", "object", case.frames.frames, phase_shifts_deg=case.spec.steps.nominal_deg)
    session = session_of_captures([capture])
    return reconstruct(session, "object", case.calibration, model=model, treatment=Treatment(before, after)).surface


def rates(case: Case) -> list[dict[str, object]]:
    """Coverage for every treatment of one case."""
    rows, plain = [], np.nan
    for treatment in TREATMENTS:
        found = surface_of(case, *treatment)
        median = float(np.nanmedian(found.u_z))
        plain = median if treatment == TREATMENTS[0] else plain
        error = np.abs(found.z - case.frames.z)
        right = found.mask & case.frames.lit & (error < fringe_height_mm(case.calibration) / 2)
        rows.append(
            facts(case)
            | dict(zip(("model", "before", "after"), treatment, strict=True))
            | {"pixels": int(right.sum()), "within": int((error[right] <= K * found.u_z[right]).sum())}
            | {"u_ratio": median / plain}
        )
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=None)
    options = parser.parse_args()
    table = []
    for number in range(options.cases):
        try:
            table += rates(case_of(number, options.seed, options.cache))
        except FringecalError as error:
            print(f"case {number}: {error}")
    cases = pd.DataFrame(table)
    cases["coverage"] = cases["within"] / cases["pixels"]
    groups = cases.groupby(["model", "before", "after"], sort=False)
    result = groups[["pixels", "within"]].sum()
    result["coverage / %"] = 100 * result["within"] / result["pixels"]
    result["least of a case / %"] = 100 * groups["coverage"].min()
    result["u over untreated"] = groups["u_ratio"].median()
    print(result.round(2).to_string())
