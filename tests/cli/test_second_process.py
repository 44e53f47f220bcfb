"""What a command has done beside itself: in order, whole at the end, and its faults told."""

import json
import os
from pathlib import Path

import pytest

from fringecal.cli.shared.second_process import second_process
from fringecal.reconstruct.height_kernels import surface_rows
from fringecal.workflows.demo import compile_ahead


@pytest.fixture(params=[1, 2])
def processors(monkeypatch, request):
    monkeypatch.setattr(os, "cpu_count", lambda: request.param)


@pytest.mark.usefixtures("processors")
def test_all_is_done_at_the_end_and_in_order(tmp_path):
    with second_process() as beside:
        beside(os.mkdir, tmp_path / "folder")
        beside(Path.write_text, tmp_path / "folder" / "file", "second")
    assert (tmp_path / "folder" / "file").read_text() == "second"


@pytest.mark.usefixtures("processors")
def test_a_fault_is_raised_here(tmp_path):
    with pytest.raises(json.JSONDecodeError), second_process() as beside:
        beside(json.loads, "{")


def test_what_surfaces_are_compiled_of_is_there_before_it_is_needed():
    compile_ahead()
    written = [str(signature[-1]) for signature in surface_rows.signatures]
    assert any("float64" in one for one in written)
    assert any("float32" in one for one in written)
