"""`flightdepth convert`: a flight as a point cloud, a map of what is occupied, a recording, a trajectory, a project."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.full_disk import NOT_WRITTEN, room_on_the_disk
from flightdepth.commands.terminal import progress_bar, say, warn
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, refuse_to_replace, write_atomic

if TYPE_CHECKING:
    from collections.abc import Callable

    from flightdepth.flight.universal_time import UniversalTime
    from flightdepth.outputs import FlightFolder
    from flightdepth.outputs.cloud import CloudSettings
    from flightdepth.outputs.voxels import Cloud

RECORDING, TRAJECTORY = ".mcap", ".tum"
TIMED = (RECORDING, TRAJECTORY)  # whose stamps may be universal time, and which are no clouds
OCCUPANCY = ".bt"
HEIGHTS = (".tif", ".tiff")
PROJECT = ".colmap"  # a folder
KINDS = (".ply", ".las", ".laz", OCCUPANCY, *TIMED, PROJECT, *HEIGHTS)
OF_A_MAP = {"voxel_m": 0.5, "max_range_m": 30.0}  # where nothing is said; a cloud's would take minutes
CELL_M = 0.5  # of heights
LOCAL = "metres east, north, up"
STRAYS = (
    "the log's positions go another way than its velocities: is one of another flight, are latitude and longitude "
    "swapped, or is its north off?"
)
WIDER = "Try a lower --min-confidence, a larger --max-sigma or --max-range, or a smaller --every."
UNFILMED = "the preview of the interrupted flight ends before them"
NO_PLACE = "attitude unknown, or not of the longest segment (poses.csv)"


def convert(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What `flightdepth run` wrote.")],
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A name that ends in .ply, .las, .laz, .bt, .tif, .mcap, .tum or .colmap."
        ),
    ],
    *,
    min_confidence: Annotated[
        float | None,
        typer.Option(metavar="0..1", help="Clouds and maps: leave out what is less sure. Default: 0.6."),
    ] = None,
    max_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Clouds and maps: leave out what has a wider error bar, as a share of its depth. Default: 0.08.",
        ),
    ] = None,
    max_range: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Clouds and maps: leave out what is farther, in metres. Default: 60, of .bt 30.",
        ),
    ] = None,
    voxel: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Clouds and maps: edge of a cube that has one point, or of a cell. Default: 0.25, of maps 0.5.",
        ),
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Clouds and maps: use every N-th frame. Default: 5; pictures of .colmap: 5, or what leaves 300.",
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="VIDEO",
            help="Pictures of .colmap: from what `flightdepth run` was given, at its size. Without it: the preview's.",
        ),
    ] = None,
    utc: Annotated[
        bool,
        typer.Option(
            "--utc",
            help="Recordings, trajectories: stamps in universal time. Without it: since the video's first picture.",
        ),
    ] = False,
) -> None:
    """Turn a flight into one file that other programs read. The name's end says which.

    A point cloud with colours and confidence. A .ply is local: metres east,
    north and up from the first camera. So are .las and .laz, unless the log told
    where on Earth the drone was: they are in UTM then, with its EPSG code.

      flightdepth convert out flight.ply

      flightdepth convert out flight.laz --voxel 0.5 --max-range 40

    A map of what is occupied, free or unknown, for planners: an OctoMap, local as
    a .ply is:

      flightdepth convert out flight.bt

    A map of heights from above, a GeoTIFF for QGIS and GDAL, in UTM or local as a
    .laz is; its colours are in flight-photo.tif:

      flightdepth convert out flight.tif

    A ROS 2 recording: depth as 32FC1, confidence, pictures, camera info and
    transforms:

      flightdepth convert out flight.mcap

      flightdepth convert out flight.mcap --utc

    The camera's trajectory in TUM's format, east, north and up, as evo reads it:

      flightdepth convert out flight.tum

    A COLMAP project, a folder that trainers of Gaussian splats and Nerfstudio
    read: undistorted pictures, metric poses, depth and the cloud:

      flightdepth convert out flight.colmap --video flight.mp4

    .las, .laz and .bt need the extra `clouds`, .tif `rasters`, .mcap `ros`.
    """
    from flightdepth.outputs.cloud import CloudSettings, frames_left_out, placed
    from flightdepth.outputs.poses import tum_trajectory

    options = {
        "min_confidence": min_confidence,
        "max_sigma": max_sigma,
        "max_range_m": max_range,
        "voxel_m": voxel,
        "every": every,
    }
    given = {name: value for name, value in options.items() if value is not None}
    kind = checked_kind(file)
    usual = OF_A_MAP if kind == OCCUPANCY else {"voxel_m": CELL_M} if kind in HEIGHTS else {}
    settings = CloudSettings(**(usual | given))  # type: ignore[arg-type]
    check_outside(folder, file)
    if kind in TIMED and given:
        named = ", ".join(f"--{name.removesuffix('_m').replace('_', '-')}" for name in given)
        raise BadInput("options of clouds and maps", expected=f"none with {kind}", got=named)
    if utc and kind not in TIMED:
        raise BadInput(
            "--utc", expected=f"a FILE that ends in {' or '.join(TIMED)}", got=f"one that ends in {kind}"
        )
    if video is not None and kind != PROJECT:
        raise BadInput("--video", expected=f"a FILE that ends in {PROJECT}", got=f"one that ends in {kind}")
    flight = opened(folder)
    if kind == PROJECT:
        from flightdepth.commands.convert_colmap import write_project

        with room_on_the_disk(file, left=NOT_WRITTEN):
            write_project(flight, file, settings, every=every, video=video)
    elif kind == RECORDING:
        with room_on_the_disk(file, left=NOT_WRITTEN):
            frames = write_recording(flight, file, universal_time(flight) if utc else None)
        say(f"{file}: {frames:,} frames of {folder}")
        if frames < len(flight.rows):
            warn(f"{len(flight.rows) - frames:,} frames are not in it: {UNFILMED}")
    elif kind == TRAJECTORY:
        poses = list(placed(flight).values())
        zero_ns = universal_time(flight).ns_at_zero if utc else 0
        with room_on_the_disk(file, left=NOT_WRITTEN):
            write_atomic(file, tum_trajectory(poses, zero_ns).encode())
        say(f"{file}: {len(poses):,} poses of {folder}, {LOCAL}")
        if len(poses) < len(flight.rows):
            warn(f"{len(flight.rows) - len(poses):,} frames are not in it: {NO_PLACE}")
    else:
        with room_on_the_disk(file, left=NOT_WRITTEN):
            check_depth(flight)
            placed(flight)  # a bar is drawn for what can be done
            what, frame = writer_of(kind)(flight, file, settings)
        say(f"{file}: {what} from {folder}, {frame}")
        if left_out := frames_left_out(flight):
            warn(f"{left_out:,} frames with depth are not in it: {NO_PLACE}")


def opened(folder: Path) -> FlightFolder:
    """The flight in a folder; a warning tells of one that was interrupted."""
    from flightdepth.outputs import FlightFolder
    from flightdepth.outputs.writer import RECORD

    if not (folder / RECORD).exists() and (several := sorted(folder.glob(f"*/{RECORD}"))):
        raise BadInput(
            f"folder {folder}",
            expected="one flight's folder",
            got="one that holds it" if len(several) == 1 else f"that of {len(several):,} flights",
            mend=f"Give one, as {several[0].parent}.",
        )
    flight = FlightFolder(folder)
    if not flight.record.whole:
        warn(f"{folder} was interrupted: {len(flight.rows):,} frames of the flight stand")
    return flight


def checked_kind(file: Path) -> str:
    """What the name's end asks for."""
    kind = file.suffix.lower()
    if kind not in KINDS:
        raise BadInput(f"file {file}", expected=f"a name that ends in {', '.join(KINDS)}", got=kind or "none")
    if kind == PROJECT:
        from flightdepth.commands.convert_colmap import check_project

        check_project(file)
    elif kind in HEIGHTS:
        from flightdepth.commands.convert_heights import check_height_map

        check_height_map(file)
    else:
        check_parent("FILE", file)
        refuse_to_replace("file", file)
    return kind


