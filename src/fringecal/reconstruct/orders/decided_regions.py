"""An object's step over the plate with the orders that evidence gives, region by region.

Regions are smooth; what decides one's order is the plate's own phase in it, how it follows other regions along
epipolar lines (`fringecal.reconstruct.orders.region_orders`), and a border along which it meets one that is decided.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase import Regions
from fringecal.reconstruct.orders.contacts import CONTACT_SHARE, orders_by_contact
from fringecal.reconstruct.orders.epipolar_lines import EpipolarLines
from fringecal.reconstruct.orders.faint_edges import faint_edges
from fringecal.reconstruct.orders.line_evidence import (
    END_U,
    END_V,
    ENTRY,
    FIRST,
    FREE,
    FROM_SAME,
    START_U,
    START_V,
    WAY_IN,
    breadths,
    mark_run_ends,
    mark_runs,
    passages,
)
from fringecal.reconstruct.orders.outlined_parts import outlined_parts
from fringecal.reconstruct.orders.piece_orders import plate_votes
from fringecal.reconstruct.orders.plate_closeness import PlateCloseness
from fringecal.reconstruct.orders.region_orders import (
    EVIDENCE_RULES,
    Bounds,
    OrderBook,
    Passages,
    bounds_of,
    closes_evenly,
    same_pair,
    stretches,
)
from fringecal.reconstruct.orders.sinking import DEEPEST_RAD, Depths

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Labels = NDArray[np.int32]

PlateAt = Callable[[Array, Array], Array]
"""Plate phase, rad, at picture coordinates u and v, px."""


@dataclass(frozen=True)
class DecisionRules:
    """When regions are taken for plate, and when one is split.

    Parameters
    ----------
    plate_pixels
        Least number of pixels on the plate's phase.
    main_share
        Least share of its pixels that the region which starts all must have on it: a slope that only crosses the
        plate's phase somewhere has some as well.
    plate_share
        Share of a region's pixels that must lie on it for the region to be plate.
    grown_share
        The same among all of its pixels, also beside edges, for it to look like plate.
    wide_scatters, wide_rad
        How far from the plate's phase three quarters of a region's smooth pixels may lie for it to be plate: so many
        times what the region that starts all scatters about it, and rad more, for what the plate may be off beyond
        that. A top that is whole fringes high by chance is rarely so close.
    smooth_share
        Least share of the pixels of a grown region that must be smooth for evidence to decide it, but for the one that
        starts all: what grows over more is no surface of its own.
    edge_lines
        Neighbouring lines that must show an inner edge: a line along a fold may see one by noise.
    surface_share
        Share of a region's lines over a shadow that must say another order than most: then it is two surfaces.
    part_share
        Share of the lines through a part of a split region that a shadow must decide, if its pixels meet the rest
        with another order.
    faint_sigmas
        Break between two windows beside each other, in its standard uncertainties, at which a region that contradicts
        itself is cut first.
    rounds
        How often regions that contradict themselves are cut: at faint edges first, then along lines.
    closing_px
        Side of the square over which runs of contradiction are closed: lines run between pixels.
    bridged_px
        The same for runs that begin at an edge: lines between them on which the edge is not seen belong to them.
    edge_sigmas, edge_limits_rad
        Jump within a region that is an edge: so many u(phi), between two limits, rad.
    dark_sigmas
        Mean modulation that pure noise shows, in its standard deviations: 1.25, and what blur leaks into a shadow.
    sample_px
        Every so many pixels say how bright the fringes are.
    rim_px
        Distance from the picture's border within which a part of a split region may be plate by its phase alone.
    """

    plate_pixels: int = 50
    main_share: float = 0.02
    plate_share: float = 0.8
    grown_share: float = 0.6
    wide_scatters: float = 8.0
    wide_rad: float = 0.05
    smooth_share: float = 0.4
    surface_share: float = 0.3
    part_share: float = 0.7
    faint_sigmas: float = 6.0
    rounds: int = 3
    edge_lines: int = 12
    closing_px: int = 3
    bridged_px: int = 15
    edge_sigmas: float = 10.0
    edge_limits_rad: tuple[float, float] = (0.08, 0.5)
    dark_sigmas: float = 2.0
    sample_px: int = 9
    rim_px: int = 12


DECISION_RULES = DecisionRules()


@dataclass(frozen=True)
class NoiseLevels:
    """Typical u(phi), rad, and what it may show: a jump within a region, rad; modulation without light, grey levels."""

    sigma_rad: float
    edge_rad: float
    dark_level: float

    @classmethod
    def of(cls, sigma_rad: float, light: NDArray[np.float32], regions: Regions, rules: DecisionRules) -> "NoiseLevels":
        """Take both from u(phi), which is the noise of the modulation over the modulation."""
        sample = np.s_[:: rules.sample_px, :: rules.sample_px]
        lit = light[sample][regions.cores[sample] > 0]
        level = float(np.median(lit)) if lit.size else 0.0
        edge = float(np.clip(rules.edge_sigmas * sigma_rad, *rules.edge_limits_rad))
        return cls(sigma_rad, edge, rules.dark_sigmas * sigma_rad * level)


@dataclass(frozen=True)
class PlateVotes:
    """How many flat pixels of each region lie on the plate's phase, at which whole fringe, and the regions' sizes."""

    levels: Ints
    counts: Ints
    sizes: Ints

    @classmethod
    def of(cls, regions: Regions, rules: DecisionRules, *, grown: bool = False) -> "PlateVotes":
        """Count them among the smooth pixels of the regions, or among all of the grown ones."""
        numbers = regions.labels if grown else regions.cores
        return cls(*plate_votes(regions.values, numbers, regions.number, TURN, rules.plate_pixels))

    @property
    def main(self) -> int:
        """Number of the region that shows most of the plate."""
        return int(np.argmax(self.counts))


@dataclass(frozen=True)
class Evidence:
    """Regions without inner contradictions, the bounds between them, and up to which number regions were never split.

    A part of a region that was split looks smooth towards the rest of it and like plate where the rest does; neither
    says anything, and only bounds decide it. Up to number `smooth` no outline sets a region apart from another either:
    what one encloses may meet its neighbours, but does not count as plate by its phase.
    """

    regions: Regions
    bounds: Bounds
    whole: int
    plate: PlateVotes
    closeness: PlateCloseness
    smooth: int
    rough: NDArray[np.bool_]

    @classmethod
    def of(cls, regions: Regions, bounds: Bounds, whole: int, plate: PlateVotes) -> "Evidence":
        """Add how closely the regions lie on the plate's phase."""
        closeness = PlateCloseness.of(regions, plate.main)
        return cls(regions, bounds, whole, plate, closeness, whole, np.zeros(regions.number + 1, np.bool_))


