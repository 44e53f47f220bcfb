"""Whether u(z) holds for filters and height models: coverage of 95 % intervals of single pixels, over random objects.

Run: python benchmarks/treated_heights.py [--from 0] [--cases 20] [--seed 0] [--tally FILE] [--seconds 300]. Rigs and
objects are those of `object_population.py`, with exact calibrations, so that intervals hold noise, filters and models
alone. Printed for every treatment: pixels, the share within `1.96 u(z)` of the truth, that of the worst case, the same
for means over squares of AREA_PX, and the median of u(z) over that of the untreated heights. Pixels in a wrong fringe
order are left out: `object_orders.py` counts them. With a tally each case is noted in that file (CSV) as soon as it is
done; the next call goes on where the last stopped, after so many seconds, and all that was ever run is printed.
"""

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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
AREA_PX = 24  # side of a square whose mean is judged; filters reach some pixels
MOST_AREAS = 12  # of a case and treatment: mean's uncertainty takes as long as a reconstruction of a part
WHOLE = 0.9  # of a square that must have heights


def surface_of(case: Case, model: str, before: str, after: str) -> HeightMap:
    """Measure a case."""
    capture = capture_of_arrays("object", "object", case.frames.frames, phase_shifts_deg=case.spec.steps.nominal_deg)
    session = session_of_captures([capture])
    return reconstruct(session, "object", case.calibration, model=model, treatment=Treatment(before, after)).surface


def areas(found: HeightMap, truth: NDArray[np.floating], right: NDArray[np.bool_]) -> tuple[int, int]:
    """Count squares with heights, spread over the picture, and those whose mean lies within its interval."""
    rows, columns = (side // AREA_PX for side in right.shape)
    share = right[: rows * AREA_PX, : columns * AREA_PX].reshape(rows, AREA_PX, columns, AREA_PX).mean(axis=(1, 3))
    places = np.argwhere(share >= WHOLE)
    places = places[:: max(1, -(-len(places) // MOST_AREAS))]
    within = 0
    for row, column in places * AREA_PX:
        weights = np.zeros(right.shape)
        square = np.s_[row : row + AREA_PX, column : column + AREA_PX]
        weights[square] = right[square]
        weights /= weights.sum()
        off = float(np.nansum(np.where(right, found.z - truth, 0.0) * weights))
        within += abs(off) <= K * found.mean_uncertainty(weights)
    return len(places), within


def rates(case: Case) -> list[dict[str, object]]:
    """Coverage for every treatment of one case."""
    rows, plain = [], np.nan
    for treatment in TREATMENTS:
        found = surface_of(case, *treatment)
        median = float(np.nanmedian(found.u_z))
        plain = median if treatment == TREATMENTS[0] else plain
        error = np.abs(found.z - case.frames.z)
        right = found.mask & case.frames.lit & (error < fringe_height_mm(case.calibration) / 2)
        squares, squares_within = areas(found, case.frames.z, right)
        rows.append(
            facts(case)
            | dict(zip(("model", "before", "after"), treatment, strict=True))
            | {"pixels": int(right.sum()), "within": int((error[right] <= K * found.u_z[right]).sum())}
            | {"areas": squares, "areas_within": squares_within, "u_ratio": median / plain}
        )
    return rows


def cases(options: argparse.Namespace) -> pd.DataFrame:
    """Run the cases that the tally lacks, for so long, and return the rows of all."""
    began, known = time.monotonic(), options.tally is not None and options.tally.exists()
    tables = [pd.read_csv(options.tally)] if known else []
    done = set(tables[0]["number"]) if known else set()
    for number in range(options.first, options.first + options.cases):
        if number in done or time.monotonic() - began > options.seconds:
            continue
        try:
            table = pd.DataFrame(rates(case_of(number, options.seed, options.cache))).assign(number=number)
        except FringecalError as error:
            print(f"case {number}: {error}")
            continue
        if options.tally is not None:
            table.to_csv(options.tally, mode="a", header=not (tables or done), index=False)
        tables.append(table)
    return pd.concat(tables)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument("--tally", type=Path, default=None)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    rows = cases(parser.parse_args())
    rows["coverage"] = rows["within"] / rows["pixels"]
    groups = rows.groupby(["model", "before", "after"], sort=False)
    result = groups[["pixels", "within", "areas", "areas_within"]].sum()
    result["coverage / %"] = 100 * result["within"] / result["pixels"]
    result["areas / %"] = 100 * result["areas_within"] / result["areas"]
    result["least of a case / %"] = 100 * groups["coverage"].min()
    result["u over untreated"] = groups["u_ratio"].median()
    print(f"{rows['number'].nunique()} cases")
    print(result.round(2).to_string())
