"""ArUco and AprilTag markers in pictures, of OpenCV's dictionaries, found without their names."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.solve.marker_edges import refine

_SIZES = (50, 100, 250)
_FAMILIES = {
    **{f"DICT_{n}X{n}": tuple(f"DICT_{n}X{n}_{size}" for size in _SIZES) for n in (4, 5, 6, 7)},
    "ArUco": ("DICT_ARUCO_ORIGINAL",),
    "ArUco MIP": ("DICT_ARUCO_MIP_36h12",),
    **{f"AprilTag {one}": (f"DICT_APRILTAG_{one}",) for one in ("16h5", "25h9", "36h11")},
}
"""OpenCV's usual dictionaries; the smaller ones of a family are the beginnings of the larger."""
_SMALLEST_PX = 12.0  # sides of markers: texture looks like smaller ones
_FRAMES = 120  # that show markers: more of them add nothing
_LONGEST_WAIT = 32  # frames between searches for markers of any family, which take long


class Sighting(Struct, frozen=True, eq=False):
    """The markers that one frame shows.

    Attributes:
        frame: counted from the first that was searched.
        ids: of the markers (K,).
        corners: from the marker's upper left clockwise (K, 4, 2), pixel centres at +0.5 [px].
    """

    frame: int
    ids: npt.NDArray[np.int64]
    corners: Float64


@dataclass(slots=True)
class MarkerFinder:
    """Looks for markers in one picture after the other, of any family until one is found."""

    _detector: cv2.aruco.ArucoDetector | None = None
    _family: str = ""
    _sightings: list[Sighting] = field(default_factory=list)
    _frame: int = 0
    _due: int = 0

    @property
    def full(self) -> bool:
        """Whether more pictures would add nothing."""
        return len(self._sightings) >= _FRAMES

    def add(self, luma: npt.NDArray[np.uint8], scale: float = 1.0) -> None:
        """Search the next picture.

        Args:
            luma: (H, W).
            scale: pixels of the sightings by those of the picture [1].
        """
        frame, self._frame = self._frame, self._frame + 1
        if self._detector is None and frame >= self._due:
            self._due = frame + min(max(1, frame), _LONGEST_WAIT)
            self._choose(luma)
        if self._detector is None or self.full:
            return
        ids, corners = _found(self._detector, luma)
        if len(ids):
            refined = np.array([refine(luma, one) for one in corners])
            self._sightings.append(Sighting(frame, ids, refined * scale))

    def sightings(self) -> tuple[list[Sighting], str]:
        """The markers, and the name of their family."""
        return self._sightings, self._family

    def _choose(self, luma: npt.NDArray[np.uint8]) -> None:
        """Take the family whose markers cover most, with the fewest ids that hold those."""
        covered = {}
        for family, names in _FAMILIES.items():
            ids, corners = _found(_detector(names[-1]), luma)
            area = sum(cv2.contourArea(one.astype(np.float32)) for one in corners)
            if area > 0.0:
                covered[family] = area, int(ids.max())
        if covered:
            self._family = max(covered, key=lambda family: covered[family][0])
            names, most = _FAMILIES[self._family], covered[self._family][1]
            fit = [name for name, size in zip(names, _SIZES, strict=False) if size > most]
            self._detector = _detector(fit[0] if len(names) > 1 else names[0])


def _found(
    detector: cv2.aruco.ArucoDetector, luma: npt.NDArray[np.uint8]
) -> tuple[npt.NDArray[np.int64], Float64]:
    """Ids (K,) and corners (K, 4, 2) of the markers that are large enough and seen once."""
    corners, ids, _ = detector.detectMarkers(luma)
    if ids is None or not len(ids):
        return np.zeros(0, np.int64), np.zeros((0, 4, 2))
    found = np.asarray(corners, np.float64).reshape(-1, 4, 2) + 0.5  # OpenCV counts centres from 0
    sides = np.linalg.norm(np.roll(found, -1, axis=1) - found, axis=2)
    numbers = np.asarray(ids, np.int64).ravel()
    _, place, count = np.unique(numbers, return_inverse=True, return_counts=True)
    kept = (sides.min(axis=1) >= _SMALLEST_PX) & (count[place] == 1)
    return numbers[kept], found[kept]


def _detector(name: str) -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)),
        cv2.aruco.DetectorParameters(),
    )