@dataclass(frozen=True)
class DecidedRegions:
    """Smooth regions with what is known of their orders.

    Parameters
    ----------
    regions
        The regions, after those that contradict themselves were split.
    orders
        Fringes to be added to each region, by number, NaN where open.
    low, high
        Orders that the bounds leave for each region, counted positive as phase grows with height.
    rising
        Sign of the phase that a raised point gains.
    """

    regions: Regions
    orders: Array
    low: Ints
    high: Ints
    rising: int

    def leaves(self, region: int, order: int) -> bool:
        """Whether the bounds leave an order for a region."""
        return bool(self.low[region] <= self.rising * order <= self.high[region])


def decide_regions(
    regions: Regions,
    light: NDArray[np.float32],
    background: NDArray[np.floating],
    lines: EpipolarLines,
    plate_at: PlateAt,
    sigma_rad: float,
    *,
    deepest_rad: float = DEEPEST_RAD,
    rules: DecisionRules = DECISION_RULES,
) -> DecidedRegions:
    """Decide the order of every region against the plate's.

    The plate's phase in the largest region that shows it is the start. From there bounds are carried through; then
    whole regions that look like plate, and borders along which both sides meet, choose among the orders left.

    Parameters
    ----------
    regions
        Smooth regions of the step over the plate.
    light
        Modulation of the fringes, grey levels, (H, W).
    background
        Mean of the frames, grey levels, (H, W).
    lines
        Epipolar lines of the rig.
    plate_at
        The plate's phase.
    sigma_rad
        Typical u(phi), rad.
    deepest_rad
        Step over the plate of the lowest that an object can be, rad: what evidence would put lower stays open.
    rules
        When a region is plate.
    """
    noise = NoiseLevels.of(sigma_rad, light, regions, rules)
    parts = outlined_parts(regions, background, sigma_rad)
    evidence = gathered(parts, light, lines, plate_at, noise, rules)
    rough = _rough(evidence, rules)
    evidence = replace(evidence, smooth=regions.number, bounds=evidence.bounds.without(rough), rough=rough)
    borders = evidence.regions.borders(light)
    depths = Depths.of(evidence.regions, lines.rising, deepest_rad)
    book = OrderBook(evidence.regions.number, evidence.bounds)
    _start_at_plate(book, evidence, borders, depths, lines.rising, rules)
    doubtful = _plate_or_not(book, evidence, lines.rising, rules)
    if doubtful.any():
        book = OrderBook(evidence.regions.number, evidence.bounds.without(doubtful))
        _start_at_plate(book, evidence, borders, depths, lines.rising, rules, doubtful)
    orders = lines.rising * _without_sunk(book.orders(), depths)
    orders[_ill_supported_parts(orders, evidence, borders, lines, rules)] = np.nan
    orders[_torn_apart(orders, evidence, borders, rules)] = np.nan
    orders[0] = np.nan
    return DecidedRegions(evidence.regions, orders, book.low, book.high, lines.rising)


