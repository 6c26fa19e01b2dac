"""Videos that are refreshed strip by strip, with no key frame after the first, and copies that lack a part."""

from fractions import Fraction

import av
import numpy as np

CYCLE = 20  # pictures from refresh to refresh
WIDTH, HEIGHT, RATE_HZ = 96, 64, 25
H264 = {"preset": "ultrafast", "bf": "0", "x264-params": f"intra-refresh=1:keyint={CYCLE}"}
# What x265 does unless it is told otherwise takes damage over into what is refreshed.
CLEAN = "no-temporal-mvp=1:no-deblock=1:no-sao=1:constrained-intra=1:ref=1"
H265 = {
    "preset": "ultrafast",
    "x265-params": f"log-level=none:bframes=0:intra-refresh=1:keyint={CYCLE}:{CLEAN}",
}
ENCODERS = {"libx264": H264, "libx265": H265}
H265_TAKES = 2 * CYCLE  # pictures until x265's refresh leaves nothing, measured


def film(path, count, codec="libx264", encoder=None):
    """`count` pictures of a texture that slides; of H.265 with the messages that x265 leaves out."""
    texture = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH + count, 3), np.uint8)
    unmarked = path.with_stem(f"{path.stem}-unmarked") if codec == "libx265" and encoder is None else path
    with av.open(str(unmarked), "w") as container:
        stream = container.add_stream(codec, rate=RATE_HZ, options=encoder or ENCODERS[codec])
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for index in range(count):
            image = np.ascontiguousarray(texture[:, index : index + WIDTH])
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = index, Fraction(1, RATE_HZ)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path if unmarked == path else copied(unmarked, path, marked)


def marked(number, data):
    """A packet of an MP4 with a recovery point where a refresh begins (H.265, D.2.8), as hardware encoders write it."""
    if number % CYCLE or not number:
        return data
    coded = 2 * H265_TAKES  # of se(v): a positive number
    bits = (
        f"{coded:b}".rjust(2 * coded.bit_length() - 1, "0") + "10" + "1"
    )  # exact, no broken link, and the end
    message = int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")
    unit = bytes([39 << 1, 1, 6, len(message)]) + message + b"\x80"
    return len(unit).to_bytes(4, "big") + unit + data


def copied(path, copy, changed):
    """A copy whose packet number n holds what `changed(n, its bytes)` gives; it is missing where that is None."""
    with av.open(str(path)) as source, av.open(str(copy), "w") as target:
        stream = source.streams.video[0]
        written = target.add_stream_from_template(stream)
        for number, packet in enumerate(each for each in source.demux(stream) if each.size):
            data = changed(number, bytes(packet))
            if data is None:
                continue
            new = av.Packet(data)
            new.pts, new.dts, new.time_base, new.duration = (
                packet.pts,
                packet.dts,
                packet.time_base,
                packet.duration,
            )
            new.is_keyframe, new.stream = packet.is_keyframe, written
            target.mux(new)
    return copy


def overwritten(*numbers):
    """Change packets of an MP4, all but the head of their first unit."""
    return lambda number, data: data[:12] + bytes(len(data) - 12) if number in numbers else data


def missing(*numbers):
    return lambda number, data: None if number in numbers else data
