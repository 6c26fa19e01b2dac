"""The point cloud of a flight: depth maps and poses, joined in one local frame.

A depth map holds points that are wrong: sky that was given a depth, mixtures across an edge, plain errors. A point
counts where its error bar is narrow and it is near enough, where no edge runs, and where the frames before and after it
agree. Then each voxel keeps one point, the mean of what fell into it.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.motion import ENU_FROM_NED, Vector
from flightdepth.outputs.encoding import FARTHEST, UNIT_M, Map
from flightdepth.outputs.palette import Picture
from flightdepth.outputs.pictures import pictures
from flightdepth.outputs.poses import FramePose
from flightdepth.outputs.read import FlightFolder
from flightdepth.outputs.voxels import Cloud, VoxelGrid
from flightdepth.runtimes.lens import distort, inside, pixel_rays, view_bounds

NEIGHBOURS = 8  # frames on either side whose depth must agree
AGREE_WITHIN = 0.1  # of the depth
LEAST_AGREEING = 3
EDGE_PX, EDGE_RATIO = 5, 1.2  # farthest over nearest within so many pixels: beyond, depth mixes two things
COLUMNS = 160  # pixels used across a picture; a network's own map has about 80 to 160
COMMON = 0.05  # of a frame's pixels: what the narrowest of their error bars have is all pixels'
WIDEST = np.tan(np.radians(60))
FARTHEST_M = (FARTHEST - 1) * UNIT_M  # what is stored as FARTHEST lies anywhere beyond


@dataclass(frozen=True)
class CloudSettings:
    """Which points count.

    min_confidence  0..1
    max_sigma       their own part of the error bar (`own_share`), as a share of the depth
    max_range_m     along the camera's axis
    voxel_m         edge of a cube that has one point
    every           n-th frame is used
    """

    min_confidence: float = 0.6
    max_sigma: float = 0.08
    max_range_m: float = 60.0
    voxel_m: float = 0.25
    every: int = 5

    def __post_init__(self) -> None:
        if not 0 <= self.min_confidence <= 1:
            raise BadInput("--min-confidence", expected="0 to 1", got=str(self.min_confidence))
        if not self.max_sigma > 0:
            raise BadInput("--max-sigma", expected="more than 0", got=str(self.max_sigma))
        if not (np.isfinite(self.max_range_m) and self.max_range_m > 0):
            raise BadInput("--max-range", expected="more than 0 m", got=str(self.max_range_m))
        if not (np.isfinite(self.voxel_m) and self.voxel_m >= 0.01):
            raise BadInput("--voxel", expected="0.01 m or more", got=str(self.voxel_m))
        if self.every < 1:
            raise BadInput("--every", expected="1 or more", got=str(self.every))


@dataclass(frozen=True, eq=False)
class View:
    """One frame: depth [H, W], the camera's place, and the camera as it zoomed.

    image, confidence  [h, w, 3], [h, w], of every `step`-th pixel of every `step`-th row: views wait for those after
                       them, and of a large video whole ones would take gigabytes. No image where nobody asks for colour
    share              of those too: `own_share`; None of a network that tells no error bar
    """

    image: Picture | None
    depth_m: Map
    confidence: Map
    pose: FramePose
    camera: Camera
    share: Map | None = None


@dataclass(frozen=True, eq=False)
class AgreedView:
    """A frame, its points that count [N, 3], east-north-up, their rows and columns in its picture, and its `step`."""

    view: View
    points_enu: Vector
    pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
    step: int


def cloud_of(
    folder: FlightFolder, settings: CloudSettings, on_view: Callable[[], None] = lambda: None
) -> Cloud:
    """The cloud of a whole flight, east-north-up, origin at the first camera of its longest segment."""
    grid = VoxelGrid(settings.voxel_m)
    for seen in agreed_views(folder, settings, on_view, coloured=True):
        assert seen.view.image is not None
        grid.add(seen.points_enu, seen.view.image[seen.pixels], seen.view.confidence[seen.pixels])
    return grid.cloud()


def agreed_views(
    folder: FlightFolder, settings: CloudSettings, on_view: Callable[[], None], *, coloured: bool
) -> Iterator[AgreedView]:
    """Each frame that is used, with its points that those before and after it agree on."""
    step = max(1, folder.record.source.camera.width // COLUMNS)
    for view, others in with_neighbours(views(folder, settings.every, step, coloured=coloured), NEIGHBOURS):
        points_ned, rows, columns = seen_points(view, step, settings)
        kept, farther = agreed(points_ned, others if len(points_ned) else [])
        here_ned = view.pose.position_ned
        points_ned = here_ned + (points_ned[kept] - here_ned) * farther[kept, None]
        yield AgreedView(view, points_ned @ ENU_FROM_NED.T, (rows[kept], columns[kept]), step)
        on_view()


def views(folder: FlightFolder, every: int, step: int, *, coloured: bool = True) -> Iterator[View]:
    """Each `every`-th frame, where it has depth and a known pose in the longest segment.

    coloured  with its image, for which the flight needs its preview
    """
    poses = placed(folder)
    depths = {row.index for row in folder.rows if not row.reason}
    colourless = ((row.index, None) for row in folder.rows[::every])
    for index, image in pictures(folder, every) if coloured else colourless:
        if index in poses and index in depths:
            thin = None if image is None else image[::step, ::step].copy()
            confidence = folder.confidence(index)[::step, ::step].copy()
            depth_m, sigma_m = folder.depth_m(index), folder.sigma_m(index)
            share = None if sigma_m is None else own_share(sigma_m[::step, ::step], depth_m[::step, ::step])
            yield View(thin, depth_m, confidence, poses[index], folder.camera(index), share)


def own_share(sigma_m: Map, depth_m: Map) -> Map:
    """What of its error bar is each pixel's own, as a share of its depth, [h, w]; NaN where depth is.

    A speed that nobody is sure of is in all of a frame's error bars alike: it moves the points together, and so says
    nothing against their shape.
    """
    share = sigma_m / depth_m
    known = share[np.isfinite(share)]
    common = np.quantile(known, COMMON) if len(known) else 0.0
    return np.asarray(np.sqrt(np.maximum(share**2 - np.float32(common) ** 2, 0)))


def placed(folder: FlightFolder) -> dict[int, FramePose]:
    """Poses with an attitude, of the segment that holds most of them."""
    known = [pose for pose in folder.poses.values() if pose.attitude != "unknown"]
    if not known:
        mend = "Give `flightdepth run` a log with the camera's attitude, or a network that knows directions."
        if not folder.poses:  # a speed alone
            seen = folder.record.source.network.knows_direction
            mend = (
                f"Give `flightdepth run` {'' if seen else 'a network that knows directions, or '}a log that tells which"
                " way the drone flew, `flightdepth live` one that tells the camera's attitude too (--mount fixed, or a"
                " gimbal that reports)."
            )
        raise BadInput(
            f"poses of {folder.folder}",
            expected="places where the camera was",
            got="no frame with known position and attitude",
            mend=mend,
        )
    ((longest, _),) = Counter(pose.segment for pose in known).most_common(1)
    return {pose.index: pose for pose in known if pose.segment == longest}


def frames_left_out(folder: FlightFolder) -> int:
    """Frames with depth of which no point can come: of another segment, or the camera's attitude is unknown."""
    poses = placed(folder)
    return sum(not row.reason and row.index not in poses for row in folder.rows)


