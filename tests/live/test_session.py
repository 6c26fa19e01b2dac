"""What `flightdepth live` puts together; nothing is opened."""

import os
import re
import shutil
import signal
import socket
import subprocess
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from live_peers import Autopilot, free_port, live_command, until

from flightdepth.commands import live_session
from flightdepth.commands.demo import LOG, VIDEO
from flightdepth.commands.live_report import missing, summary
from flightdepth.commands.live_session import NOMINAL_SIZE, Session
from flightdepth.commands.live_settings import LiveSettings
from flightdepth.commands.live_sources import doubt_of_obstacles, recorded
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight import Frame, flight_log, open_flight
from flightdepth.flight.camera_evidence import CameraEvidence
from flightdepth.flight.lenses import known_lenses
from flightdepth.flight.records import ViewTrack
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.live.depth_stage import Lens
from flightdepth.live.obstacle_messages import COMPONENT, ObstaclePacker, in_tlog
from flightdepth.live.obstacles import ObstacleSettings
from flightdepth.live.status import FrameCounts, Health, LiveStatus, SinkCounts, State
from flightdepth.live.video_address import video_address
from flightdepth.outputs import FlightFolder, read_depth
from flightdepth.outputs.frame_table import rows_from_csv
from flightdepth.weights.store import find_network, read_card
from tests_logs import tlog_flight


@pytest.fixture
def session(tmp_path, save_difference_network):
    return Session(
        LiveSettings(
            video="rtsp://pilot:secret@127.0.0.1/main",
            mavlink=f"udpin:127.0.0.1:{free_port()}",
            vehicle=None,
            telemetry=None,
            telemetry_offset=0.0,
            camera=None,
            hfov=80.0,
            mask=None,
            mount="fixed",
            mount_pitch=-15.0,
            camera_delay_ms=0.0,
            sender_clock=False,
            network=str(save_difference_network()),
            precision="auto",
            align=True,
            ranges=2,
            out=tmp_path / "out",
            serve=None,
            obstacles=False,
            dry_run=None,
            duration=None,
        )
    )


def test_a_run_begins_with_what_it_takes(session, capsys):
    """A network that was too slow was nowhere named, nor the lens of a stream."""
    Session(session.settings)
    assert capsys.readouterr().out.splitlines() == [
        f"rtsp://127.0.0.1/main -> difference; {session.settings.mavlink}",
        "camera: --hfov 80, an ideal lens",
    ]


def test_a_mask_is_named_and_recorded(session, tmp_path, capsys, monkeypatch):
    shown = np.full((36, 64), 255, np.uint8)
    shown[18:, :16] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), shown)
    masked = Session(replace(session.settings, mask=tmp_path / "mask.png"))
    assert f"mask: {tmp_path / 'mask.png'}, black in 12.5% of the picture" in capsys.readouterr().out
    recorded = []
    monkeypatch.setattr(masked.engine, "add_sink", lambda name, sink: recorded.append(sink))
    with ExitStack() as stack:
        masked._add_sinks(stack)
    assert recorded[0]._mask_digest == masked.mask.digest
    assert recorded[0]._settings["mask"] == str(tmp_path / "mask.png")


def test_what_is_recorded_holds_no_password(session, monkeypatch):
    """flight.json held the address as it was given."""
    recorded = []
    monkeypatch.setattr(session.engine, "add_sink", lambda name, sink: recorded.append(sink))
    with ExitStack() as stack:
        session._add_sinks(stack)
    assert recorded[0]._settings["video"] == "rtsp://127.0.0.1/main"


@pytest.mark.parametrize("option", ["video", "telemetry", "camera"])
def test_a_name_that_is_not_utf_8_is_not_recorded(session, tmp_path, option):
    """Each result failed, at exit code 0."""
    own, odd = {"mavlink": None, "hfov": None}, Path(os.fsdecode(b"h\xf6he"))
    changes = own | {option: str(odd) if option == "video" else odd}
    with pytest.raises(BadInput, match=rf"^--{option} 'h\\udcf6he': expected a name in UTF-8"):
        replace(session.settings, **changes)
    replace(session.settings, **changes, out=None)  # nothing is written down


