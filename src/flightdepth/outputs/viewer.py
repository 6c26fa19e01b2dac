"""A flight in the Rerun viewer: pictures, depth, confidence, graphs over time and the cloud in 3D."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from flightdepth.errors import BadInput
from flightdepth.levels import jpeg
from flightdepth.motion import ENU_FROM_NED, Vector
from flightdepth.outputs.cloud import CloudSettings, cloud_of
from flightdepth.outputs.encoding import UNIT_M, bytes_from_confidence, centimetres_from_depth, png
from flightdepth.outputs.frame_table import FrameRow
from flightdepth.outputs.palette import Picture
from flightdepth.outputs.pictures import panels
from flightdepth.outputs.poses import FramePose
from flightdepth.outputs.read import FlightFolder

CAMERA, IMAGE = "world/camera", "world/camera/picture"
DEPTH, CONFIDENCE = f"{IMAGE}/depth", f"{IMAGE}/confidence"
COLOURS = f"{DEPTH}/colours"  # the preview's, over the metres that the cursor tells: Rerun has no such scale
TIME = "flight"
JPEG_QUALITY = 85
POINT_RADIUS_M = 0.12


def show(
    recording: rr.RecordingStream,
    flight: FlightFolder,
    *,
    most_pictures: int,
    on_picture: Callable[[], None] = lambda: None,
) -> None:
    """Send a flight; of its pictures and maps every n-th, so that there are at most `most_pictures`."""
    recording.send_blueprint(layout())
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_graphs(recording, flight.rows)
    _log_places(recording, flight)
    stamps = {row.index: row.stamp_ns for row in flight.rows}
    for index, (image, colours) in panels(flight, every_nth(flight, most_pictures), 2):
        recording.set_time(TIME, duration=np.timedelta64(stamps[index], "ns"))
        _log_maps(recording, flight, index, image, colours)
        on_picture()
    _log_cloud(recording, flight)


def every_nth(flight: FlightFolder, most_pictures: int) -> int:
    """The step that leaves at most so many frames."""
    return max(1, -(-len(flight.rows) // most_pictures))


def layout() -> rrb.Blueprint:
    """Pictures above, graphs and the cloud below."""
    above = rrb.Horizontal(
        rrb.Spatial2DView(origin=IMAGE, contents="$origin", name="video"),
        rrb.Spatial2DView(origin=IMAGE, contents="$origin/depth/**", name="depth, metres"),
        rrb.Spatial2DView(origin=IMAGE, contents="$origin/confidence", name="confidence"),
    )
    graphs = rrb.Vertical(
        rrb.TimeSeriesView(origin="displacement", name="displacements, metres"),
        rrb.TimeSeriesView(origin="shift", name="shifts, frames"),
        rrb.TimeSeriesView(origin="known", name="share of the picture with depth"),
    )
    cloud = rrb.Spatial3DView(
        origin="world", contents=["$origin/**", f"- /{DEPTH}/**", f"- /{CONFIDENCE}"], name="cloud"
    )
    below = rrb.Horizontal(graphs, cloud, column_shares=[1, 2])
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[2, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIME),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _log_maps(
    recording: rr.RecordingStream, flight: FlightFolder, index: int, image: Picture, colours: Picture
) -> None:
    camera = flight.camera(index)
    lens = rr.Pinhole(
        image_from_camera=camera.matrix,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=3.0,
    )
    recording.log(IMAGE, lens)
    recording.log(IMAGE, rr.EncodedImage(contents=jpeg(image, JPEG_QUALITY), media_type="image/jpeg"))
    metres = png(centimetres_from_depth(flight.depth_m(index)))
    recording.log(
        DEPTH,
        rr.EncodedDepthImage(metres, media_type="image/png", meter=1 / UNIT_M, colormap="grayscale"),
    )
    recording.log(COLOURS, rr.EncodedImage(contents=jpeg(colours, JPEG_QUALITY), media_type="image/jpeg"))
    confidence = png(bytes_from_confidence(flight.confidence(index)))
    recording.log(CONFIDENCE, rr.EncodedImage(contents=confidence, media_type="image/png"))


def _log_graphs(recording: rr.RecordingStream, rows: list[FrameRow]) -> None:
    """Displacements and shifts, shortest range first, and the share of known pixels, of every frame."""
    _log_curve(recording, "known/depth", [(row.stamp_ns, row.valid_fraction) for row in rows])
    for i in range(max((len(row.shifts) for row in rows), default=0)):
        having = [row for row in rows if len(row.shifts) > i]
        lengths = [(row.stamp_ns, row.displacements_m[i]) for row in having]
        _log_curve(recording, f"displacement/range_{i + 1}", lengths)
        shifts = [(row.stamp_ns, float(row.shifts[i])) for row in having]
        _log_curve(recording, f"shift/range_{i + 1}", shifts)


def _log_curve(recording: rr.RecordingStream, path: str, points: list[tuple[int, float]]) -> None:
    recording.send_columns(
        path,
        indexes=[_times([stamp_ns for stamp_ns, _ in points])],
        columns=rr.Scalars.columns(scalars=np.array([value for _, value in points])),
    )


def _times(stamps_ns: list[int]) -> rr.TimeColumn:
    return rr.TimeColumn(TIME, duration=np.array(stamps_ns, "timedelta64[ns]"))


def _log_places(recording: rr.RecordingStream, flight: FlightFolder) -> None:
    """The camera at each frame, and the way it flew."""
    known = [pose for pose in flight.poses.values() if pose.attitude != "unknown"]
    if known:
        turns = np.array([ENU_FROM_NED @ pose.ned_from_camera for pose in known])
        recording.send_columns(
            CAMERA,
            indexes=[_times([pose.stamp_ns for pose in known])],
            columns=rr.Transform3D.columns(translation=[_enu(pose) for pose in known], mat3x3=turns),
        )
    ways: defaultdict[int, list[Vector]] = defaultdict(list)
    for pose in flight.poses.values():
        ways[pose.segment].append(_enu(pose))
    strips = rr.LineStrips3D([np.array(way) for way in ways.values()], colors=[255, 190, 80])
    recording.log("world/way_flown", strips, static=True)


def _log_cloud(recording: rr.RecordingStream, flight: FlightFolder) -> None:
    try:
        cloud = cloud_of(flight, CloudSettings())
    except BadInput:  # no poses: the rest is worth seeing
        return
    points = rr.Points3D(cloud.points_m, colors=cloud.colours, radii=POINT_RADIUS_M)
    recording.log("world/cloud", points, static=True)


def _enu(pose: FramePose) -> np.ndarray:
    return ENU_FROM_NED @ pose.position_ned