def with_neighbours(every: Iterable[View], reach: int) -> Iterator[tuple[View, list[View]]]:
    """Each view with up to `reach` before it and after it."""
    window: deque[View | None] = deque([None] * reach, maxlen=2 * reach + 1)
    for view in chain(every, repeat(None, reach)):
        window.append(view)
        if len(window) == 2 * reach + 1 and (middle := window[reach]) is not None:
            yield middle, [other for other in window if other is not None and other is not middle]


def seen_points(
    view: View, step: int, settings: CloudSettings
) -> tuple[Vector, NDArray[np.intp], NDArray[np.intp]]:
    """Points (NED) [N, 3] of the pixels that count, every `step`-th, and their rows and columns in `view.image` [N]."""
    depth_m, clear = view.depth_m[::step, ::step], off_edges(view.depth_m)[::step, ::step]
    usable = view.confidence >= max(settings.min_confidence, 1 / 512)
    if view.share is not None:
        usable &= view.share <= settings.max_sigma
    rows, columns = np.nonzero(usable & (depth_m <= min(settings.max_range_m, FARTHEST_M)) & clear)
    rays = pixel_rays(view.camera, step)[rows, columns]
    points = rays * depth_m[rows, columns].astype(np.float64)[:, None]
    return points @ view.pose.ned_from_camera.T + view.pose.position_ned, rows, columns