def test_a_recording_tells_which_log_was_found(session, tmp_path, monkeypatch):
    """Of the one inside the video or beside it flight.json said "None"."""
    shutil.copy(VIDEO, tmp_path / "v.mp4")
    shutil.copy(LOG, tmp_path / "v.csv")
    played = Session(replace(session.settings, mavlink=None, video=str(tmp_path / "v.mp4")))
    made = []
    monkeypatch.setattr(live_session, "Recorder", lambda *given, **_: made.append(given) or SimpleNamespace())
    monkeypatch.setattr(played.engine, "add_sink", lambda name, sink: None)
    played._add_sinks(SimpleNamespace(callback=lambda *end: None))
    assert made[0][2] == played.log.name
    assert made[0][4] == "--hfov 80, an ideal lens"  # it was empty
    assert "v.csv" in played.log.name


def test_obstacle_messages_that_fail_stand_in_the_state(session):
    """They were counted where nobody looked."""
    session.sender = SimpleNamespace(failed=3)
    dropped = session.engine.status().telemetry_dropped
    assert dropped == {"obstacle messages that could not be made or written": 3}


def test_obstacles_are_sought_and_told_by_the_same_settings(session, tmp_path):
    """Each side made its own."""
    feed = Session(replace(session.settings, dry_run=tmp_path / "out.tlog"))._add_obstacles()
    assert feed._packer.settings is feed._obstacles.settings is feed.settings


def test_obstacles_are_told_by_where_the_drone_is_by_then(session, tmp_path):
    """The motion that telemetry tells since the picture."""
    flying = Session(replace(session.settings, dry_run=tmp_path / "out.tlog"))
    assert flying._add_obstacles()._motion_at == flying.store.at


def test_what_stands_still_is_told_once_obstacles_are_known(session, tmp_path):
    flying = Session(replace(session.settings, dry_run=tmp_path / "out.tlog"))
    flying._add_obstacles()
    flying.still.doubt, flying.obstacles.lacking = "something stands still", "obstacles are unknown"
    assert flying._lacking() == "obstacles are unknown"
    flying.obstacles.lacking = None
    assert flying._lacking() == flying.engine._parts.lacking() == "something stands still"


def test_obstacles_may_be_looked_at_alone(session):
    """A name of a log had to be made up for the page's fan."""
    seen = replace(session.settings, mavlink=None, telemetry=LOG, obstacles=True, serve="127.0.0.1:0")
    looking = Session(replace(seen, video=str(VIDEO)))
    with ExitStack() as stack:
        looking._add_sinks(stack)
    assert looking.obstacles is not None and looking.sender is None
    with pytest.raises(BadInput, match="--serve to look at them, got none of them"):
        replace(seen, serve=None)


