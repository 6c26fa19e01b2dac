"""Which pictures of a stream count after damage."""

from collections import Counter
from fractions import Fraction

import av
import numpy as np
import pytest

from flightdepth.live.sound_decoder import SoundDecoder
from tests_refresh import CYCLE, H265_TAKES, film, missing, overwritten

TICKS_PER_S = 90_000
LONG = 600 * TICKS_PER_S  # ten minutes


def packets(count=50, moving=False, **options):
    """H.264 at 25 pictures a second, each 20th a key frame unless `options` of the encoder tell otherwise."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 96, 64, "yuv420p"
    encoder.time_base = Fraction(1, 25)
    encoder.options = {"g": "20", "bf": "0", "tune": "zerolatency"} | options
    texture = np.random.default_rng(0).integers(0, 256, (64, 96 + count, 3), np.uint8)
    for index in range(count):
        image = texture[:, index : index + 96] if moving else np.full((64, 96, 3), 4 * index, np.uint8)
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame.pts = index
        yield from encoder.encode(frame)
    yield from encoder.encode(None)


@pytest.mark.parametrize("began_again", [-LONG, 0, LONG])
def test_after_damage_a_key_frame_counts_wherever_its_stamps_begin(began_again):
    """A sender that starts again counts from 0 again."""
    decoder, shown = SoundDecoder(av.CodecContext.create("h264", "r"), Counter()), []
    for number, packet in enumerate(packets()):
        packet.pts = packet.dts = LONG + number * 3600 + (began_again if number >= 20 else 0)
        packet.time_base = Fraction(1, TICKS_PER_S)
        if number == 15:
            decoder.damage(packet.pts)
        shown += [number for _ in decoder.decode(packet)]
    assert [number for number in shown if 15 <= number < 20] == []
    assert len([number for number in shown if number < 15]) >= 13
    assert len([number for number in shown if number >= 20]) >= 28


@pytest.mark.parametrize("told", [True, False])
def test_after_packets_that_were_left_out_all_counts_from_the_next_key_frame_on(told):
    """Whether or not the container tells which packets are key frames: MPEG-TS does not."""
    counts = Counter()
    decoder, shown = SoundDecoder(av.CodecContext.create("h264", "r"), counts), []
    for number, packet in enumerate(packets()):
        if number == 15:
            decoder.skip_to_key_frame()
        if not told:
            packet.is_keyframe = False
        if not 10 <= number < 15:
            shown += [number for _ in decoder.decode(packet)]
    assert [number for number in shown if number >= 10] == list(range(20, 50))
    assert not counts  # neither decoded nor damaged


LOST = (15, 22)
REFRESHED = {
    "x264-params": "intra-refresh=1:keyint=20"
}  # a strip in each picture, no key frame but the first


def grey_pictures(decoder, packets):
    """Grey levels [H, W] by stamp."""
    return {each.pts: each.to_ndarray(format="gray") for packet in packets for each in decoder.decode(packet)}


def refreshed_pictures(tamper):
    """What comes of a stream that is refreshed strip by strip: `tamper` gives what it does to packet number n.

    All that comes is compared with what the sender's packets hold.
    """
    decoder = SoundDecoder(av.CodecContext.create("h264", "r"), Counter())
    sent = list(packets(count=120, moving=True, **REFRESHED))
    whole = grey_pictures(av.CodecContext.create("h264", "r"), [*sent, None])
    shown = grey_pictures(decoder, (packet for packet in sent if tamper(decoder, packet)))
    for stamp, picture in shown.items():
        assert np.array_equal(picture, whole[stamp])
    return sorted(shown)


def test_a_stream_without_key_frames_that_is_joined_in_its_middle_is_shown_once_it_is_refreshed():
    """Found in review: no picture ever came, since none was a key frame."""
    shown = refreshed_pictures(lambda decoder, packet: packet.pts >= 25)
    assert shown == list(range(shown[0], 120))
    assert 40 < shown[0] < 60  # a refresh begins at 40, and takes less than 20 pictures


@pytest.mark.parametrize("told", [True, False], ids=["told", "found by the decoder"])
def test_a_stream_without_key_frames_is_shown_again_once_it_is_refreshed_after_damage(told):
    """The second loss falls into the refresh that began at 20."""

    def lose(decoder, packet):
        if packet.pts in LOST and told:
            decoder.damage(packet.pts)
        if packet.pts in LOST and not told:
            packet.is_corrupt = True
        return packet.pts not in LOST or not told

    shown = refreshed_pictures(lose)
    again = next(stamp for stamp in shown if stamp > 15)
    assert shown == [*range(15), *range(again, 120)]
    assert 40 < again < 60


def test_a_stream_without_key_frames_goes_on_after_packets_that_were_left_out():
    def leave_out(decoder, packet):
        if packet.pts == 15:
            decoder.skip_to_key_frame()
        return not 10 <= packet.pts < 15

    shown = refreshed_pictures(leave_out)
    assert shown[:10] == list(range(10))
    assert shown[10:] == list(range(shown[10], 120))


# What is missing within a refresh of H.265 its decoder does not tell; RTP and MPEG-TS do.
@pytest.mark.parametrize(
    ("codec", "takes", "damage"),
    [("libx264", CYCLE, overwritten), ("libx264", CYCLE, missing), ("libx265", H265_TAKES, overwritten)],
)
def test_no_refresh_counts_that_is_damaged_itself(tmp_path, codec, takes, damage):
    """Pictures of H.264 were not whole, since its decoder kept the damaged ones to itself; of H.265 none came."""
    changed, counts = damage(CYCLE + 5, 2 * CYCLE + 3), Counter()
    with av.open(str(film(tmp_path / "v.mp4", 130, codec))) as container:
        stream = container.streams.video[0]
        sent = [packet for packet in container.demux(stream) if packet.size]
        contexts = [av.CodecContext.create(stream.codec_context.name, "r") for _ in range(2)]
        for context in contexts:
            context.extradata = stream.codec_context.extradata
    ticks = sent[1].pts
    whole = grey_pictures(contexts[0], [*sent, None])
    decoder = SoundDecoder(contexts[1], counts)
    shown = {}
    for number, packet in enumerate(sent):
        if (data := changed(number, bytes(packet))) is not None:
            received = av.Packet(data)
            received.pts, received.dts, received.time_base = packet.pts, packet.dts, packet.time_base
            shown |= grey_pictures(decoder, [received])
    assert all(np.array_equal(picture, whole[stamp]) for stamp, picture in shown.items())
    numbers = [stamp // ticks for stamp in shown]
    again = next(number for number in numbers if number > CYCLE + 5)
    assert numbers == [*range(CYCLE + 5), *range(again, 130)]
    assert 3 * CYCLE < again <= 3 * CYCLE + takes


def test_leading_pictures_that_lack_theirs_do_not_take_the_key_frame_with_them():
    """Of an open group: they come after its key frame, are shown before it, and lean on the group before."""
    open_groups = {
        "x264-params": "open-gop=1:keyint=20:bframes=2:b-adapt=0:scenecut=0:rc-lookahead=5",
        "tune": "film",
    }
    sent = list(packets(count=100, moving=True, **open_groups))
    decoder = SoundDecoder(av.CodecContext.create("h264", "r"), Counter())
    shown = sorted(grey_pictures(decoder, sent[8:]))
    assert 10 < shown[0] < 45
