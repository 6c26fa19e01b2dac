"""A flight as a COLMAP project, which trainers of Gaussian splats and programs of photogrammetry read.

    images/000012.jpg     pictures, as an ideal lens would have filmed them
    depths/000012.png     their depth, whole millimetres, 0 = unknown
    sparse/0/*.bin        cameras, poses and the cloud: metres east, north, up
    flightdepth.json      what the folder holds

Poses are the log's: nothing is matched, nothing adjusted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.files import bring_to_the_disk, write_json
from flightdepth.levels import jpeg
from flightdepth.motion import ENU_FROM_NED, Vector
from flightdepth.outputs.cloud import AGREE_WITHIN, FARTHEST_M, CloudSettings, off_edges, own_share, placed
from flightdepth.outputs.cloud_files import FRAME
from flightdepth.outputs.colmap_files import PosedImage, write_model
from flightdepth.outputs.encoding import Map, png
from flightdepth.outputs.palette import Picture
from flightdepth.outputs.read import FlightFolder
from flightdepth.outputs.undistorted import ideal_view, map_through, picture_through
from flightdepth.outputs.voxels import Cloud
from flightdepth.runtimes.lens import inside

IMAGES, DEPTHS, SPARSE, NOTE = "images", "depths", "sparse", "flightdepth.json"
OWN_NAMES = {IMAGES, DEPTHS, SPARSE, NOTE}
MOST_PICTURES = 300  # where nobody says how many: trainers hold them all
LEAST_STEP = 5  # frames from one of them to the next, as in clouds
MOST_SEEN = 2000  # points that a picture's list names
JPEG_QUALITY = 95
DEPTH_UNIT_M = 0.001  # Nerfstudio's own
FARTHEST_STORED = 65535


def every_picture(frames: int) -> int:
    """The step between pictures of a flight of so many frames, where nobody says it."""
    return max(LEAST_STEP, -(-frames // MOST_PICTURES))


def write_colmap(
    folder: Path,
    flight: FlightFolder,
    cloud: Cloud,
    pictures: Iterable[tuple[int, Picture]],
    *,
    settings: CloudSettings,
    on_picture: Callable[[], None] = lambda: None,
) -> list[PosedImage]:
    """Into an empty folder: the cloud, and those of `pictures` (frame's index, RGB [h, w, 3]) that show a point of it.

    Others, of which no place or no depth is known, would tell a trainer nothing, and stop some. `settings` say which
    depth counts. Pictures may be of any one size, whichever the flight's maps have.
    """
    for name in (IMAGES, DEPTHS, f"{SPARSE}/0"):
        (folder / name).mkdir(parents=True)
    poses, cloud, images = placed(flight), shuffled(cloud), []
    for index, picture in pictures:
        on_picture()
        if index not in poses:
            continue
        pose, lens = poses[index], flight.camera(index)
        camera = ideal_view(lens).resized(picture.shape[1], picture.shape[0])
        depth_m = map_through(camera, usable_depth(flight, index, settings), lens)
        turn, place = ENU_FROM_NED @ pose.ned_from_camera, ENU_FROM_NED @ pose.position_ned
        pixels, points = seen_points((cloud.points_m - place) @ turn, depth_m, camera)
        if not len(points):
            continue
        images.append(PosedImage(f"{index:06d}.jpg", camera, turn, place, pixels, points))
        flat = picture_through(camera, picture, lens)
        (folder / IMAGES / images[-1].name).write_bytes(jpeg(flat, JPEG_QUALITY))
        (folder / DEPTHS / f"{index:06d}.png").write_bytes(png(millimetres(depth_m)))
    write_model(folder / SPARSE / "0", images, cloud)
    depths = {"unit_m": DEPTH_UNIT_M, "unknown": 0}
    write_json(folder / NOTE, {"flight": flight.record.source.flight, "axes": FRAME, DEPTHS: depths})
    bring_to_the_disk()
    return images


def shuffled(cloud: Cloud) -> Cloud:
    """The same points in a mixed order, always the same: the first of them lie everywhere."""
    order = np.random.default_rng(0).permutation(len(cloud))
    return Cloud(cloud.points_m[order], cloud.colours[order], cloud.confidence[order])


def usable_depth(flight: FlightFolder, index: int, settings: CloudSettings) -> Map:
    """Depth of a frame [H, W] where a cloud would take it before it asks other frames; NaN elsewhere."""
    depth_m, confidence, sigma_m = flight.depth_m(index), flight.confidence(index), flight.sigma_m(index)
    usable = confidence >= max(settings.min_confidence, 1 / 512)
    usable &= (depth_m <= min(settings.max_range_m, FARTHEST_M)) & off_edges(depth_m)
    if sigma_m is not None:
        usable &= own_share(sigma_m, depth_m) <= settings.max_sigma
    return np.where(usable, depth_m, np.float32(np.nan))


def seen_points(points: Vector, depth_m: Map, camera: Camera) -> tuple[Vector, NDArray[np.intp]]:
    """Of points [N, 3] (right, down, forward of an ideal camera) the first that its depth confirms: pixels, rows.

    A row at most as far off as frames of a cloud may disagree; MOST_SEEN at most.
    """
    ahead = points[:, 2] > 0.01
    there_m = np.where(ahead, points[:, 2], 1.0)
    focal, middle = (camera.fx, camera.fy), (camera.cx, camera.cy)
    pixels = points[:, :2] / there_m[:, None] * focal + middle
    ahead &= inside(pixels, camera)
    columns, rows = np.rint(np.where(ahead[:, None], pixels, 0.0)).astype(int).T
    agrees = ahead & (np.abs(depth_m[rows, columns] / there_m - 1) <= AGREE_WITHIN)
    shown = np.flatnonzero(agrees)[:MOST_SEEN]
    return pixels[shown], shown


def millimetres(depth_m: Map) -> NDArray[np.uint16]:
    """Metres [H, W], NaN = unknown, to whole millimetres, 0 = unknown: so is what is farther than 65.535 m."""
    whole = np.rint(depth_m.astype(np.float64) / DEPTH_UNIT_M)
    return np.where(whole <= FARTHEST_STORED, whole, 0).astype(np.uint16)
