"""`flightdepth convert` to a COLMAP project: a folder, where its other kinds are files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from flightdepth.commands.convert import NO_PLACE, UNFILMED, check_depth, local_frame, some_cloud
from flightdepth.commands.terminal import progress_bar, say, warn
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, folder_in_progress, names_in

if TYPE_CHECKING:
    from flightdepth.outputs import FlightFolder
    from flightdepth.outputs.cloud import CloudSettings
    from flightdepth.outputs.palette import Picture

NO_POINT = "they show no point of the cloud, most often since they have no depth (frames.csv)"
SMALL = "pictures are the preview's, {has} of {full}: --video VIDEO takes the video's own"


def check_project(target: Path) -> None:
    """Refuse, before the work, a folder that holds anything but an older project, or cannot be made or replaced."""
    from flightdepth.outputs.colmap import NOTE, OWN_NAMES

    what, place = f"folder {target}", target.resolve()
    if not target.is_dir():
        check_parent("DIR.colmap", target)
        if target.exists():
            raise BadInput(what, expected="a folder", got="a file")
        return
    check_parent("DIR.colmap", place.parent / f"{place.name}.new")
    if os.path.ismount(place) or Path.cwd().is_relative_to(place):
        got = "a mount point" if os.path.ismount(place) else "where you are"
        raise BadInput(what, expected="a folder that can be replaced", got=got)
    names = names_in(target)
    if foreign := names - OWN_NAMES if NOTE in names else names:
        raise BadInput(
            what,
            expected="a new folder, an empty one or an older one of the same that flightdepth wrote",
            got=f"one that holds {min(foreign)}",
        )


def write_project(
    flight: FlightFolder, target: Path, settings: CloudSettings, *, every: int | None, video: Path | None
) -> None:
    """The flight into `target`, and what stands there.

    every  n-th frame has its picture in it; the cloud takes at least as many frames as that of a file does
    video  where pictures are taken from, instead of the preview
    """
    from flightdepth.outputs.cloud import CloudSettings, placed
    from flightdepth.outputs.colmap import every_picture, write_colmap

    check_depth(flight)
    poses = placed(flight)
    step = every or every_picture(len(flight.rows))
    shots = shots_of(flight, step, video)
    settings = replace(settings, every=min(step, CloudSettings.every))
    cloud = some_cloud(flight, settings)
    wanted, came = len(flight.rows[::step]), Counter[bool]()  # by whether their place is known

    def counted() -> Iterator[tuple[int, Picture]]:
        for index, picture in shots:
            came[index in poses] += 1
            yield index, picture

    with (
        progress_bar("pictures", wanted, "pictures") as bar,
        folder_in_progress(target.resolve()) as folder,  # a link stays, and what it leads to is written
    ):
        images = write_colmap(folder, flight, cloud, counted(), settings=settings, on_picture=bar.step)
        if not images:
            raise BadInput(
                f"pictures of {flight.folder}",
                expected="one that shows a point of the cloud",
                got="none",
                mend="Try a smaller --every.",
            )
    size = images[0].camera.width, images[0].camera.height
    told = f"{len(images):,} pictures of {times(size)} px and {len(cloud):,} points"
    say(f"{target}: {told} from {flight.folder}, {local_frame(flight)}")
    full = flight.record.source.camera.width, flight.record.source.camera.height
    if size != full:
        say(SMALL.format(has=times(size), full=times(full)))
    missing = {NO_PLACE: came[False], NO_POINT: came[True] - len(images), UNFILMED: wanted - came.total()}
    for why, count in missing.items():
        if count:
            warn(f"{count:,} of {wanted:,} pictures are not in it: {why}")


def shots_of(flight: FlightFolder, every: int, video: Path | None) -> Iterator[tuple[int, Picture]]:
    """Index and picture of each n-th frame; the first is looked for at once, before other work."""
    from flightdepth.outputs.pictures import layout_of, pictures
    from flightdepth.outputs.video_pictures import video_pictures

    if video is not None:
        shots = video_pictures(flight, video, every)
    else:
        layout, camera = layout_of(flight), flight.record.source.camera
        small = layout.width < camera.width
        shots = pictures(flight, every, (layout.width, layout.height) if small else None)
    first = next(shots, None)
    return shots if first is None else chain([first], shots)


def times(size: tuple[int, int]) -> str:
    """A width and a height, as people write them."""
    return "x".join(map(str, size))
