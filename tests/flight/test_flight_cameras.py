"""Which camera a video gets: from real files with the tags, settings and logs that cameras write."""

import json
import math
from dataclasses import asdict
from fractions import Fraction

import av
import numpy as np
import pytest
from flight_files import make_video, turn_video
from gopro_files import POLY, gopro_video, settings
from photograph_files import photograph

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight import AttitudeSample, Frame, VelocitySample, open_flight
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.records import Telemetry, ViewTrack
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.video import Video
from tests_recordings import cues, mavic_3, parrot_json

SIZE = (192, 108)


def choose(path, given=None, hfov_deg=None, log=None, **part):
    with Video(path, **part) as video:
        return choose_camera(video, given, hfov_deg, log)


def video(tmp_path, **tags):
    """192x108 with container tags, written by FFmpeg."""
    path = tmp_path / "v.mp4"
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(path), "w", options=options) as container:
        container.metadata.update(tags)
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for _ in range(10):
            image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


# GoPro


def test_a_gopro_without_stabilisation_brings_its_calibration(tmp_path):
    chosen = choose(gopro_video(tmp_path / "v.mp4", settings(mode="W", poly=POLY)))
    assert chosen.camera.model == "fisheye"
    assert (chosen.camera.width, chosen.camera.height) == SIZE
    assert "calibration of the HERO11 Black in its own file" in chosen.source
    assert chosen.warnings == ()


def test_a_gopro_whose_mode_is_in_the_table(tmp_path):
    chosen = choose(gopro_video(tmp_path / "v.mp4", settings("HERO10 Black", "L")))
    assert chosen.camera.fx == pytest.approx(0.4768 * 192)
    assert "92.7 degrees, within 2%" in chosen.source


def test_hypersmooth_takes_the_cropped_view_and_warns(tmp_path):
    chosen = choose(gopro_video(tmp_path / "v.mp4", settings("HERO10 Black", "L", "Y", "HS EIS", poly=POLY)))
    assert chosen.camera.horizontal_fov_deg == pytest.approx(87.5)
    (warning,) = chosen.warnings
    assert "electronic stabilisation (GoPro HS EIS)" in warning


@pytest.mark.parametrize(
    ("told", "likely"),
    [
        (settings("HERO10 Black", "S"), "which does not settle it"),
        (settings("HERO10 Black", "L", zoom=2), "gopro-hero11-linear "),
        (settings("HERO7 Black", "L", "Y", "Y"), "--camera gopro-hero5-linear"),
        (settings("HERO10 Black", "L", None, None), "92.7 degrees"),
    ],
    ids=["superview", "zoomed", "unknown crop", "unknown stabilisation"],
)
def test_what_a_gopro_leaves_open_is_asked_with_likely_values(tmp_path, told, likely):
    with pytest.raises(BadInput, match="expected a focal length") as refusal:
        choose(gopro_video(tmp_path / "v.mp4", told))
    assert likely in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("told", "warned"),
    [
        (settings("HERO10 Black", "S"), "mode S of the HERO10 Black stretches the picture"),
        (settings("HERO10 Black", "L", zoom=2), "the HERO10 Black zoomed digitally"),
    ],
)
def test_what_a_figure_cannot_mend_is_warned_of(tmp_path, told, warned):
    (warning,) = choose(gopro_video(tmp_path / "v.mp4", told), hfov_deg=60).warnings
    assert warned in warning


def test_a_figure_that_contradicts_the_file_is_warned_of(tmp_path):
    path = gopro_video(tmp_path / "v.mp4", settings("HERO10 Black", "L"))
    (warning,) = choose(path, hfov_deg=64.4).warnings
    share = 0.5 / math.tan(math.radians(64.4 / 2)) / 0.4768
    assert f"{share:.2f} times" in warning
    assert choose(path, hfov_deg=92).warnings == ()


# Other makers


def test_the_focal_length_of_dji_subtitles_is_proposed_not_taken(tmp_path):
    log = tmp_path / "log.srt"
    log.write_text(cues((3.0, -4.0, 0.5), mavic_3))
    with pytest.raises(BadInput, match=r"--hfov 71\.6 if the video is as wide as the sensor"):
        choose(video(tmp_path), log=read_telemetry(log))


