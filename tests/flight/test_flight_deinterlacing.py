"""Interlaced video, as from analogue cameras: whole pictures come out, as many and at the same times."""

from collections import Counter

import av
import numpy as np

from flightdepth.flight.deinterlacing import Deinterlacer, deinterlaced
from flightdepth.flight.video import Video
from flightdepth.live.sound_decoder import SoundDecoder

COUNT = 20


def moved(steps):
    """A bright square that moves 8 px a step over a dark ground."""
    image = np.full((120, 320, 3), 40, np.uint8)
    left = 20 + round(8 * steps)
    image[30:90, left : left + 40] = 220
    return image


def interlaced_clip(path, x264="bff=1"):
    """H.264 whose even lines were taken half a picture later than the odd ones; `x264` says so, or not."""
    with av.open(str(path), "w") as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": x264}
        stream = container.add_stream("libx264", rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 320, 120, "yuv420p"
        stream.codec_context.gop_size = 8
        for i in range(COUNT):
            image = moved(i)
            image[::2] = moved(i + 0.5)[::2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def decoded(path):
    with av.open(str(path)) as container:
        return list(container.decode(container.streams.video[0]))


def comb(picture):
    """How much lines differ from those beside them."""
    grey = np.asarray(picture[..., 1], float)
    return np.abs(grey[1:-1] - (grey[:-2] + grey[2:]) / 2).mean()


def test_an_interlaced_video_gives_whole_pictures_at_the_same_times(tmp_path):
    """It was taken for a progressive one, combs and all."""
    path = interlaced_clip(tmp_path / "v.mp4")
    torn = decoded(path)[5].to_ndarray(format="rgb24")
    with Video(path) as video:
        frames = list(video.frames())
        assert not video.counts
    assert [frame.stamp_ns for frame in frames] == [i * 40_000_000 for i in range(COUNT)]
    assert comb(frames[5].image) < comb(torn) / 4


def test_the_lines_of_the_first_field_stay(tmp_path):
    path = interlaced_clip(tmp_path / "v.mp4")
    with Video(path) as video:
        image = list(video.frames())[5].image.astype(int)
    first, second = (np.abs(image - moved(steps)).mean() for steps in (5, 5.5))
    assert first < second / 2


def test_a_progressive_video_goes_through_as_it_is(tmp_path):
    path = interlaced_clip(tmp_path / "v.mp4", "")
    pictures = decoded(path)
    deinterlacer = Deinterlacer()
    assert [ready for picture in pictures for ready in deinterlacer.add(picture)] == pictures
    assert not list(deinterlacer.flush())


def test_what_is_said_of_a_picture_stays_beside_it(tmp_path):
    """Also across pictures of another size, where the filter begins anew."""
    pictures = decoded(interlaced_clip(tmp_path / "v.mp4"))
    small = [picture.reformat(width=160) for picture in pictures[10:]]
    said = [(picture, i in (3, 10, 19)) for i, picture in enumerate(pictures[:10] + small)]
    found = [(ready.width, ready.pts, flag) for ready, flag in deinterlaced(said)]
    assert found == [(picture.width, picture.pts, flag) for picture, flag in said]


def test_live_each_picture_comes_with_the_next_and_the_last_with_the_end(tmp_path):
    path = interlaced_clip(tmp_path / "v.mp4")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        decoder = SoundDecoder(stream.codec_context, Counter())
        came = [[ready.pts for ready in decoder.decode(packet)] for packet in container.demux(stream)]
    assert list(map(len, came)) == [0, *[1] * (COUNT - 1), 1]
    assert [pts for ready in came for pts in ready] == [picture.pts for picture in decoded(path)]


def test_live_a_picture_does_not_wait_for_the_key_frame_after_damage(tmp_path):
    """It came out with it, as old as the gap."""
    with av.open(str(interlaced_clip(tmp_path / "v.mp4"))) as container:
        stream = container.streams.video[0]
        decoder = SoundDecoder(stream.codec_context, Counter())
        packets = list(container.demux(stream))
        for packet in packets[:3]:
            before = [ready.pts for ready in decoder.decode(packet)]
        decoder.damage(packets[4].pts)
        assert [ready.pts for ready in decoder.decode(packets[5])] == [packets[2].pts] != before
