"""A measured surface to hold in the hand: maps in mm, as arrays and as a table, drawn and saved."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.library.verdicts import tabulated
from fringecal.reconstruct import HeightMap
from fringecal.records import Check, result_folder, write_surfaces
from fringecal.report import height_map
from fringecal.workflows.shared import severest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Map = NDArray[np.floating]


@dataclass(frozen=True, repr=False)
class Surface:
    """A measured surface, one value per pixel, NaN where masked; mm in the plate frame, (H, W).

    Parameters
    ----------
    heights
        The height map with its uncertainty by component and the reasons of its mask.
    notes
        What a reader should know of the frames: which phase shifts were used, why the capture does not fit the
        calibration, what was found wrong with the frames.
    judged
        Checks of the capture against the calibration.
    """

    heights: HeightMap
    notes: tuple[str, ...] = ()
    judged: tuple[Check, ...] = ()

    @property
    def checks(self) -> pd.DataFrame:
        """Every check of the capture against the calibration with its value, u, limit, decision and rule."""
        return tabulated(self.judged)

    @property
    def verdict(self) -> str:
        """The severest decision of all checks, on whether the capture fits the calibration."""
        return severest(self.judged)

    @property
    def x(self) -> Map:
        """Coordinate x, mm."""
        return self.heights.x

    @property
    def y(self) -> Map:
        """Coordinate y, mm."""
        return self.heights.y

    @property
    def z(self) -> Map:
        """Height above the reference plane, mm."""
        return self.heights.z

    @property
    def u_z(self) -> Map:
        """Standard uncertainty of z of each single pixel, mm."""
        return self.heights.u_z

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where the height is valid."""
        return self.heights.mask

    def mean(self, where: NDArray[np.bool_] | None = None) -> tuple[float, float]:
        """Return the mean height over a region and its standard uncertainty, mm: common parts do not average out.

        Parameters
        ----------
        where
            Region, (H, W); all valid pixels by default.
        """
        inside = self.mask if where is None else self.mask & where
        return float(np.mean(self.z[inside])), self.heights.mean_uncertainty(inside.astype(float))

    def to_frame(self) -> pd.DataFrame:
        """Tabulate the valid pixels: u, v in px; x, y, z, u_z in mm."""
        v, u = np.nonzero(self.mask)
        columns = {name: getattr(self, name)[v, u] for name in ("x", "y", "z", "u_z")}
        return pd.DataFrame({"u_px": u, "v_px": v} | {f"{name}_mm": values for name, values in columns.items()})

    def save(self, folder: str | Path) -> Path:
        """Write `height.npz` and the surfaces (TIFF, PLY, STL, OBJ, x3p) into a folder; return it."""
        place = Path(folder)
        with result_folder(place, last="height.npz") as staging:
            write_surfaces(staging, self.heights)
        return place

    def plot(self) -> "Figure":
        """Draw the heights as a map in the plate frame."""
        return height_map(self.x, self.y, self.z)

    def __repr__(self) -> str:
        """Say size, valid share, range and usual uncertainty."""
        low, high = float(np.nanmin(self.z)), float(np.nanmax(self.z))
        return (
            f"<Surface {self.z.shape[1]} x {self.z.shape[0]} px, {100 * self.mask.mean():.1f} % valid, "
            f"z {low:.3f} to {high:.3f} mm, median u(z) {float(np.nanmedian(self.u_z)):.4f} mm>"
        )

    def _repr_html_(self) -> str:
        return f"<div>{repr(self)[1:-1]}</div>"