def _without_sunk(orders: Array, depths: Depths) -> Array:
    """Open what would lie below the lowest that an object can be."""
    sunk = [r for r in (np.flatnonzero(np.isfinite(orders[1:])) + 1).tolist() if depths.impossible({r: int(orders[r])})]
    orders[sunk] = np.nan
    return orders


def _rough(evidence: Evidence, rules: DecisionRules) -> NDArray[np.bool_]:
    """Regions that are smooth over too little of what they grew over, but for the one that starts all."""
    regions, number = evidence.regions, evidence.regions.number + 1
    smooth, grown = (np.bincount(m.ravel(), minlength=number) for m in (regions.cores, regions.labels))
    rough = smooth < rules.smooth_share * grown
    rough[evidence.plate.main] = False
    return np.asarray(rough)


def _torn_apart(orders: Array, evidence: Evidence, borders: Ints, rules: DecisionRules) -> NDArray[np.bool_]:
    """Regions that meet pixel by pixel along a border as long as would decide one, with orders that say an edge there.

    One of both is wrong, or the border is an edge of whole fringes; only where one is the plate's does it say which.
    """
    sizes = np.bincount(evidence.regions.labels.ravel(), minlength=orders.size)
    one, two, lacking, pairs = borders.T
    torn = np.isfinite(orders)[one] & np.isfinite(orders)[two] & (orders[two] - orders[one] != lacking)
    sure = evidence.closeness.within(rules.wide_scatters, rules.wide_rad) & (orders == -evidence.plate.levels)
    torn &= ~sure[one] & ~sure[two]
    found = np.zeros(orders.size, np.bool_)
    for side in (one[torn], two[torn]):
        found[side[pairs[torn] >= CONTACT_SHARE * np.sqrt(sizes[side])]] = True
    return found


def _ill_supported_parts(
    orders: Array, evidence: Evidence, borders: Ints, lines: EpipolarLines, rules: DecisionRules
) -> NDArray[np.bool_]:
    """Parts of split regions that few lines over shadows put elsewhere than where many pixels meet the rest."""
    b, known = evidence.bounds, np.isfinite(orders)
    one, two, lacking, pairs = borders.T
    against = known[one] & known[two] & (orders[two] - orders[one] != lacking) & (two > evidence.whole)
    bad = np.zeros(orders.size, np.bool_)
    if against.any():
        holds = b.equal & (b.first != b.second) & known[b.first] & known[b.second]
        holds[holds] = lines.rising * (orders[b.second] - orders[b.first])[holds] == b.fringes[holds]
        support = np.zeros(orders.size)
        for ends in (b.first, b.second):
            support += np.bincount(ends[holds], b.lines[holds], orders.size)
        few = (support > 0) & (support < rules.part_share * breadths(evidence.regions.cores, lines))
        bad[two[against & few[two] & (pairs > support[two])]] = True
    return bad


