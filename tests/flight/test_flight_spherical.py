"""Videos of a whole sphere, marked as Google's two specifications say, and as cameras write them."""

import re
import struct
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from flight_files import box, full_box, make_video

from flightdepth.errors import BadInput
from flightdepth.flight.spherical import INSTA360, refuse_sphere
from flightdepth.flight.video import Video

CAMERAS = Path(__file__).parents[2] / "docs" / "cameras.md"
TRACK = ("moov", "trak")
ENTRY = (*TRACK, "mdia", "minf", "stbl", "stsd", "avc1")
HEADS = {"stsd": 8, "avc1": 78}  # bytes of these before the boxes within
# github.com/google/spatial-media, docs: V1's identifier, V2's boxes.
V1 = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
EQUI = full_box("equi", bytes(16))
CUBE = full_box("cbmp", bytes(8))
MESH_OFF = full_box("equi", struct.pack(">4L", 0, 0, 1 << 30, 1 << 30))  # bounds: the left half


def with_box(path, where, inside):
    """Put a box at the end of one, by the names of those around it, in an MP4 whose index is its last box."""
    data = bytearray(path.read_bytes())
    at, end, heads = 0, len(data), []
    for name in where:
        while data[at + 4 : at + 8] != name.encode():
            at += int.from_bytes(data[at : at + 4], "big")
            assert at < end, name
        heads.append(at)
        end = at + int.from_bytes(data[at : at + 4], "big")
        at += 8 + HEADS.get(name, 0)
    for head in heads:
        size = int.from_bytes(data[head : head + 4], "big") + len(inside)
        data[head : head + 4] = size.to_bytes(4, "big")
    data[end:end] = inside
    path.write_bytes(data)
    return path


def sv3d(projection):
    """Google's Spherical Video V2."""
    source, pose = full_box("svhd", b"a camera\0"), full_box("prhd", bytes(12))
    return box("sv3d", source, box("proj", pose, projection))


def gspherical(projection="equirectangular"):
    """Google's Spherical Video V1, with all that it requires."""
    names = {"Spherical": "true", "Stitched": "true", "StitchingSoftware": "a", "ProjectionType": projection}
    inside = "".join(f"<GSpherical:{name}>{told}</GSpherical:{name}>" for name, told in names.items())
    head = (
        '<?xml version="1.0"?><rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
        'xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/">'
    )
    return box("uuid", V1, f"{head}{inside}</rdf:SphericalVideo>".encode())


def ordinary(tmp_path, **options):
    return make_video(tmp_path / "v.mp4", range(0, 200, 40), **options)


def two_tracks(path, sizes, counts=(5, 5)):
    """Videos beside each other in one file."""
    with av.open(str(path), "w") as container:
        streams = []
        for width, height in sizes:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            streams.append(stream)
        for stream, count in zip(streams, counts, strict=True):
            for index in range(count):
                image = np.full((stream.height, stream.width, 3), 40 * index, np.uint8)
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
                frame.pts, frame.time_base = index, Fraction(1, 25)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    return path


def opens(path):
    with Video(path) as video:
        return len(list(video.frames()))


@pytest.mark.parametrize(
    ("where", "inside", "said"),
    [
        (ENTRY, sv3d(EQUI), "equirectangular"),
        (ENTRY, full_box("st3d", b"\1") + sv3d(EQUI), "equirectangular"),
        (ENTRY, sv3d(MESH_OFF), "a part of an equirectangular picture"),
        (ENTRY, sv3d(CUBE), "a cube map"),
        (TRACK, gspherical(), "equirectangular"),
    ],
    ids=["V2", "V2, stereo", "V2, a half", "V2, a cube", "V1"],
)
def test_a_sphere_that_is_marked_is_refused(tmp_path, where, inside, said):
    """It gave depth that meant nothing, without a word."""
    path = with_box(ordinary(tmp_path, width=128), where, inside)
    with pytest.raises(BadInput) as error:
        opens(path)
    assert f"expected pictures through one lens, got a video of 360 degrees ({said})." in str(error.value)
    assert "Reframe it first" in str(error.value) and "--hfov" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("where", "inside"),
    [
        (ENTRY, full_box("st3d", b"\0")),
        (TRACK, gspherical(projection="rectilinear")),
        (TRACK, box("uuid", bytes(16), b"of something else")),
    ],
    ids=["V2's st3d alone", "V1, flat", "another uuid"],
)
def test_other_marks_are_none(tmp_path, where, inside):
    assert opens(with_box(ordinary(tmp_path, width=128), where, inside)) == 5