def test_digital_zoom_narrows_the_proposal(tmp_path):
    log = tmp_path / "log.srt"
    text = cues((3.0, -4.0, 0.5), mavic_3)
    log.write_text(text.replace("[focal_len: 24.00]", "[focal_len : 240] [dzoom_ratio: 20000, delta:0]"))
    view = read_telemetry(log).view
    assert view.nominal
    assert math.tan(math.radians(view.horizontal_deg[0] / 2)) == pytest.approx(0.8 * 21.633 / 48, rel=1e-4)


@pytest.mark.parametrize("nominal", [True, False])
@pytest.mark.parametrize(("last_deg", "warned"), [(40.0, True), (70.0, False)])
def test_a_zoom_that_the_log_tells_is_not_passed_over(tmp_path, nominal, last_deg, warned):
    """The lens given is one of those through which it flew, and nobody says which."""
    view = ViewTrack(np.array([0, 10**8]), np.array([70.0, last_deg]), nominal=nominal)
    log = Telemetry("log", (VelocitySample(0, [1, 0, 0]),), view=view)
    chosen = choose(video(tmp_path), hfov_deg=70.0, log=log)
    assert any("zooms by 1.92" in line for line in chosen.warnings) == warned


def test_tags_of_a_known_drone_propose_its_entry(tmp_path):
    with pytest.raises(BadInput, match=r"--camera dji-mini-2 \(.*71\.6 degrees\)"):
        choose(video(tmp_path, encoder="DJI Mini 2", model="FC7303"))


def test_tags_of_a_telephone_propose_its_focal_length_and_warn(tmp_path):
    key = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
    path = video(tmp_path, **{"com.apple.quicktime.make": "Apple", key: "26.00mm"})
    with pytest.raises(BadInput, match=r"--hfov 67\.3 .*26 mm in its tags"):
        choose(path)
    assert "Apple" in choose(path, hfov_deg=67).warnings[0]


def test_a_file_that_says_nothing(tmp_path):
    with pytest.raises(BadInput, match=r"got none\. Give --hfov DEGREES"):
        choose(video(tmp_path))


# Parrot: a field of view for each picture


def parrot_log(tmp_path, fovs_deg, *, protobuf=False):
    told = json.loads(parrot_json((3.0, 0.0, 0.0), rows=len(fovs_deg), protobuf=protobuf))
    for row, fov_deg in zip(told["frame"], fovs_deg, strict=True):
        metadata = row["metadata"]
        (metadata["camera"] if protobuf else metadata).update(
            {"hfov": fov_deg} if protobuf else {"picture_hfov": fov_deg}
        )
        row["time"] = row["time"] // 33_333 * 40_000
    path = tmp_path / "log.json"
    path.write_text(json.dumps(told))
    return path


@pytest.mark.parametrize("protobuf", [False, True])
def test_a_log_that_tells_the_view_gives_the_camera(tmp_path, protobuf):
    log = parrot_log(tmp_path, [69.0] * 10, protobuf=protobuf)
    chosen = choose(video(tmp_path), log=read_telemetry(log))
    assert chosen.camera == Camera.from_fov(*SIZE, 69.0)
    assert chosen.views is None
    assert "69.0 degrees, from the log" in chosen.source


def test_a_lens_that_zooms_gives_each_picture_its_camera(tmp_path):
    log = parrot_log(tmp_path, [69.0] * 6 + [40.0] * 4)
    with open_flight(video(tmp_path), log) as flight:
        frames = [event for event in flight if isinstance(event, Frame)]
    focals = [frame.camera.fx for frame in frames]
    wide, narrow = (Camera.from_fov(*SIZE, deg).fx for deg in (69.0, 40.0))
    assert focals[:6] == pytest.approx([wide] * 6, rel=0.011)
    assert focals[6:] == pytest.approx([narrow] * 4, rel=0.011)
    assert len(set(focals)) == 2
    assert "40.0 to 69.0 degrees here" in flight.camera_source


def test_only_the_chosen_part_of_the_flight_counts(tmp_path):
    log = read_telemetry(parrot_log(tmp_path, [69.0] * 6 + [40.0] * 4))
    assert choose(video(tmp_path), log=log, end_s=0.2).views is None


# What the user gives


def test_a_name_of_the_table(tmp_path):
    chosen = choose(video(tmp_path), "dji-mini-2")
    assert chosen.camera.horizontal_fov_deg == pytest.approx(71.6, abs=0.05)
    assert "within 10%" in chosen.source