def _plate_or_not(book: OrderBook, evidence: Evidence, rising: int, rules: DecisionRules) -> NDArray[np.bool_]:
    """Regions that look like plate and that bounds put elsewhere: paint as wide as a fringe, or tops as high as one."""
    orders, found = book.orders(), np.zeros(evidence.regions.number + 1, np.bool_)
    grown = PlateVotes.of(evidence.regions, rules, grown=True)
    for plate, share in ((evidence.plate, rules.plate_share), (grown, rules.grown_share)):
        alike = plate.counts >= np.maximum(rules.plate_pixels, share * plate.sizes)
        found |= alike & np.isfinite(orders) & (orders != -rising * plate.levels)
    return found


def _start_at_plate(
    book: OrderBook,
    evidence: Evidence,
    borders: Ints,
    depths: Depths,
    rising: int,
    rules: DecisionRules,
    without: NDArray[np.bool_] | None = None,
) -> None:
    """Give the plate its order, carry all bounds through from it, and choose among what they leave."""
    regions = evidence.regions
    if not _chosen_main(book, evidence.plate, rising, rules):
        return
    book.carry()
    levels, counts, sizes = evidence.plate.levels, evidence.plate.counts, evidence.plate.sizes
    numbers, free = np.arange(regions.number + 1), _at_rim(regions, rules)
    allowed = np.ones(numbers.size, np.bool_) if without is None else ~without
    whole, alone = ((numbers <= n) | free for n in (evidence.whole, evidence.smooth))
    plate = (counts >= np.maximum(rules.plate_pixels, rules.plate_share * sizes)) & alone & allowed
    plate &= evidence.closeness.within(rules.wide_scatters, rules.wide_rad) & ~evidence.rough
    for region in np.argsort(-counts, kind="stable").tolist():
        if plate[region]:
            book.choose(region, -rising * int(levels[region]))
    usable = ((borders[:, :2] <= evidence.whole) & (whole & allowed)[borders[:, :2]]).all(axis=1)
    _by_contact(book, borders[usable], regions, depths, rising)


def _chosen_main(book: OrderBook, plate: PlateVotes, rising: int, rules: DecisionRules) -> bool:
    """Give the region that shows most of the plate its order; return whether any shows enough of it."""
    main = plate.main
    enough = max(rules.plate_pixels, rules.main_share * plate.sizes[main])
    return bool(plate.counts[main] >= enough) and book.choose(main, -rising * int(plate.levels[main]))


def gathered(
    regions: Regions,
    light: NDArray[np.float32],
    lines: EpipolarLines,
    plate_at: PlateAt,
    noise: NoiseLevels,
    rules: DecisionRules,
) -> Evidence:
    """Walk along epipolar lines; split regions that a shadow shows to be two surfaces in one, and walk again."""
    unsplit = regions.number
    for turn in range(rules.rounds):
        found, seen, bounds = _walked(regions, light, lines, plate_at, noise)
        plate = PlateVotes.of(regions, rules)
        wrong = _self_contradictions(seen, bounds) | _against_the_rest(seen, bounds, plate, lines.rising, rules)
        other = _of_another_order(seen, noise, rules)
        wrong |= other
        edged = _entered_over_inner_edges(found, regions.cores.shape, rules)
        if not (wrong | edged).any():
            return Evidence.of(regions, bounds, unsplit, plate)
        if turn == 0 and wrong.any():
            changed = np.unique(found[wrong, FIRST]).astype(np.int64)
            regions = _cut_at_faint_edges(regions, changed, noise, rules)
            continue
        free = found[:, WAY_IN] == FREE
        shape = regions.cores.shape
        whole = _closed(mark_runs(found[wrong & free], shape, lines), rules.closing_px)
        whole |= _before_gaps(found[other & ~free], regions.cores, lines)
        cut = _closed(mark_runs(found[edged | (wrong & ~free)], shape, lines), rules.bridged_px)
        changed = np.unique(found[wrong | edged, FIRST]).astype(np.int64)
        inside = np.isin(regions.cores, changed)
        own, out = cut & ~whole & inside, whole & inside
        regions = _split(regions, own, out, changed, np.unique(found[wrong, FIRST]).astype(np.int64))
    _, _, bounds = _walked(regions, light, lines, plate_at, noise)
    return Evidence.of(regions, bounds, unsplit, PlateVotes.of(regions, rules))