@pytest.mark.parametrize(
    ("size", "said"),
    [((192, 64), "half of a cube"), ((136, 44), "half of a cube"), ((64, 64), "a fisheye")],
    ids=["GoPro MAX, 4096x1344", "GoPro MAX, 2272x736", "Insta360, DJI, Antigravity"],
)
def test_two_tracks_of_a_sphere_are_refused(tmp_path, size, said):
    path = two_tracks(tmp_path / "v.mp4", (size, size))
    with pytest.raises(BadInput, match=rf"360 degrees \({said} in each of its two tracks\)"):
        opens(path)


def test_a_preview_beside_the_two_tracks_hides_nothing(tmp_path):
    path = two_tracks(tmp_path / "v.mp4", ((64, 64), (64, 64), (32, 32)), (5, 5, 5))
    with pytest.raises(BadInput, match="a fisheye in each of its two tracks"):
        opens(path)


@pytest.mark.parametrize(
    ("sizes", "counts"),
    [
        (((128, 72), (128, 72)), (5, 5)),
        (((64, 64), (32, 32)), (5, 5)),
        (((192, 64), (192, 64)), (5, 1)),
    ],
    ids=["a stereo pair", "large and small", "a thumbnail"],
)
def test_two_tracks_of_something_else_are_opened(tmp_path, sizes, counts):
    assert opens(two_tracks(tmp_path / "v.mp4", sizes, counts)) == 5


@pytest.mark.parametrize(
    ("width", "height", "sphere"), [(64, 64, True), (128, 64, True), (128, 72, False), (64, 48, False)]
)
def test_what_an_insta360_recorded_is_refused_in_the_shapes_of_fisheyes(tmp_path, width, height, sphere):
    path = ordinary(tmp_path, width=width, height=height)
    assert opens(path) == 5  # without the mark
    with path.open("ab") as file:
        file.write(bytes(40) + INSTA360)
    if sphere:
        with pytest.raises(BadInput, match="as an Insta360 recorded it"):
            opens(path)
    else:
        assert opens(path) == 5


def test_matroskas_projection_is_a_mark(tmp_path):
    """RFC 9559: an element Projection (0x7670), here in the place of one that tells colours."""
    path = tmp_path / "v.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 128, 64, "yuv420p"
        stream.codec_context.color_primaries = stream.codec_context.color_trc = 1
        frame = av.VideoFrame.from_ndarray(np.zeros((64, 128, 3), np.uint8), format="rgb24")
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    assert opens(path) == 1
    data = path.read_bytes()
    at = data.index(b"\x55\xb0")
    size = data[at + 2] & 0x7F
    void = b"\xec" + bytes([0x80 | size - 6]) + bytes(size - 6)
    path.write_bytes(data[:at] + b"\x76\x70\x84\x76\x71\x81\x01" + void + data[at + 3 + size :])
    with pytest.raises(BadInput, match=r"360 degrees \(equirectangular\)"):
        opens(path)


def test_a_view_of_a_sphere_is_an_ordinary_video(tmp_path):
    """By the filters of docs/cameras.md, here by the library behind ffmpeg's command."""
    filters = re.search(r"-vf (\S+)", CAMERAS.read_text("utf-8"))[1]
    sphere = with_box(ordinary(tmp_path, width=128), ENTRY, sv3d(EQUI))
    with av.open(str(sphere)) as whole:
        stream, graph = whole.streams.video[0], av.filter.Graph()
        parts = [graph.add_buffer(template=stream)]
        parts += [graph.add(*each.split("=", 1)) for each in filters.split(",")] + [graph.add("buffersink")]
        graph.link_nodes(*parts).configure()
        graph.push(next(whole.decode(stream)))
        view = graph.pull()
    assert (view.width, view.height) == (1920, 1080)
    refuse_sphere(sphere, no_tracks(), view)


def no_tracks():
    return SimpleNamespace(streams=SimpleNamespace(video=[]))