def off_edges(depth_m: Map) -> NDArray[np.bool_]:
    """Where depth hardly changes nearby, bool [H, W]; false where it is NaN."""
    window = np.ones((EDGE_PX, EDGE_PX), np.uint8)
    known = np.isfinite(depth_m)
    farthest = cv2.dilate(np.where(known, depth_m, np.float32(0)), window)
    nearest = cv2.erode(np.where(known, depth_m, np.float32(np.inf)), window)
    return np.asarray(known & (farthest / np.float32(EDGE_RATIO) <= nearest))


def agreed(points_ned: Vector, others: list[View]) -> tuple[NDArray[np.bool_], Vector]:
    """Which points [N] most of the other views that see their place saw there, and how much farther these saw them.

    The second, [N], is the mean of what the views that agree say over where the point lies: 1 and a little.
    """
    seen, same = np.zeros(len(points_ned), int), np.zeros(len(points_ned), int)
    ratios = np.ones(len(points_ned))  # its own vote
    for other in others:
        there_m, stored_m = looked_up(points_ned, other)
        known = np.isfinite(stored_m)
        ratio = np.where(known, stored_m, 0.0) / np.where(known, there_m, 1.0)
        agrees = np.abs(ratio - 1) <= AGREE_WITHIN
        seen += known
        same += agrees
        ratios += np.where(agrees, ratio, 0.0)
    return np.asarray((same >= LEAST_AGREEING) & (2 * same >= seen)), ratios / (1 + same)


@lru_cache(maxsize=2 * NEIGHBOURS + 2)  # a lens that zooms is another in each view
def field_of(camera: Camera) -> tuple[Vector, Vector]:
    """Least and most x, y at z = 1, (2,) each, of what a camera sees.

    Beyond, the polynomial of its lens may fold back into the picture.
    """
    widest = np.full(2, WIDEST)
    if camera.is_ideal:
        return -widest, widest
    left, right, top, bottom = view_bounds(camera)
    return np.maximum((left, top), -widest), np.minimum((right, bottom), widest)


def looked_up(points_ned: Vector, view: View) -> tuple[Vector, Vector]:
    """Depth [N] at which points lie before a view's camera, and what the view says there; NaN where it says nothing."""
    points = (points_ned - view.pose.position_ned) @ view.pose.ned_from_camera
    depth_m = points[:, 2]
    ahead = depth_m > 0.01
    rays = points[:, :2] / np.where(ahead, depth_m, 1.0)[:, None]
    least, most = field_of(view.camera)
    ahead &= ((least < rays) & (rays < most)).all(axis=1)
    pixels = distort(np.where(ahead[:, None], rays, 0.0), view.camera)
    ahead &= inside(pixels, view.camera)
    columns, rows = np.rint(np.where(ahead[:, None], pixels, 0.0)).astype(int).T
    return depth_m, np.where(ahead, view.depth_m[rows, columns], np.nan)
