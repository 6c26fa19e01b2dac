"""FFmpeg's log goes through Python only while RTP is heard, and of that thread alone."""

import subprocess
import sys
import threading

import av
import av.logging
import numpy as np

from flightdepth.live.video_stream import losses_told

FREED = """
import sys

import av

from flightdepth.live.video_stream import losses_told

with losses_told():
    pass
for _ in range(30):
    with av.open(sys.argv[1], format="h264") as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_type, stream.codec_context.thread_count = "FRAME", 4
        for packet in container.demux(stream):
            try:
                stream.codec_context.decode(packet)
            except av.error.FFmpegError:
                pass
            if packet.pts is None:
                break
print("done")
"""


def test_the_log_goes_through_python_only_meanwhile():
    with losses_told(), losses_told():
        assert av.logging.get_level() == av.logging.WARNING
    assert av.logging.get_level() is None


def test_another_threads_warnings_are_not_told():
    with losses_told() as told:
        other = threading.Thread(
            target=av.logging.log, args=(av.logging.WARNING, "rtp", "RTP: missed 1 packets")
        )
        other.start()
        other.join()
        assert told == []
        av.logging.log(av.logging.WARNING, "rtp", "RTP: missed 2 packets")
    assert told == [(av.logging.WARNING, "rtp", "RTP: missed 2 packets")]


def test_a_codec_whose_threads_complain_can_be_freed_afterwards(tmp_path):
    """With its log still going through Python it waits forever, for the thread that waits for the interpreter."""
    film = tmp_path / "damaged.h264"
    noise = np.random.default_rng(0)
    with av.open(str(film), "w", format="h264") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for _ in range(6):
            picture = noise.integers(0, 256, (240, 320, 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(stream.encode(None))
    data = bytearray(film.read_bytes())
    data[5000::97] = bytes(len(data[5000::97]))
    film.write_bytes(data)
    command = [sys.executable, "-c", FREED, str(film)]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert shown.stdout == "done\n"