def test_no_obstacle_message_goes_before_there_is_anybody_to_send_to(session):
    """Each run ended with `1 messages not sent`; over UDP others went to nobody, or as another vehicle's."""

    def heard():
        return {m.get_srcSystem() for m in autopilot.heard if m.get_srcComponent() == COMPONENT}

    port = free_port()
    silent = ["--video", f"rtp://127.0.0.1:{free_port()}", "--hfov", "80"]  # it runs until it is ended
    linked = ["--mavlink", f"udpin:127.0.0.1:{port}", "--obstacles"]
    command = live_command(*silent, *linked, "--network", session.settings.network)
    with (
        Autopilot(port) as autopilot,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        try:
            until(heard, within_s=60)
        finally:
            process.terminate()
        said, _ = process.communicate(timeout=60)
    assert "0 of 0 pictures used" in said
    assert "not sent" not in said
    assert re.search(r"obstacles: [1-9]\d* messages sent", said)
    assert heard() == {7}


def test_one_lost_message_is_told_in_words_that_fit_one(session):
    """It was `1 messages not sent`."""
    session.link, session.feed = SimpleNamespace(counts={"damaged messages": 1}), SimpleNamespace(counts={})
    session.link.instead = lambda: None
    assert "  telemetry: damaged messages (1)" in summary(session.engine.status()).splitlines()


@pytest.mark.parametrize("size", [(320, 240), (1280, 720)])
def test_how_far_obstacles_are_seen_is_that_of_the_pictures_that_come(session, size):
    """It was that of 640x360, whatever the stream showed."""
    camera = session.lens.at(*size)
    assert session._sight(camera).focal_px == pytest.approx(session.network.grid(camera).camera.fx, rel=0.02)


def test_a_recorded_flight_is_played_with_its_own_log(session, tmp_path):
    """As `run` finds it: inside the video, or beside it under its name."""
    shutil.copy(VIDEO, tmp_path / "v.mp4")
    shutil.copy(LOG, tmp_path / "v.csv")
    given = replace(session.settings, mavlink=None, video=str(tmp_path / "v.mp4"), telemetry_offset=0.5)
    own, _ = recorded(given, video_address(given.video))
    told, _ = recorded(replace(given, telemetry=LOG), video_address(given.video))
    assert [each.stamp_ns for each in own.samples] == [each.stamp_ns for each in told.samples]
    assert own.samples[0].stamp_ns == 500_000_000


@pytest.mark.parametrize("hidden_by", ["", "the lens may zoom"])
def test_turns_are_asked_of_the_lens_unless_the_pictures_turn_otherwise(
    session, tmp_path, monkeypatch, hidden_by
):
    assert session.engine._parts.lens is not None  # of a stream nobody can tell
    monkeypatch.setattr(CameraEvidence, "turns_hidden_by", hidden_by)
    shutil.copy(VIDEO, tmp_path / "v.mp4")
    shutil.copy(LOG, tmp_path / "v.csv")
    played = Session(replace(session.settings, mavlink=None, video=str(tmp_path / "v.mp4")))
    assert (played.engine._parts.lens is None) == bool(hidden_by)


def test_a_file_whose_log_tells_a_zoom_is_seen_as_run_does(session, monkeypatch):
    """It was refused without --hfov, and with one the zoom was passed over."""
    view = ViewTrack(np.array([0, 1000, 1100, 10_000]) * 1_000_000, np.array([75.0, 75, 40, 40]))
    zooming = replace(read_telemetry(LOG), view=view)
    monkeypatch.setattr(flight_log, "read_telemetry", lambda path: zooming)
    played = Session(replace(session.settings, mavlink=None, telemetry=LOG, hfov=None, video=str(VIDEO)))
    assert played.engine._parts.lens is None  # its turns tell nothing
    with open_flight(VIDEO, LOG) as flight:
        frames = list(islice((event for event in flight if isinstance(event, Frame)), 27, 36))
    seen = [played.engine._stage.take(played.epoch_ns + frame.stamp_ns, frame.image) for frame in frames]
    assert [staged.camera for staged in seen] == [frame.camera for frame in frames]
    assert seen[-1].camera.horizontal_fov_deg == pytest.approx(40, rel=0.02)


def test_a_stream_needs_a_lens(session):
    with pytest.raises(BadInput, match="--camera and --hfov: expected one of them, got neither"):
        Session(replace(session.settings, hfov=None))


@pytest.mark.parametrize("known", known_lenses(), ids=lambda known: known.name)
def test_every_known_lens_stands_for_a_stream_s_before_its_first_picture(known):
    """Found in review: those of 4:3 or 16:10 were asked for 16:9, and refused before the stream was opened."""
    nominal = Lens.given(Path(known.name), None).nominal(*NOMINAL_SIZE)
    assert nominal.horizontal_fov_deg == pytest.approx(known.horizontal_fov_deg, rel=1e-6)


def test_a_stream_through_a_lens_of_4_to_3_is_opened(session):
    opened = Session(replace(session.settings, hfov=None, camera=Path("raspberry-pi-2")))
    assert opened.lens.at(640, 480).horizontal_fov_deg == pytest.approx(62.2, abs=0.5)


def test_a_stream_without_a_picture_is_named_without_its_password(session, monkeypatch):
    """Found in review: the last line had the address as it was given."""
    monkeypatch.setattr(session.engine, "run", lambda stop, duration_s: None)
    with pytest.raises(FlightDepthError, match=r"^video rtsp://127\.0\.0\.1/main: no picture came$"):
        session.run()


def test_an_older_dry_run_stays_where_the_page_cannot_be_served(session, tmp_path):
    """Found in review: it was emptied before the page's port was tried."""
    older = in_tlog(1, ObstaclePacker(ObstacleSettings()).heartbeat(usable=True))
    (tmp_path / "old.tlog").write_bytes(older)
    with socket.create_server(("127.0.0.1", 0)) as busy:
        serve = f"127.0.0.1:{busy.getsockname()[1]}"
        refused = Session(replace(session.settings, dry_run=tmp_path / "old.tlog", serve=serve))
        with ExitStack() as stack, pytest.raises(BadInput, match=r"--serve: expected .* a free port"):
            refused._add_sinks(stack)
    assert (tmp_path / "old.tlog").read_bytes() == older


@pytest.mark.parametrize(("begun", "said"), [(True, "recording: out\n"), (False, "")])
def test_where_a_recording_stands_is_told(session, begun, said, capsys):
    """Found in use: at its end nothing named it."""
    flown = Session(replace(session.settings, out=Path("out")))
    capsys.readouterr()
    flown._end_recording(SimpleNamespace(close=lambda dropped: (), begun=begun))
    assert capsys.readouterr().out == said


@pytest.mark.parametrize(("host", "said"), [("127.0.0.1", False), ("0.0.0.0", True)])
def test_a_page_for_everybody_is_told(session, host, said, capsys):
    served = Session(replace(session.settings, out=None, serve=f"{host}:0"))
    with ExitStack() as stack:
        served._add_sinks(stack)
    page = capsys.readouterr().out.splitlines()[-1]
    assert page.startswith("page: http://127.0.0.1:")
    assert page.endswith("whoever reaches it can look") == said


def test_a_recording_that_was_killed_is_kept_by_the_next(session, tmp_path, capsys):
    """Found in review: the next start removed it without a word, and nobody can fly it again."""
    flown = ["--video", str(VIDEO), "--telemetry", str(LOG), "--hfov", "75", "--out", str(tmp_path / "out")]
    command = live_command(*flown, "--network", session.settings.network)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until(lambda: len(list(tmp_path.glob(".out.*/depth/*.png"))) > 20, within_s=60)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    (tmp_path / "out.interrupted-1").mkdir()  # of an earlier day
    with ExitStack() as stack:
        session._add_sinks(stack)
    kept = tmp_path / "out.interrupted-2"
    assert f"an earlier recording was interrupted: what was written of it stands in {kept}" in " ".join(
        capsys.readouterr().err.split()
    )
    rows = rows_from_csv((kept / "frames.csv").read_text())
    assert len(rows) >= 20
    assert all(read_depth(kept / "depth" / f"{row.index:06d}.png").ndim == 2 for row in rows)
    flight = FlightFolder(kept)
    assert not flight.record.whole
    assert len(flight.rows) >= len(rows) - 1  # `view` and `convert` read it; a line may be cut off
    assert not list(tmp_path.glob(".out.*"))


def test_a_log_of_another_time_than_the_video_is_refused(session):
    """It was played without a word, and no picture had a depth."""
    given = replace(session.settings, mavlink=None, telemetry=LOG, video=str(VIDEO), telemetry_offset=1000.0)
    with pytest.raises(BadInput, match=r"expected times within .* of the video, got 1000\.0"):
        recorded(given, video_address(given.video))


@pytest.mark.parametrize("offset_s", [float("nan"), 1e300])
def test_an_offset_that_is_no_time_is_refused(session, offset_s):
    given = replace(
        session.settings, mavlink=None, telemetry=LOG, video=str(VIDEO), telemetry_offset=offset_s
    )
    with pytest.raises(BadInput, match="--telemetry-offset: expected a finite number of seconds, got"):
        recorded(given, video_address(given.video))


def test_a_stream_has_no_log_of_its_own(session):
    stream = replace(session.settings, mavlink=None)
    with pytest.raises(BadInput, match="one of them, for the drone's velocity, got neither"):
        recorded(stream, video_address(stream.video))


def test_a_log_is_not_played_beside_a_stream(session):
    stream = replace(session.settings, mavlink=None, telemetry=LOG)
    with pytest.raises(BadInput, match="--telemetry: expected a video file beside it"):
        recorded(stream, video_address(stream.video))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mount": "gimbal"}, "--mount-pitch: expected --mount fixed beside it, got --mount gimbal"),
        ({"telemetry_offset": 1.0}, "--telemetry-offset: expected a log to move, got --mavlink"),
        ({"hfov": 0.01}, "--hfov: expected 0.1 degrees or more, got 0.01"),
    ],
)
def test_options_that_would_do_nothing_are_refused(session, changes, said):
    with pytest.raises(BadInput, match=said):
        replace(session.settings, **changes)


