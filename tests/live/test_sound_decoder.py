"""Which pictures of a stream count after damage."""

from collections import Counter
from fractions import Fraction

import av
import numpy as np
import pytest

from flightdepth.live.sound_decoder import SoundDecoder

TICKS_PER_S = 90_000
LONG = 600 * TICKS_PER_S  # ten minutes


def packets():
    """Two seconds of H.264, each 20th picture a key frame."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 96, 64, "yuv420p"
    encoder.time_base, encoder.options = Fraction(1, 25), {"g": "20", "bf": "0", "tune": "zerolatency"}
    for index in range(50):
        frame = av.VideoFrame.from_ndarray(np.full((64, 96, 3), 4 * index, np.uint8), format="rgb24")
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