def _walked(
    regions: Regions, light: NDArray[np.float32], lines: EpipolarLines, plate_at: PlateAt, noise: NoiseLevels
) -> tuple[Array, Passages, Bounds]:
    """Return all passages, what they say of absolute phase, and the bounds that they vote for."""
    found = passages(regions.values, regions.cores, light, lines, noise.edge_rad)
    ends = plate_at(found[:, (END_U, START_U)], found[:, (END_V, START_V)])
    seen = Passages.of(found, ends, lines.rising, regions.cores.shape)
    return found, seen, bounds_of(seen, breadths(regions.cores, lines), noise.dark_level)


def _entered_over_inner_edges(found: Array, shape: tuple[int, int], rules: DecisionRules) -> NDArray[np.bool_]:
    """Passages whose first region was entered over an edge within it that is seen on enough neighbouring lines."""
    edged = found[:, WAY_IN] == FROM_SAME
    v, u = np.divmod(found[:, ENTRY].astype(np.int64), shape[1])
    places = stretches(u[edged], v[edged], shape)
    edged[edged] = np.bincount(places)[places] >= rules.edge_lines
    return np.asarray(edged)


def _self_contradictions(seen: Passages, bounds: Bounds) -> NDArray[np.bool_]:
    """Passages from a region into itself across a shadow that cannot be: one surface in front, another behind."""
    own = (bounds.first == bounds.second) & ((bounds.fringes > 0) | (bounds.equal & (bounds.fringes != 0)))
    fringes, left = seen.closing_fringes()
    wrong = np.zeros(seen.first.size, bool)
    for region in np.unique(bounds.first[own]):
        here = (seen.first == region) & (seen.second == region)
        wrong |= here & seen.shadow & (fringes != 0)
        wrong |= here & seen.meeting
    return wrong


def _against_the_rest(
    seen: Passages, bounds: Bounds, plate: PlateVotes, rising: int, rules: DecisionRules
) -> NDArray[np.bool_]:
    """Passages over shadows that contradict what more lines say: their first region may be two surfaces in one."""
    book = OrderBook(plate.sizes.size - 1, bounds)
    if not _chosen_main(book, plate, rising, rules):
        return np.zeros(seen.first.size, bool)
    fringes, _ = seen.closing_fringes()
    wrong = np.zeros(seen.first.size, bool)
    for k in book.carry():
        if bounds.equal[k]:
            same = (seen.first == bounds.first[k]) & (seen.second == bounds.second[k])
            wrong |= same & seen.shadow & (fringes == bounds.fringes[k])
    return wrong


def _of_another_order(seen: Passages, noise: NoiseLevels, rules: DecisionRules) -> NDArray[np.bool_]:
    """Passages over a shadow from a region that is two surfaces in one, of the order that fewer of its lines say.

    Every order that many lines say must close as evenly as over the shadow of one surface: a dark band that is none
    gives orders that wander.
    """
    fringes, left = seen.closing_fringes()
    wrong = np.zeros(seen.first.size, bool)
    over = np.flatnonzero(seen.shadow & (seen.first != seen.second) & (np.abs(left) < EVIDENCE_RULES.closure_rad))
    for at in same_pair(seen, over):
        orders, lines = np.unique(fringes[at], return_counts=True)
        many = orders[lines >= max(rules.edge_lines, rules.surface_share * at.size)]
        said = [at[fringes[at] == order] for order in many]
        if len(said) > 1 and all(closes_evenly(seen, left, one, noise.dark_level) for one in said):
            said.sort(key=len)
            wrong[np.concatenate(said[:-1])] = True
    return wrong


