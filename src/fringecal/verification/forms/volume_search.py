"""Where balls and planes lie in a measured picture of points, in whatever pose: no plate is asked for.

Small planes are fitted to blocks of the picture. From a block on a ball of known size its centre lies one radius behind
along the block's normal, and the centres of all blocks heap up in one place; those of a plane lie scattered over one.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from fringecal.errors import FitError
from fringecal.verification.forms.block_planes import Facets, fit_facets
from fringecal.verification.forms.fitted_forms import fit_plane, fit_sphere
from fringecal.verification.forms.pieces import MIN_PIXELS, RIM_PX
from fringecal.verification.forms.probes import CAP_DEG
from fringecal.verification.zigzag.zigzag_shape import Floats

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SearchRules:
    """How forms are looked for.

    Parameters
    ----------
    pixels
        Of the picture that blocks are made of: larger ones are thinned.
    block_px
        Side of a block, of the thinned picture: its normal is known to some degrees, and a ball of thirty px has ten.
    heap
        Within what share of a ball's diameter the centres by its blocks lie.
    least_blocks
        Blocks that a ball must have.
    alike_deg
        Within what angle the normals of one plane's blocks lie.
    off_share
        Of a ball's diameter: what departs more from its surface is none of its points.
    rounds
        Of choosing points about what they were fitted to: the set settles after three.
    level_share
        Of the distance of two levels of a block of steps, within which a point belongs to one of them.
    trimmed
        Robust standard deviations from a plane beyond which a point is beside it.
    """

    pixels: int = 400_000
    block_px: int = 5
    heap: float = 0.06
    least_blocks: int = 8
    alike_deg: float = 6.0
    off_share: float = 0.03
    rounds: int = 5
    level_share: float = 0.4
    trimmed: float = 8.0


SEARCH_RULES = SearchRules()


@dataclass(frozen=True)
class PointPicture:
    """A picture of points: (H, W, 3) mm, z toward the camera; where they are valid, and their blocks.

    `away` is the direction, (3,), about which the cap of a ball is judged: between camera and projector.
    """

    points: Floats
    valid: Mask
    away: Floats
    facets: Facets

    @classmethod
    def of(cls, points: Floats, valid: Mask, away: Floats, *, rules: SearchRules = SEARCH_RULES) -> "PointPicture":
        """Fit planes to the blocks of a picture of points.

        Raises
        ------
        FitError
            Hardly any pixel is valid.
        """
        if np.count_nonzero(valid) < MIN_PIXELS:
            raise FitError(
                f"only {np.count_nonzero(valid)} valid pixels, at least {MIN_PIXELS} are needed; look at the mask's "
                "reasons first"
            )
        step = max(1, int(math.sqrt(valid.size / rules.pixels)))
        few = points[::step, ::step]
        x, y, z = few[..., 0], few[..., 1], few[..., 2]
        facets = fit_facets(x, y, z, valid[::step, ::step], block_px=rules.block_px)
        return cls(points, valid, away / np.linalg.norm(away), facets)

    @property
    def middles(self) -> Floats:
        """Points of the blocks, (n, 3)."""
        return np.column_stack([self.facets.x, self.facets.y, self.facets.z])

    @property
    def normals(self) -> Floats:
        """Normals of the blocks, (n, 3), toward the camera."""
        found = np.column_stack([-self.facets.p, -self.facets.q, np.ones_like(self.facets.p)])
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def find_balls(
    seen: PointPicture, diameters_mm: tuple[float, ...], *, rules: SearchRules = SEARCH_RULES
) -> tuple[NDArray[np.intp], ...]:
    """Return the flat pixel indices of each ball's cap; balls of one size from left to right in the picture.

    Raises
    ------
    FitError
        A ball is not to be seen.
    """
    middles, normals = seen.middles, seen.normals
    free, found = np.ones(len(middles), bool), []
    for diameter in diameters_mm:
        centre = _heap(middles[free], normals[free], diameter, rules)
        cap = _cap(seen, centre, diameter, rules)
        centre = fit_sphere(seen.points.reshape(-1, 3)[cap], radius_mm=diameter / 2).centre_mm
        free &= np.linalg.norm(middles - centre, axis=1) > (0.5 + rules.heap) * diameter
        found.append(cap)
    if len(set(diameters_mm)) < len(diameters_mm):
        found.sort(key=lambda cap: float(np.mean(cap % seen.valid.shape[1])))
    return tuple(found)


def _heap(middles: Floats, normals: Floats, diameter: float, rules: SearchRules) -> Floats:
    """Return where the centres by the blocks of a ball heap up."""
    known = np.isfinite(middles).all(axis=1) & np.isfinite(normals).all(axis=1)
    centres = (middles - diameter / 2 * normals)[known]
    if len(centres) >= rules.least_blocks:
        tree = cKDTree(centres)
        count = np.asarray(tree.query_ball_point(centres, rules.heap * diameter, return_length=True))
        if count.max() >= rules.least_blocks:
            near = np.linalg.norm(centres - centres[int(count.argmax())], axis=1) < rules.heap * diameter
            return np.asarray(np.median(centres[near], axis=0))
    raise FitError(
        f"no ball of {diameter:g} mm is to be seen; check the target's diameter, and that the ball is matt, lit, "
        "and not saturated"
    )


def _cap(seen: PointPicture, centre: Floats, diameter: float, rules: SearchRules) -> NDArray[np.intp]:
    """Return the pixels of one ball within its cap."""
    near = np.flatnonzero(seen.valid & (np.abs(seen.points - centre).max(axis=-1) < diameter))
    cloud, lowest = seen.points.reshape(-1, 3)[near], math.cos(math.radians(CAP_DEG))
    for _ in range(rules.rounds):
        out = cloud - centre
        distance = np.linalg.norm(out, axis=1)
        kept = (np.abs(distance - diameter / 2) < rules.off_share * diameter) & (out @ seen.away > lowest * distance)
        if np.count_nonzero(kept) < MIN_PIXELS:
            raise FitError(
                f"no ball of {diameter:g} mm: only {np.count_nonzero(kept)} pixels lie on such a sphere; check the "
                "target's diameter, and that the ball is matt and lit"
            )
        centre = fit_sphere(cloud[kept], radius_mm=diameter / 2).centre_mm
    return near[kept]


def find_plane(seen: PointPicture, *, rules: SearchRules = SEARCH_RULES) -> NDArray[np.intp]:
    """Return the flat pixel indices of the largest plane, its rim left out.

    Raises
    ------
    FitError
        There is none.
    """
    alike = _most_alike(seen.normals, rules)
    middles = seen.middles[alike]
    if len(middles) < rules.least_blocks:
        raise FitError("no plane is to be seen; check that the flat is lit, matt, and in the calibrated volume")
    for _ in range(rules.rounds):
        plane = fit_plane(middles)
        off = np.abs((seen.middles - plane.point_mm) @ plane.normal)[alike]
        spread = float(np.median(off)) / 0.6745
        kept = off < max(rules.trimmed / 2 * spread, 1e-6)
        if kept.sum() < rules.least_blocks:
            break
        middles = seen.middles[alike][kept]
    plane = fit_plane(middles)
    off = np.abs((seen.points - plane.point_mm) @ plane.normal)
    usual = float(np.median(off[seen.valid & (off < _usual_reach(seen, off))])) / 0.6745
    return np.flatnonzero(_largest(seen.valid & (off < rules.trimmed * usual)))


def _usual_reach(seen: PointPicture, off: Floats) -> float:
    """Return how far from a plane its own points may lie: some times what the nearest half of all points do."""
    return 10 * float(np.median(off[seen.valid])) + 1e-9


def _most_alike(normals: Floats, rules: SearchRules) -> Mask:
    """Return the blocks whose normals lie about the direction that most have."""
    limit = math.cos(math.radians(rules.alike_deg))
    tried = normals[:: max(1, len(normals) // 400)]
    tried = tried[np.isfinite(tried).all(axis=1)]
    if not len(tried):
        return np.zeros(len(normals), bool)
    best = tried[int(((tried @ tried.T) > limit).sum(axis=1).argmax())]
    for _ in range(rules.rounds):
        alike = normals @ best > limit
        best = normals[alike].mean(axis=0) if alike.any() else best
        best = best / np.linalg.norm(best)
    return np.asarray(normals @ best > limit)


def find_levels(
    seen: PointPicture, heights_mm: Floats, *, rules: SearchRules = SEARCH_RULES
) -> tuple[NDArray[np.intp] | None, dict[int, NDArray[np.intp]]]:
    """Return the pixels of what a block of steps stands on, None where it is not seen, and of each step that is.

    Parameters
    ----------
    seen
        The picture of points.
    heights_mm
        Heights of the steps over what they stand on, (n,).

    Raises
    ------
    FitError
        Fewer than two levels are found.
    """
    alike = _most_alike(seen.normals, rules)
    if alike.sum() < rules.least_blocks:
        raise FitError("no steps are to be seen: no blocks of the picture that are parallel planes")
    normal = seen.normals[alike].mean(axis=0)
    normal /= np.linalg.norm(normal)
    for _ in range(rules.rounds):  # the levels' own planes tell the direction far better than the blocks' normals
        normal = _common_normal(seen.middles[alike], normal, heights_mm, rules)
    levels = np.append(0.0, heights_mm)
    half = rules.level_share * float(np.diff(np.unique(levels)).min())
    base = _offset(seen.middles[alike] @ normal, levels, half)
    along = seen.points @ normal - base
    pieces = {k: _largest(seen.valid & (np.abs(along - level) < half)) for k, level in enumerate(levels)}
    tops = {k - 1: np.flatnonzero(m) for k, m in pieces.items() if k > 0 and m.sum() >= MIN_PIXELS}
    if len(tops) + (pieces[0].sum() >= MIN_PIXELS) < 2:
        raise FitError(
            f"of {len(heights_mm)} steps {len(tops)} were found at their heights, and nothing that they stand on; "
            "check the target's heights_mm, and that the block is lit"
        )
    return _around(seen, pieces[0], list(tops.values())), tops


def _common_normal(middles: Floats, normal: Floats, heights: Floats, rules: SearchRules) -> Floats:
    """Return the normal of parallel planes at the levels of a block of steps."""
    levels = np.append(0.0, heights)
    half = rules.level_share * float(np.diff(np.unique(levels)).min())
    along = middles @ normal
    off = along - _offset(along, levels, half)
    level = np.abs(off[:, None] - levels).argmin(axis=1)
    near = np.abs(off - levels[level]) < half
    centred = np.vstack(
        [middles[near & (level == k)] - middles[near & (level == k)].mean(axis=0) for k in np.unique(level[near])]
    )
    found = fit_plane(centred).normal if len(centred) > rules.least_blocks else normal
    return np.asarray(found if found @ normal > 0 else -found)


def _offset(along: Floats, levels: Floats, half: float) -> float:
    """Return the height of what a block stands on at which most of its levels, then most blocks, are found."""
    tried = np.concatenate([along - level for level in levels])
    tried = np.unique(np.round(tried / (half / 4))) * (half / 4)
    ordered = np.sort(along)
    count = np.stack(
        [
            np.searchsorted(ordered, tried + level + half / 2) - np.searchsorted(ordered, tried + level - half / 2)
            for level in levels
        ]
    )
    score = 1e6 * (count[1:] > 2).sum(axis=0) + 1e6 * 0.5 * (count[0] > 2) + count.sum(axis=0)
    best = float(tried[int(score.argmax())])
    near = [along[np.abs(along - best - level) < half] - level for level in levels]
    return float(np.median(np.concatenate(near)))


def _largest(mask: Mask) -> Mask:
    """Return the largest connected piece of a mask without its rim."""
    opened = ndimage.binary_opening(mask, np.ones((3, 3), bool))
    labels, number = ndimage.label(opened)
    if not number:
        return np.zeros_like(mask)
    largest = labels == 1 + int(np.bincount(labels.ravel())[1:].argmax())
    # Single pixels that are masked inside are no rim.
    filled = ndimage.binary_closing(largest, np.ones((5, 5), bool)) | largest
    return ndimage.binary_erosion(filled, np.ones((2 * RIM_PX + 1,) * 2, bool), border_value=1) & mask


def _around(seen: PointPicture, base: Mask, tops: list[NDArray[np.intp]]) -> NDArray[np.intp] | None:
    """Return what is near a block of what it stands on: the heights are those over its next surroundings."""
    if base.sum() < MIN_PIXELS or not tops:
        return None if base.sum() < MIN_PIXELS else np.flatnonzero(base)
    block = seen.points.reshape(-1, 3)[np.concatenate(tops)]
    middle, reach = block.mean(axis=0), float(np.linalg.norm(np.ptp(block, axis=0)))
    near = np.flatnonzero(base & (np.linalg.norm(seen.points - middle, axis=-1) < reach))
    return near if near.size >= MIN_PIXELS else np.flatnonzero(base)
