"""A GStreamer RTSP server of one MP4 file; run by the system's Python, which has `gi`.

    /usr/bin/python3 rtsp_server.py VIDEO PORT [--loss SHARE]

It prints "ready" once it listens. `--loss` drops that share of the RTP packets before they are sent.
"""

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402


class Served(GstRtspServer.RTSPMediaFactory):
    """The file's own H.264 packets, in real time, for all clients at once."""

    def __init__(self, video, loss):
        super().__init__()
        self.video, self.loss = video, loss

    def do_create_element(self, url):
        pay = "rtph264pay pt=96"
        # The last element is what the server sends from: here it drops RTP packets on their way.
        last = f"{pay} ! identity drop-probability={self.loss} name=pay0" if self.loss else f"{pay} name=pay0"
        return Gst.parse_launch(
            f"filesrc location={self.video} ! qtdemux ! h264parse config-interval=-1 !"
            f" video/x-h264,stream-format=byte-stream,alignment=au ! identity sync=true ! {last}"
        )


def main():
    video, port = sys.argv[1:3]
    loss = float(sys.argv[sys.argv.index("--loss") + 1]) if "--loss" in sys.argv else 0.0
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = Served(video, loss)
    factory.set_shared(True)
    server.get_mount_points().add_factory("/flight", factory)
    server.attach(None)
    print("ready", flush=True)
    GLib.MainLoop().run()


main()