def _cut_at_faint_edges(regions: Regions, changed: Ints, noise: NoiseLevels, rules: DecisionRules) -> Regions:
    """Cut regions that are two surfaces in one where a break shows that no two neighbours do."""
    cores, number = regions.cores.copy(), regions.number
    out = np.zeros(cores.shape, np.bool_)
    for region in changed.tolist():
        inside = cores == region
        edges = inside & faint_edges(regions.values, inside, rules.faint_sigmas, noise.sigma_rad)
        cores[edges], out[edges] = 0, True
        number = _numbered_parts(cores, cores == region, number, keep_largest=True)
    return _regrown(regions, cores, out, changed)


def _before_gaps(found: Array, cores: Labels, lines: EpipolarLines) -> NDArray[np.bool_]:
    """Mask of what lies before the last gap of runs: an edge that looks like none may be at any gap."""
    runs, ends = mark_runs(found, cores.shape, lines), mark_run_ends(found, cores, lines)
    return np.asarray(runs & ~ends)


def _closed(mask: NDArray[np.bool_], side_px: int) -> NDArray[np.bool_]:
    """Close gaps of a mask that are narrower than a square."""
    kernel = np.ones((side_px, side_px), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0)


def _split(regions: Regions, own: NDArray[np.bool_], out: NDArray[np.bool_], changed: Ints, torn: Ints) -> Regions:
    """Give every part of `own` a number of its own, and every part of what else is left of the changed regions.

    The largest part of what is left of a region keeps its number; `out` is taken out of the regions.
    """
    cores = np.where(out, 0, regions.cores).astype(np.int32)
    number = _numbered_parts(cores, own, regions.number, keep_largest=False)
    for region in changed.tolist():
        number = _numbered_parts(cores, (cores == region) & ~own, number, keep_largest=True)
    return _regrown(regions, cores, out, torn)


def _regrown(regions: Regions, cores: Labels, out: NDArray[np.bool_], torn: Ints) -> Regions:
    """Let split regions grow again; none over what belonged to one that is two surfaces, for its edge is not seen."""
    grown = regions.with_cores(cores, out)
    foreign = (grown.labels != regions.labels) & (grown.labels > 0) & (grown.labels <= regions.number)
    foreign &= np.isin(regions.labels, torn)
    return grown.with_cores(cores, out | foreign) if foreign.any() else grown


def _numbered_parts(cores: Labels, mask: NDArray[np.bool_], number: int, *, keep_largest: bool) -> int:
    """Number the connected parts of a mask from `number` + 1 on, in place; return the last number."""
    count, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    chosen = parts > 0
    if keep_largest and count > 1:
        chosen &= parts != 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    cores[chosen] = parts[chosen] + number
    return number + count - 1


def _at_rim(regions: Regions, rules: DecisionRules) -> NDArray[np.bool_]:
    """Whether each region comes near to the picture's border."""
    rim = np.ones(regions.cores.shape, bool)
    rim[rules.rim_px : -rules.rim_px, rules.rim_px : -rules.rim_px] = False
    found = np.zeros(regions.number + 1, bool)
    found[np.unique(regions.cores[rim])] = True
    return found


def _by_contact(book: OrderBook, borders: Ints, regions: Regions, depths: Depths, rising: int) -> None:
    """Carry orders over borders along which both sides meet, from what is decided."""
    sizes = np.bincount(regions.labels.ravel(), minlength=regions.number + 1)
    orders = np.where(book.low == book.high, rising * book.low, np.nan)

    def impossible(group: dict[int, int]) -> bool:
        return depths.impossible({region: rising * order for region, order in group.items()})

    for region, order in orders_by_contact(borders, sizes, orders, impossible).items():
        if np.isnan(orders[region]):
            book.choose(region, rising * order)
