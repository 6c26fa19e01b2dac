"""Which of a video's own tracks tells its flight."""

import shutil
from pathlib import Path

import pytest
from dji_messages import header, picture
from flight_files import add_gpmf, lned_payload, make_video

from flightdepth.errors import BadInput
from flightdepth.flight.flight_log import own_telemetry
from flightdepth.flight.inside import read_inside

SUBTITLED = Path(__file__).parent / "dji" / "phantom_4_rtk.mp4"
MEND = "Give --telemetry LOG or --speed M_S."


@pytest.fixture
def subtitled(tmp_path):
    return Path(shutil.copy(SUBTITLED, tmp_path / "DJI_0001.MP4"))


def with_metadata(video, *, fixed):
    places = [(48 + index * 1e-5, 11.0) if fixed else None for index in range(60)]
    packets = [picture(index + 1, place) for index, place in enumerate(places)]
    packets[0] = header(b"Mini4_Pro") + packets[0]
    return add_gpmf(video, packets, duration_ms=500, kind="djmd")


def test_a_video_without_a_track_tells_nothing(tmp_path):
    assert read_inside(make_video(tmp_path / "v.mp4", range(0, 400, 40))) is None


def test_a_folder_tells_nothing(tmp_path):
    assert read_inside(tmp_path) is None


def test_metadata_which_tells_the_gimbal_goes_before_subtitles(subtitled):
    assert read_inside(with_metadata(subtitled, fixed=True)).name.startswith("DJI metadata in the video")


def test_subtitles_go_before_metadata_without_a_fix(subtitled):
    assert read_inside(with_metadata(subtitled, fixed=False)).name.startswith("DJI subtitles in the video")


def test_a_gopros_track_goes_first(subtitled):
    payloads = [lned_payload([(1000 * k + 250 * part, 7.0, 0, 0) for part in range(4)]) for k in range(5)]
    assert read_inside(add_gpmf(subtitled, payloads)).name.startswith("GPMF")


def test_metadata_alone_without_a_fix_is_said_to_be_so(tmp_path):
    video = with_metadata(make_video(tmp_path / "v.mp4", range(0, 400, 40)), fixed=False)
    with pytest.raises(BadInput, match=r"Mini4_Pro.*60 pictures, too few with a position"):
        read_inside(video)


def test_a_log_beside_the_video_is_taken_where_its_metadata_has_no_fix(tmp_path):
    video = with_metadata(make_video(tmp_path / "DJI_0001.MP4", range(0, 400, 40)), fixed=False)
    shutil.copy(SUBTITLED.with_suffix(".SRT"), tmp_path / "DJI_0001.SRT")
    log, inside = own_telemetry(video, mend=MEND)
    assert "DJI subtitles DJI_0001.SRT" in log.name
    assert not inside


def test_subtitles_of_another_kind_tell_nothing(tmp_path, subtitled):
    """Of a film: they say no position."""
    spoilt = subtitled.read_bytes()
    for word in (b"GPS", b"G.PRY"):
        spoilt = spoilt.replace(word, b"said"[: len(word)].ljust(len(word), b"."))
    subtitled.write_bytes(spoilt)
    assert read_inside(subtitled) is None