def test_a_photograph_by_the_same_camera(tmp_path):
    chosen = choose(video(tmp_path), photograph(tmp_path / "p.jpg", 24))
    # 16:9, so 0.8716 of the diagonal: 2 atan(0.8716 * 21.633 / 24).
    assert chosen.camera.horizontal_fov_deg == pytest.approx(76.3, abs=0.1)
    assert "FC7303: 24 mm" in chosen.source


def test_a_photograph_of_another_shape_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"got one for 160x120.*cropped"):
        choose(video(tmp_path), photograph(tmp_path / "p.jpg", 24, size=(160, 120)))


def test_a_photograph_without_a_focal_length_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no FocalLengthIn35mmFilm"):
        choose(video(tmp_path), photograph(tmp_path / "p.jpg", None))


def test_a_broken_photograph_is_refused(tmp_path):
    path = tmp_path / "p.jpg"
    path.write_bytes(b"\xff\xd8\xff" + bytes(range(256)))
    with pytest.raises(BadInput, match=r"photograph|read as one"):
        choose(video(tmp_path), path)


def test_a_wide_angle_through_an_ideal_lens_is_warned_of(tmp_path):
    path = video(tmp_path)
    assert "fisheyes" in choose(path, hfov_deg=118.2).warnings[0]
    assert choose(path, hfov_deg=100).warnings == ()
    assert choose(path, "gopro-hero5-wide").warnings == ()


# Pictures held sideways, and pixels that are not square


def test_a_portrait_video_takes_the_sensors_calibration_turned(tmp_path):
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40], width=192, height=108))
    calibration = tmp_path / "c.json"
    camera = Camera(1920, 1080, 1000.0, 1100.0, 900.0, 600.0, (0.1, 0.0, 0.01, 0.02))
    calibration.write_text(json.dumps(asdict(camera)))
    chosen = choose(path, calibration).camera
    assert (chosen.width, chosen.height) == (108, 192)
    turns = 3  # clockwise in the file is three quarter turns the other way
    assert chosen == camera.resized(192, 108).turned(turns)


def test_a_portrait_video_may_have_its_own_calibration(tmp_path):
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40], width=192, height=108))
    assert choose(path, Camera.from_fov(1080, 1920, 50)).camera == Camera.from_fov(1080, 1920, 50).resized(
        108, 192
    )
    assert choose(path, hfov_deg=50).camera == Camera.from_fov(108, 192, 50)


@pytest.mark.parametrize(("hfov_deg", "told"), [(1.047, ["1.047 radians were 60"]), (5.0, [])])
def test_a_field_of_view_in_radians_is_doubted(tmp_path, hfov_deg, told):
    warnings = choose(video(tmp_path), hfov_deg=hfov_deg).warnings
    assert [line.split("(")[1].split(")")[0] for line in warnings if "--hfov" in line] == told


def test_a_field_of_view_of_nothing_is_refused(tmp_path):
    """It ended in a traceback of LAPACK's."""
    with pytest.raises(BadInput, match=r"^--hfov: expected 0.1 degrees or more, got 1e-09$"):
        choose(video(tmp_path), hfov_deg=1e-9)


def test_a_folder_of_a_lens_s_name_hides_it_not(tmp_path, monkeypatch):
    path = video(tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dji-mini-2").mkdir()
    assert choose(path, "dji-mini-2").source.startswith("dji-mini-2 in the table of lenses")


def test_the_table_counts_along_the_sensor_of_a_portrait_video(tmp_path):
    path = turn_video(make_video(tmp_path / "v.mp4", [0, 40], width=192, height=108))
    chosen = choose(path, "dji-mini-2").camera
    assert (chosen.width, chosen.height) == (108, 192)
    assert 2 * math.degrees(math.atan(96 / chosen.fy)) == pytest.approx(71.6, abs=0.05)


def test_the_view_proposed_for_a_portrait_video_is_across_its_upright_pictures(tmp_path):
    """It was the one across the sensor's long side, which --hfov took for the short one: depths half as far."""
    key = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
    with pytest.raises(BadInput, match=r"--hfov 41\.1 .*26 mm in its tags"):
        choose(turn_video(video(tmp_path, **{key: "26"})))
    view = ViewTrack(np.zeros(1, np.int64), np.array([67.3]), nominal=True)
    log = Telemetry("log", (VelocitySample(0, np.ones(3)),), view=view)
    with pytest.raises(BadInput, match=r"--hfov 41\.1 .*focal length in the log"):
        choose(turn_video(video(tmp_path)), log=log)


def anamorphic(tmp_path):
    """Pictures of 144x108 px whose pixels are 4/3 as wide as high, so 16:9."""
    path = tmp_path / "v.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 144, 108, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        for _ in range(3):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(np.zeros((108, 144, 3), np.uint8), "rgb24"))
            )
        container.mux(stream.encode(None))
    return path


