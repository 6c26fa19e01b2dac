"""Where `flightdepth live` has its log and its camera from, and what does not go together."""

from __future__ import annotations

from pathlib import Path

from flightdepth.commands.live_settings import LiveSettings
from flightdepth.commands.network_options import check_align
from flightdepth.commands.terminal import warn
from flightdepth.errors import BadInput
from flightdepth.flight.camera_evidence import ChosenCamera
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.flight_log import choose_telemetry
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.recordings import doubted_length
from flightdepth.flight.records import Telemetry
from flightdepth.flight.untold import untold
from flightdepth.flight.video import Video
from flightdepth.live.obstacles import Sight
from flightdepth.live.video_address import VideoAddress
from flightdepth.weights.card import NetworkCard


def recorded(
    settings: LiveSettings, address: VideoAddress, mask: PictureMask | None = None
) -> tuple[Telemetry | None, ChosenCamera | None]:
    """The log that is played, and a video file's camera as `flightdepth run` chooses it; a stream tells neither."""
    if not address.paced:
        refuse_log_of_stream(settings, address)
        return None, None
    given, offset_s = settings.telemetry, settings.telemetry_offset
    with Video(Path(address.target), mask=mask) as video:
        log = None
        if settings.mavlink is None:
            log, _ = choose_telemetry(
                video, given, None, offset_s, mend="Give --telemetry LOG or --mavlink LINK."
            )
        if log is not None:
            for doubt in untold(video, log) + (() if offset_s else doubted_length(log, video.duration_ns)):
                warn(doubt)
        return log, choose_camera(video, settings.camera, settings.hfov, log)


def refuse_log_of_stream(settings: LiveSettings, address: VideoAddress) -> None:
    """A stream's velocity comes from an autopilot."""
    if settings.mavlink is not None:
        return
    if settings.telemetry is not None:
        raise BadInput(
            "--telemetry",
            expected="a video file beside it",
            got=address.name,
            mend="A stream's velocity comes by --mavlink.",
        )
    raise BadInput(
        "--mavlink and --telemetry", expected="one of them, for the drone's velocity", got="neither"
    )


def refuse_idle(settings: LiveSettings, address: VideoAddress, card: NetworkCard) -> None:
    """Refuse options that would do nothing with this stream or network."""
    if settings.sender_clock and not address.reports_wall_clock:
        expected = "RTSP or RTP, whose sender reports its clock"
        raise BadInput("--sender-clock", expected=expected, got=address.name)
    check_align(card, align=settings.align)


def doubt_of_obstacles(card: NetworkCard) -> str | None:
    """What speaks against a network that was trained without near things: it tells them at its nearest depth."""
    if card.depth_min_m == 0:
        return None
    floor_m = Sight.of(card, card.focal_px).least_depth_per_m
    return (
        f"obstacles: {card.name} tells what is nearer than {floor_m:.0f} m for each metre flown between two pictures"
        " as that far: obstacles at hand are missed where results are few. motion-tiny has no such floor."
    )
