"""The documentation as a site: builds with every warning an error, and holds every page."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytest.importorskip("mkdocs", reason="the dependency group docs is not installed; make docs does")
pytest.importorskip("mkdocstrings", reason="the dependency group docs is not installed; make docs does")


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    site = tmp_path / "site"
    for command in (
        [sys.executable, "docs/stage.py"],
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)],
    ):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
    for page in [*(ROOT / "docs").rglob("*.md"), *(ROOT / "procedures").glob("*.md")]:
        name = "index.html" if page.name == "README.md" else f"{page.stem}.html"
        assert (site / page.relative_to(ROOT).with_name(name)).is_file()