def test_pixels_that_are_not_square(tmp_path):
    camera = choose(anamorphic(tmp_path), hfov_deg=90).camera
    assert camera.fx == pytest.approx(72)
    assert camera.fy == pytest.approx(96)  # a pixel is 4/3 as wide as high, so more of them lie in the height


def test_a_calibration_of_stored_or_of_shown_pixels_fits_pixels_that_are_not_square(tmp_path):
    """One of the size that players show was refused."""
    path = anamorphic(tmp_path)
    shown = Camera(1920, 1080, 1600, 1600, 959.5, 539.5)
    stored = shown.resized(1440, 1080)
    assert choose(path, shown).camera == choose(path, stored).camera == shown.resized(144, 108)


def test_a_lens_of_the_table_and_a_photograph_have_square_pixels(tmp_path):
    path = anamorphic(tmp_path)
    wide = photograph(tmp_path / "wide.jpg", 26)
    for given, focal_over_width in (("dji-mini-2", 0.5 / math.tan(math.radians(71.6) / 2)), (wide, None)):
        camera = choose(path, given).camera
        assert (camera.width, camera.height) == (144, 108)
        assert camera.fy == pytest.approx(camera.fx * 4 / 3)
        assert focal_over_width is None or camera.fx == pytest.approx(144 * focal_over_width, rel=1e-3)
    with pytest.raises(BadInput, match="192x108 or its shape"):
        choose(path, photograph(tmp_path / "high.jpg", 26, size=(192, 144)))  # the shape of 144x108


def test_fields_of_view_of_a_log_hold_for_pixels_that_are_not_square(tmp_path):
    view = ViewTrack(np.zeros(1, np.int64), np.array([90.0]))
    log = Telemetry("log", (VelocitySample(0, np.ones(3)),), view=view)
    camera = choose(anamorphic(tmp_path), log=log).camera
    assert (camera.fx, camera.fy) == pytest.approx((72, 96))


# A camera that is screwed to the drone


def body_log(tmp_path):
    told = json.loads(parrot_json((3.0, 0.0, 0.0)))
    for row in told["frame"]:
        row["metadata"]["frame_quat"] = dict.fromkeys("wxyz", 0.0)  # no gimbal
    path = tmp_path / "log.json"
    path.write_text(json.dumps(told))
    return path


def test_the_drones_attitude_is_used_where_the_user_says_how_the_camera_is_mounted(tmp_path):
    log = body_log(tmp_path)
    with open_flight(video(tmp_path), log, hfov_deg=60, mount_pitch_deg=-90) as flight:
        turned = [event for event in flight if isinstance(event, AttitudeSample)]
        assert flight.warnings == ()
    # Looks down, with ahead (north) up in the picture: right is east, forward of the camera down.
    w, x, y, z = turned[0].world_from_camera
    forward = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    assert forward == pytest.approx((0, 0, 1), abs=1e-12)


def test_without_that_the_user_is_told_of_it(tmp_path):
    with open_flight(video(tmp_path), body_log(tmp_path), hfov_deg=60) as flight:
        assert any(isinstance(event, VelocitySample) for event in flight)
        assert "--mount-pitch 0" in flight.warnings[0]


@pytest.mark.parametrize(
    ("pitch", "said"), [(120, "-90"), (float("nan"), "-90"), (0, "attitude of the drone")]
)
def test_a_mount_that_cannot_be(tmp_path, pitch, said):
    log = tmp_path / "log.csv"
    log.write_text("time_s,vn_m_s,ve_m_s,vd_m_s\n0,1,0,0\n1,1,0,0\n")
    with pytest.raises(BadInput, match=said):
        open_flight(video(tmp_path), log, hfov_deg=60, mount_pitch_deg=pitch)
