"""How often the doctor names an injected fault, and how often it names one on a clean set.

Run: python benchmarks/phase_doctor.py [--sets N]. Every fault of `tests/phase/test_doctor.py` on N random
virtual sets, and N clean ones.
"""

import argparse
import collections
import importlib.util
from pathlib import Path

from fringecal.phase import diagnose


def bench_module():
    path = Path(__file__).parents[1] / "tests" / "phase" / "test_doctor.py"
    spec = importlib.util.spec_from_file_location("doctor_faults", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(sets: int) -> None:
    injected = bench_module()
    false = collections.Counter()
    for seed in range(sets):
        bench = injected.Bench(5000 + seed)
        false.update(diagnose(bench.shoot(), bench.steps).names())
    print(f"false names on {sets} clean sets: {dict(false) or 'none'}")
    named, total = collections.Counter(), collections.Counter()
    for seed in range(sets):
        bench = injected.Bench(9000 + seed)
        for name, frames, plate in injected.faults(bench):
            total[name] += 1
            named[name] += name in diagnose(frames, bench.steps, reference=plate).names()
    for name, count in total.items():
        print(f"{name:28s} named in {named[name]:4d} of {count} = {named[name] / count:.1%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=100)
    main(parser.parse_args().sets)
