import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace

from flightdepth.errors import BadInput
from flightdepth.outputs.film import Film
from tests_browser import chromium


def write(path, stamps_ns, width=64, height=48):
    film = Film(path, width, height)
    for i, stamp_ns in enumerate(stamps_ns):
        film.add(stamp_ns, np.full((height, width, 3), (200, 40 + 10 * i % 200, 30), np.uint8))
    film.close()
    with av.open(str(path)) as container:
        return [(picture.time, picture.to_ndarray(format="rgb24")) for picture in container.decode(video=0)]


def test_pictures_keep_their_times(tmp_path):
    stamps_ns = [0, 33_366_667, 66_733_333, 500_000_000, 533_366_667]
    times = [time for time, _ in write(tmp_path / "film.mp4", stamps_ns)]
    assert times == pytest.approx([ns * 1e-9 for ns in stamps_ns], abs=1 / 90_000)


@pytest.mark.parametrize("first_s", [5, 36_000])
def test_a_film_of_a_part_begins_with_its_first_picture(tmp_path, first_s):
    """Of `--start 5`: a film whose first picture came at 5 s would show nothing until then."""
    stamps_ns = [first_s * 10**9 + ns for ns in (0, 33_366_667, 500_000_000)]
    path = tmp_path / "film.mp4"
    assert [time for time, _ in write(path, stamps_ns)] == pytest.approx([0, 0.0333667, 0.5], abs=2 / 90_000)
    with av.open(str(path)) as container:
        assert container.start_time == 0
        assert container.duration < 1e6


@pytest.mark.parametrize("count", [1, 11, 12, 61])
def test_every_picture_is_there_and_in_time_wherever_a_piece_of_a_second_ends(tmp_path, count):
    times = [time for time, _ in write(tmp_path / "film.mp4", [100_000_000 * i for i in range(count)])]
    assert times == pytest.approx([0.1 * i for i in range(count)], abs=1 / 90_000)


def test_colours_come_back(tmp_path):
    pictures = write(tmp_path / "film.mp4", [0, 40_000_000])
    assert np.abs(pictures[1][1].mean(axis=(0, 1)) - (200, 50, 30)).max() < 5


def test_two_pictures_at_nearly_one_time_are_both_kept(tmp_path):
    assert len(write(tmp_path / "film.mp4", [0, 1_000, 2_000, 40_000_000])) == 4


def test_it_is_h264_that_browsers_play(tmp_path):
    write(tmp_path / "film.mp4", [0, 40_000_000])
    with av.open(str(tmp_path / "film.mp4")) as container:
        codec = container.streams.video[0].codec_context
        assert (codec.name, codec.pix_fmt) == ("h264", "yuv420p")


def test_it_tells_players_how_its_colours_were_made(tmp_path):
    """Found in review: it told nothing, and of large pictures mpv and VLC then take them for those of BT.709."""
    write(tmp_path / "film.mp4", [0, 40_000_000])
    with av.open(str(tmp_path / "film.mp4")) as container:
        picture = next(container.decode(video=0))
    assert (picture.colorspace, picture.color_range) == (Colorspace.ITU601, ColorRange.MPEG)


def test_an_odd_size_is_refused(tmp_path):
    with pytest.raises(BadInput, match="even"):
        Film(tmp_path / "film.mp4", 63, 48)


def test_a_picture_of_another_size_is_refused(tmp_path):
    film = Film(tmp_path / "film.mp4", 64, 48)
    with pytest.raises(BadInput, match="film picture"):
        film.add(0, np.zeros((48, 62, 3), np.uint8))
    film.abandon()


@pytest.mark.slow
def test_a_browser_plays_it_and_finds_a_time_in_it(tmp_path):
    write(tmp_path / "film.mp4", [100_000_000 * i for i in range(61)])
    (tmp_path / "page.html").write_text('<video src="film.mp4" muted></video>')
    with chromium() as browser:
        tab = browser.new_page()
        tab.goto((tmp_path / "page.html").as_uri())
        tab.evaluate("film = document.querySelector('video'); film.onseeked = () => found = film.currentTime")
        tab.wait_for_function("film.readyState === 4")
        assert tab.evaluate("film.duration") == pytest.approx(6.1, abs=0.1)
        tab.evaluate("film.currentTime = 4.05")
        tab.wait_for_function("window.found === 4.05")