def check_outside(folder: Path, file: Path) -> None:
    """Refuse a file or folder among those of the run: the next run there would replace it, or refuse to."""
    if file.resolve().is_relative_to(folder.resolve()):
        raise BadInput(
            f"{file}", expected=f"a place outside {folder}", got="one that `flightdepth run` replaces"
        )


def check_depth(flight: FlightFolder) -> None:
    """Refuse a flight no frame of which has depth."""
    if all(row.reason for row in flight.rows):
        raise BadInput(
            f"depth in {flight.folder}",
            expected="a frame with depth",
            got="none",
            mend="frames.csv says why.",
        )


def writer_of(kind: str) -> Callable[[FlightFolder, Path, CloudSettings], tuple[str, str]]:
    """What writes a cloud or a map of that kind, and tells what is in it and in which frame."""
    if kind in HEIGHTS:
        from flightdepth.commands.convert_heights import write_height_map

        return write_height_map
    return write_map if kind == OCCUPANCY else write_cloud


def write_map(flight: FlightFolder, file: Path, settings: CloudSettings) -> tuple[str, str]:
    """The occupancy map of a flight into `file`; how large what it tells is, and in which frame."""
    from flightdepth.outputs.occupancy import bt_bytes, occupancy_of, volumes_m3

    with extra_packages("Writing OctoMaps", "clouds"):
        import octomap  # noqa: F401  before the work, not after it
    with progress_bar("map", -(-len(flight.rows) // settings.every), "frames") as bar:
        tree = occupancy_of(flight, settings, bar.step)
    occupied_m3, free_m3 = volumes_m3(tree)
    if not occupied_m3 + free_m3:
        raise BadInput(f"depth in {flight.folder}", expected="space that is known", got="none", mend=WIDER)
    write_atomic(file, bt_bytes(tree))
    return f"{occupied_m3:,.0f} m3 occupied and {free_m3:,.0f} m3 free", local_frame(flight)


def write_cloud(flight: FlightFolder, file: Path, settings: CloudSettings) -> tuple[str, str]:
    """The cloud of a flight into `file`; how many points it has, and in which frame."""
    from flightdepth.outputs.cloud_files import write_las, write_ply

    as_ply = file.suffix.lower() == ".ply"
    if not as_ply:
        with extra_packages("Writing LAS", "clouds"):
            import laspy  # noqa: F401  before the work, not after it
            import pyproj  # noqa: F401
    cloud = some_cloud(flight, settings)
    points = f"{len(cloud):,} points"
    if as_ply:
        write_ply(file, cloud)
        return points, local_frame(flight)
    cloud, crs, frame = on_earth(flight, cloud)
    write_las(file, cloud, crs)
    return points, frame


def some_cloud(flight: FlightFolder, settings: CloudSettings) -> Cloud:
    """The cloud of a flight, under a bar; one without a point is refused."""
    from flightdepth.outputs.cloud import cloud_of

    with progress_bar("cloud", -(-len(flight.rows) // settings.every), "frames") as bar:
        cloud = cloud_of(flight, settings, bar.step)
    if not len(cloud):
        raise BadInput(f"depth in {flight.folder}", expected="points that count", got="none", mend=WIDER)
    return cloud


def local_frame(flight: FlightFolder) -> str:
    """The axes of what is not on Earth, and which of them the log does not tell."""
    from flightdepth.outputs.cloud import placed

    if any(pose.attitude == "assumed" for pose in placed(flight).values()):
        return f"{LOCAL}; north and up are only assumed, since the log tells no attitude"
    if not flight.record.source.true_north:
        return f"{LOCAL}; north may be any direction"
    return LOCAL


def on_earth(flight: FlightFolder, cloud: Cloud) -> tuple[Cloud, Any, str]:
    """A cloud in UTM and its CRS where that can be, else as it is and None; which frame it is."""
    from flightdepth.outputs.cloud import placed
    from flightdepth.outputs.georeference import LocalOnlyError, georeference

    source = flight.record.source
    try:
        found = georeference(placed(flight).values(), true_north=source.true_north)
    except LocalOnlyError as why:
        return cloud, None, f"{LOCAL}, not in UTM: {why}"
    if not found.follows:
        warn(STRAYS)
    return found.in_utm(cloud), found.crs, found.described(source.altitude_above)


def universal_time(flight: FlightFolder) -> UniversalTime:
    """That of a flight whose log tells it."""
    if (told := flight.record.source.utc) is None:
        mend = "Without --utc stamps count from the video's first picture."
        raise BadInput("--utc", expected="a flight whose log tells universal time", got="none", mend=mend)
    return told


def write_recording(flight: FlightFolder, file: Path, utc: UniversalTime | None) -> int:
    """The flight as MCAP into `file`; how many frames. `utc` makes stamps count from 1970."""
    from flightdepth.outputs.mcap_file import write_mcap

    with (
        extra_packages("Writing ROS recordings", "ros"),
        progress_bar("recording", len(flight.rows), "frames") as bar,
    ):
        return write_mcap(file, flight, bar.step, utc=utc)
