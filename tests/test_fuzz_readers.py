"""A hundred or so cases of the campaign in `benchmarks`: damaged files of every format, and senseless command lines."""

import importlib.util
import sys
from pathlib import Path

import pytest

CAMPAIGN = Path(__file__).parents[1] / "benchmarks" / "fuzz_readers.py"
CASES = range(70_000, 70_120)


@pytest.fixture(scope="module")
def campaign():
    spec = importlib.util.spec_from_file_location("fuzz_readers", CAMPAIGN)
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz_readers"] = module
    spec.loader.exec_module(module)
    return module


def test_no_case_ends_in_anything_but_a_sentence(campaign):
    outcomes = campaign.run_block(CASES)
    assert {seed: outcome.wrong for seed, outcome in outcomes if outcome.wrong} == {}
    # The damage is such that most are refused; none being refused would mean that nothing was damaged.
    assert sum(outcome.refused for _, outcome in outcomes) > len(CASES) / 2