@pytest.mark.parametrize(
    ("name", "floor"), [("tiny-clamped-256", "22 m"), ("motion-tiny", None), ("depthnet-256", None)]
)
def test_of_a_network_without_near_things_obstacles_are_doubted(name, floor):
    """On the sample flight, with four results a second, it missed 22 of 35 obstacles, and nothing said why."""
    doubt = doubt_of_obstacles(read_card(find_network(name)))
    assert (doubt is None) if floor is None else (f"{name} tells what is nearer than {floor}" in doubt)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"mavlink": "udp:0.0.0.0:14550"},
            "--mavlink: expected udpin:HOST:PORT, .*, got 'udp:0.0.0.0:14550'",
        ),
        ({"serve": "8080"}, "--serve: expected HOST:PORT, .*, got '8080'"),
    ],
)
def test_addresses_that_nobody_can_open_are_refused_before_a_network_is_loaded(session, changes, said):
    """They were refused after it, and after lines that sounded as if the run had begun."""
    with pytest.raises(BadInput, match=said):
        replace(session.settings, **changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sender_clock": True, "video": "udp://127.0.0.1:5600"}, "--sender-clock: expected RTSP or RTP"),
        ({"align": False}, "--no-align: expected a network whose depth is aligned.*, got"),
    ],
)
def test_options_that_would_do_nothing_with_this_stream_or_network_are_refused(session, changes, said):
    with pytest.raises(BadInput, match=said):
        Session(replace(session.settings, **changes))


