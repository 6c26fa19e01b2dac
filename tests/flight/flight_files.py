"""Small flight files for tests: videos through PyAV, GPMF bytes, and a GPMF track put into an MP4 by hand."""

import struct
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

PIXELS = {"png": "rgb24", "qtrle": "rgb24", "cfhd": "yuv422p10le"}  # of what takes no yuv420p
IDENTITY = (0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)


def make_video(
    path: Path,
    stamps_ms,
    *,
    width=96,
    height=64,
    codec="libx264",
    colour=lambda index: index,
    options=None,
    stream_options=None,
    rate=None,
):
    """One plain picture for each time; its grey value is `colour(index)`."""
    with av.open(str(path), "w", options=options or {}) as container:
        stream = container.add_stream(codec, rate=rate or 30, options=stream_options or {})
        stream.width, stream.height = width, height
        stream.pix_fmt = PIXELS.get(codec, "yuv420p")
        stream.codec_context.time_base = Fraction(1, rate or 1000)
        for index, stamp in enumerate(stamps_ms):
            image = np.full((height, width, 3), colour(index), np.uint8)
            image[: height // 4, : width // 4] = 250  # a mark in the top left corner
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = stamp * (rate or 1000) // 1000, stream.codec_context.time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def make_sound(path: Path):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate, frame.pts = 48000, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def klv(key: str, kind: str, size: int, repeat: int, data: bytes) -> bytes:
    return struct.pack(">4sBBH", key.encode(), ord(kind), size, repeat) + data + bytes(-len(data) % 4)


def nest(key: str, *parts: bytes) -> bytes:
    data = b"".join(parts)
    return klv(key, "\0", 1, len(data), data)


def lned_payload(rows, *, clock=True) -> bytes:
    """A Karma payload: rows of (own time ms, velocity north, east, down), or of time, position (3), velocity."""
    layout, unit, scale = ("L", ["s"], [1000]) if clock else ("", [], [])
    layout, unit, scale = layout + "ffffff", [*unit, *["m"] * 3, *["m/s"] * 3], [*scale, *[1] * 6]
    packed = [
        (struct.pack(">L", ms) if clock else b"") + struct.pack(">6f", *[0.0] * (6 - len(told)), *told)
        for ms, *told in rows
    ]
    return nest(
        "DEVC",
        klv("DVID", "L", 4, 1, b"\0\0\0\1"),
        klv("DVNM", "c", 1, 5, b"Karma"),
        nest(
            "STRM",
            klv("STNM", "c", 1, 18, b"Local Position NED"),
            klv("UNIT", "c", 3, len(unit), b"".join(u.encode().ljust(3, b"\0") for u in unit)),
            klv("TYPE", "c", 1, len(layout), layout.encode()),
            klv("SCAL", "l", 4, len(scale), struct.pack(f">{len(scale)}l", *scale)),
            klv("LNED", "?", 4 * len(layout), len(rows), b"".join(packed)),
        ),
    )


def gyro_payload(rates, scale=1000) -> bytes:
    raw = np.round(np.asarray(rates) * scale).astype(">i2")
    return nest(
        "DEVC",
        klv("DVNM", "c", 1, 6, b"Camera"),
        nest(
            "STRM",
            klv("SCAL", "s", 2, 1, struct.pack(">h", scale)),
            klv("GYRO", "s", 6, len(raw), raw.tobytes()),
        ),
    )


def gps5_payload(rows, *, fix=3, beside=b"") -> bytes:
    """A HERO5's payload: rows of (latitude, longitude, height, speed over ground, speed in space).

    `beside` is what newer models write there too.
    """
    scale = [10**7, 10**7, 1000, 1000, 100]
    raw = np.round(np.asarray(rows) * scale).astype(">i4")
    return nest(
        "DEVC",
        klv("DVNM", "c", 1, 6, b"Camera"),
        nest(
            "STRM",
            klv("GPSF", "L", 4, 1, struct.pack(">L", fix)),
            beside,
            klv("SCAL", "l", 4, 5, struct.pack(">5l", *scale)),
            klv("GPS5", "l", 20, len(raw), raw.tobytes()),
        ),
    )


def gps9_payload(rows) -> bytes:
    """A HERO11's payload: GPS5's columns, then days since 2000, seconds, dilution of precision, fix."""
    scale = [10**7, 10**7, 1000, 1000, 100, 1, 1000, 100, 1]
    raw = [np.round(np.asarray(row) * scale).astype(int).tolist() for row in rows]
    return nest(
        "DEVC",
        klv("DVNM", "c", 1, 6, b"Camera"),
        nest(
            "STRM",
            klv("TYPE", "c", 1, 9, b"lllllllSS"),
            klv("SCAL", "l", 4, 9, struct.pack(">9l", *scale)),
            klv("GPS9", "?", 32, len(raw), b"".join(struct.pack(">7l2H", *row) for row in raw)),
        ),
    )


def box(kind: str, *parts: bytes) -> bytes:
    data = b"".join(parts)
    return struct.pack(">L4s", len(data) + 8, kind.encode()) + data


def full_box(kind: str, *parts: bytes) -> bytes:
    return box(kind, bytes(4), *parts)


def trimmed(path: Path, out: Path, start_ms: int) -> Path:
    """A lossless cut, as `ffmpeg -ss -c copy` makes it: all from the key frame before on, hidden by an edit list."""
    with av.open(str(path)) as whole, av.open(str(out), "w") as part:
        stream = whole.streams.video[0]
        copied = part.add_stream_from_template(stream)
        later = int(Fraction(start_ms, 1000) / stream.time_base)
        for packet in whole.demux(stream):
            if packet.size:
                packet.pts, packet.dts, packet.stream = packet.pts - later, packet.dts - later, copied
                part.mux(packet)
    return out


def add_gpmf(path: Path, payloads, duration_ms=1000, *, begins_ms=None, kind="gpmd") -> Path:
    """Append a GPMF track to an MP4 whose index is its last box; each payload lasts `duration_ms`.

    `kind`: of a track of other data.

    `begins_ms`: an edit list says that so much of the track lies before the video's start.
    """
    data = path.read_bytes()
    moov = data.rindex(b"moov") - 4
    assert moov + int.from_bytes(data[moov : moov + 4], "big") == len(data)
    shift = len(_trak(payloads, 0, duration_ms, begins_ms, kind))
    trak = _trak(payloads, len(data) + shift + 8, duration_ms, begins_ms, kind)
    path.write_bytes(data[:moov] + box("moov", data[moov + 8 :], trak) + box("mdat", *payloads))
    return path


def _trak(payloads, offset, duration_ms, begins_ms, kind) -> bytes:
    total, count = duration_ms * len(payloads), len(payloads)
    matrix = struct.pack(">9L", *IDENTITY)
    tkhd = full_box("tkhd", struct.pack(">5L", 0, 0, 9, 0, total), bytes(16), matrix, bytes(8))
    mdhd = full_box("mdhd", struct.pack(">4L", 0, 0, 1000, total), bytes(4))
    hdlr = full_box("hdlr", b"mhlrmeta", bytes(12), b"GoPro MET\0")
    dinf = box("dinf", full_box("dref", struct.pack(">L", 1), box("url ", b"\0\0\0\1")))
    stsd = full_box("stsd", struct.pack(">L", 1), box(kind, bytes(6), b"\0\1", bytes(4)))
    stts = full_box("stts", struct.pack(">3L", 1, count, duration_ms))
    stsc = full_box("stsc", struct.pack(">4L", 1, 1, count, 1))
    stsz = full_box("stsz", struct.pack(f">{count + 2}L", 0, count, *map(len, payloads)))
    stco = full_box("stco", struct.pack(">2L", 1, offset))
    stbl = box("stbl", stsd, stts, stsc, stsz, stco)
    elst = full_box("elst", struct.pack(">4L", 1, total, begins_ms or 0, 0x10000))
    edits = [] if begins_ms is None else [box("edts", elst)]
    return box("trak", tkhd, *edits, box("mdia", mdhd, hdlr, box("minf", full_box("nmhd"), dinf, stbl)))


CLOCKWISE = (0, 1, -1, 0)


def turn_video(path: Path, shown=CLOCKWISE) -> Path:
    """Say in the MP4 how its pictures are to be shown: a point (x, y) at (a x + c y, b x + d y), y down."""
    a, b, c, d = (0x10000 * value for value in shown)
    data = path.read_bytes()
    at = data.index(struct.pack(">9L", *IDENTITY), data.index(b"tkhd"))
    matrix = struct.pack(">9l", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    path.write_bytes(data[:at] + matrix + data[at + 36 :])
    return path
