"""Flights with known velocities as GPX, in the layouts of programs that write it; the values are made up."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np

from tests_recordings import place

START = datetime(2026, 5, 1, 9, 30, 0, tzinfo=UTC)


def points(velocity, *, seconds=12.0, rate=1.0, start=START):
    """Time, latitude, longitude and elevation of a straight flight from 50 m."""
    north, east, down = velocity
    for at_s in np.arange(round(seconds * rate)) / rate:
        latitude, longitude = place(north * at_s, east * at_s)
        yield start + timedelta(seconds=float(at_s)), latitude, longitude, 50 - down * at_s


def gopro2gpx(flown):
    """GPX 1.1 with CR LF, an element that is none of GPX's, and Garmin's extensions."""
    rows = [
        f'\t<trkpt lat="{latitude:.7f}" lon="{longitude:.7f}">\r\n\t\t<fourcc_type>GPS5</fourcc_type>\r\n'
        f"\t\t<ele>{height:.3f}</ele>\r\n\t\t<time>{time:%Y-%m-%dT%H:%M:%S.%fZ}</time>\r\n\t\t<extensions>\r\n"
        "\t\t<gpxtpx:TrackPointExtension>\r\n\t\t    <gpxtpx:hr>0</gpxtpx:hr>\r\n"
        "\t\t    <gpxtpx:speed>0.25</gpxtpx:speed>\r\n\t\t   </gpxtpx:TrackPointExtension>\r\n"
        "\t\t<gpxx:TrackPointExtension/>\r\n\t\t</extensions>\r\n\t</trkpt>\r\n"
        for time, latitude, longitude, height in flown
    ]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\r\n<gpx xmlns="http://www.topografix.com/GPX/1/1" '
        'xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2" creator="Garmin Desktop App" '
        f'version="1.1">\r\n<metadata>\r\n  <time>{START:%Y-%m-%dT%H:%M:%S.%fZ}</time>\r\n</metadata>\r\n'
        f"<trk>\r\n  <name>exercise</name>\r\n<trkseg>\r\n{''.join(rows)}</trkseg>\r\n</trk>\r\n</gpx>\r\n"
    )


def exiftool(flown):
    """GPX 1.0, by ExifTool's gpx.fmt: no line end after the last mark."""
    rows = [
        f'<trkpt lat="{latitude:.7f}" lon="{longitude:.7f}">\n  <ele>{height:.3f}</ele>\n'
        f"  <time>{time:%Y-%m-%dT%H:%M:%S}.{time.microsecond // 10_000:02d}Z</time>\n</trkpt>\n"
        for time, latitude, longitude, height in flown
    ]
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<gpx version="1.0"\n creator="ExifTool 12.60"\n'
        ' xmlns="http://www.topografix.com/GPX/1/0">\n<trk>\n<number>1</number>\n<trkseg>\n'
        f"{''.join(rows)}</trkseg>\n</trk>\n</gpx>"
    )


def gpx_recorder(flown):
    """An Android app's: GPX 1.0, a point a line, local times with their zone, many digits."""
    zone = timezone(timedelta(hours=1))
    rows = [
        f'\t\t<trkpt lat="{latitude}" lon="{longitude}"><ele>{height}</ele>'
        f"<time>{time.astimezone(zone).isoformat(timespec='milliseconds')}</time></trkpt>\n"
        for time, latitude, longitude, height in flown
    ]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.0" creator="GPX Recorder"\n'
        'xmlns="http://www.topografix.com/GPX/1/0">\n\t<name>GPX</name>\n\t<trk><name>Track</name>'
        f"<number>1</number><trkseg>\n{''.join(rows)}\t</trkseg></trk>\n</gpx>\n"
    )


def prefixed(flown):
    """Every mark with its namespace, single quotes, longitude first, as XML allows."""
    rows = [
        f"<g:trkpt lon='{longitude:.7f}' lat='{latitude:.7f}'><g:ele>{height:.2f}</g:ele><x:time>noon</x:time>"
        f"<g:time>{time.isoformat()}</g:time></g:trkpt>\n"
        for time, latitude, longitude, height in flown
    ]
    return (
        "<!-- by hand -->\n<g:gpx xmlns:g='http://www.topografix.com/GPX/1/1' xmlns:x='urn:x' version='1.1'>"
        f"<g:trk><g:trkseg>\n{''.join(rows)}</g:trkseg></g:trk></g:gpx>\n"
    )


GPX_LAYOUTS = {
    "gopro2gpx": gopro2gpx,
    "ExifTool": exiftool,
    "GPX Recorder": gpx_recorder,
    "prefixed": prefixed,
}