def test_a_dry_run_replaces_only_its_own_older_log(session, tmp_path):
    """Found in review: `--dry-run flight.tlog` emptied the flight's own log, before anything was read of it."""
    target = tmp_path / "flight.tlog"
    target.write_bytes(tlog_flight())
    with pytest.raises(BadInput, match=r"--dry-run .*expected a new file, .* got another file"):
        replace(session.settings, dry_run=target)
    target.write_bytes(in_tlog(1, ObstaclePacker(ObstacleSettings()).heartbeat(usable=True)))
    assert replace(session.settings, dry_run=target).dry_run == target
    with pytest.raises(BadInput, match="--dry-run: expected a file in an existing folder"):
        replace(session.settings, dry_run=tmp_path / "nowhere" / "a.tlog")


def test_a_sender_of_rtp_reports_its_clock(session):
    for video in ("rtsp://127.0.0.1/main", "rtp://127.0.0.1:5600"):
        assert Session(replace(session.settings, sender_clock=True, video=video)).settings.sender_clock


def test_what_a_busy_disk_missed_stands_in_the_recording():
    """The folder of a run whose disk was too slow looked whole."""
    counts = FrameCounts(9, 8, {"a newer picture came first": 1})
    sinks = {"recorder": SinkCounts(taken=6, missed=2)}
    status = LiveStatus(0, Health(State.OK, None, 0), frames=counts, sinks=sinks)
    assert missing(status) == {"a newer picture came first": 1, "the disk was busy": 2}
