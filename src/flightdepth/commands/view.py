"""`flightdepth view`: a flight's depth in the Rerun viewer."""

from __future__ import annotations

import os
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flightdepth.commands.convert import check_outside, opened
from flightdepth.commands.extras import extra_packages
from flightdepth.commands.full_disk import NOT_WRITTEN, room_on_the_disk
from flightdepth.commands.terminal import progress_bar, say
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.files import check_parent, refuse_to_replace, write_atomic

if TYPE_CHECKING:
    from rerun import RecordingStream

    from flightdepth.outputs import FlightFolder

WEB_PORT, DATA_PORT = 9090, 9876
# What the server holds for browsers that come later; beyond it the earliest frames are dropped without a word. By
# itself it holds 1 GiB, and 500 frames of 4K take more than half as much again.
HELD = "75%"  # of the computer's memory
NO_DISPLAY = "could not open a window ({error}); try `flightdepth view {folder} --web`, or --save FILE.rrd"


def view(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What `flightdepth run` wrote.")],
    *,
    web: Annotated[bool, typer.Option("--web", help="Serve the viewer to a browser, until Ctrl-C.")] = False,
    port: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=65535, help=f"Port of the page, with --web; {WEB_PORT}."),
    ] = None,
    data_port: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            max=65535,
            help=f"Port that the page has its data from, with --web; {DATA_PORT}.",
        ),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Write a recording for `rerun FILE.rrd` instead.")
    ] = None,
    pictures: Annotated[
        int, typer.Option(metavar="N", min=1, help="Show at most so many frames' pictures, evenly spread.")
    ] = 500,
) -> None:
    r"""Look at a flight: video, depth with metres under the cursor, confidence, graphs, and the cloud in 3D.

    In the viewer's window, in a browser (as on a machine without a screen), or
    as a file for later:

      flightdepth view out

      flightdepth view out --web

      flightdepth view out --save flight.rrd

    Needs the extra `view`: pip install 'flightdepth\[view]'.
    """
    if web and save is not None:
        raise BadInput("--web and --save", expected="one of them", got="both")
    if not web and (port, data_port) != (None, None):
        raise BadInput("--port and --data-port", expected="--web beside them", got="none")
    with extra_packages("flightdepth view", "view"):
        import rerun
    flight = opened(folder)
    name = folder.absolute().name
    plain = re.sub(r"[^\w -]", "-", name, flags=re.ASCII)  # as Rerun does, with a warning
    recording = rerun.RecordingStream(f"flightdepth {plain}")
    recording.send_recording_name(name)
    if save is not None:
        write(recording, flight, save, pictures)
    elif web:
        serve(recording, flight, pictures, port or WEB_PORT, data_port or DATA_PORT)
    else:
        open_window(recording, flight, pictures)


def write(recording: RecordingStream, flight: FlightFolder, file: Path, pictures: int) -> None:
    """Write a recording; a half-written one is removed."""
    import rerun

    check_parent("--save", file)
    if file.suffix != ".rrd":
        raise BadInput("--save", expected="a file that ends in .rrd", got=str(file))
    check_outside(flight.folder, file)
    refuse_to_replace("--save", file)
    stream = rerun.binary_stream(recording)
    send(recording, flight, pictures)
    with room_on_the_disk(file, left=NOT_WRITTEN):
        write_atomic(file, stream.read(flush=True) or b"")
    say(f"{file}: open it with `rerun {file}`")


def serve(recording: RecordingStream, flight: FlightFolder, pictures: int, port: int, data_port: int) -> None:
    """Serve the viewer and the flight until Ctrl-C."""
    import rerun

    try:
        source = rerun.serve_grpc(grpc_port=data_port, recording=recording, server_memory_limit=HELD)
        recording.flush()  # raises where another has the port: the server finds that out in a thread of its own
        rerun.serve_web_viewer(web_port=port, open_browser=False, connect_to=source)
    except (RuntimeError, OSError) as error:
        raise FlightDepthError(f"could not serve on ports {port} and {data_port}: {error}") from error
    send(recording, flight, pictures)
    address = f"http://localhost:{port}/?url={source.replace('127.0.0.1', 'localhost')}"
    say(f"open {address} (Ctrl-C ends it)")
    while True:
        time.sleep(3600)


def open_window(recording: RecordingStream, flight: FlightFolder, pictures: int) -> None:
    """The viewer's own window, which stays when this ends."""
    import rerun

    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise FlightDepthError(NO_DISPLAY.format(error="no screen", folder=flight.folder))
    try:
        rerun.spawn(recording=recording)
    except (RuntimeError, OSError) as error:
        raise FlightDepthError(NO_DISPLAY.format(error=error, folder=flight.folder)) from error
    send(recording, flight, pictures)


def send(recording: RecordingStream, flight: FlightFolder, pictures: int) -> None:
    """Everything of the flight, with a progress bar."""
    from flightdepth.outputs.viewer import every_nth, show

    try:
        with progress_bar("viewer", -(-len(flight.rows) // every_nth(flight, pictures)), "frames") as bar:
            show(recording, flight, most_pictures=pictures, on_picture=bar.step)
    finally:
        recording.flush()  # after an error too: Rerun never ends where a stream goes that still holds something
