"""Colour pictures: the channel that shows the ruling is taken, or the one that is stated."""

import cv2
import numpy as np
import pytest
import typer

from fringecal.cli.shared.pictures import demand_channel, read_channels
from fringecal.detect import find_grid

# Red, green, blue of inks on white paper; each leaves one channel or two as bright as the paper.
INKS = {
    "red": (250, 90, 90),
    "orange": (250, 165, 60),
    "green": (80, 220, 90),
    "blue": (70, 110, 250),
    "pale red": (250, 225, 225),
    "black": (60, 60, 60),
}
BLIND = {"red": "red", "orange": "red", "green": "green", "blue": "blue", "pale red": "red"}


@pytest.fixture
def sheet(tmp_path):
    def write(ink: str):
        v, u = np.mgrid[:200, :260]
        off = np.minimum(np.abs((u - 10) % 20 - 6.3), np.abs((v - 7) % 20 - 8.6))
        there = np.clip(1.4 - off, 0, 1)[..., None]
        picture = 250 * (1 - there) + np.array(INKS[ink]) * there
        noisy = picture + np.random.default_rng(2).normal(0, 2.5, picture.shape)
        path = tmp_path / "sheet.png"
        cv2.imwrite(str(path), np.clip(noisy, 0, 255).astype(np.uint8)[..., ::-1])
        return path

    return write


@pytest.mark.parametrize("ink", INKS)
def test_the_channel_is_taken_that_shows_the_ruling(ink, sheet):
    """13 and 10 lines, 20 px apart."""
    taken, (picture,) = read_channels([sheet(ink)], None)[0]
    assert taken != BLIND.get(ink)
    assert taken == "luma" or ink != "black"
    grid = find_grid(picture)
    assert (len(grid.family("vertical")), len(grid.family("horizontal"))) in {(12, 9), (13, 10)}  # the last at the rim


def test_the_stated_channel_is_taken(sheet):
    assert [name for name, _ in read_channels([sheet("red")], "red")] == ["red"]


def test_grey_pictures_have_no_channel(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.arange(6000, dtype=np.uint8).reshape(60, 100))
    assert [name for name, _ in read_channels([tmp_path / "grey.png"], None)] == [None]


def test_no_channel_of_another_name():
    with pytest.raises(typer.BadParameter, match="none of mean, red"):
        demand_channel("cyan")
