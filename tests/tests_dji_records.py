"""Flights with known velocities, written as DJI flight records in the layouts of the programs that decode them.
The columns are those that real files have (fewer of them); the values are made up, rounded as DJI rounds."""

from types import SimpleNamespace

import numpy as np

from tests_recordings import place

FOOT_M, MPH = 0.3048, 0.44704
START_S = 9 * 3600 + 19 * 60 + 31.7  # of the day


def steady(velocity):
    return lambda time_s: np.broadcast_to(velocity, (len(time_s), 3))


def weaving(time_s):
    """North, east, down in m/s: a drone that turns, climbs and never stands."""
    return np.stack([5 + 2 * np.sin(time_s / 3), 4 * np.cos(time_s / 4), np.sin(time_s / 5)], axis=1)


def record(
    velocity_at=weaving,
    *,
    seconds=60.0,
    rate=10.0,
    recordings=((10.0, 40.0),),
    yaw_at=lambda time_s: 20 + 3 * time_s,
    gimbal_pitch=-30.0,
    gimbal_off=0.0,
    start_s=0.0,
):
    """What a drone knows each 1 / rate s: speeds to 0.1 m/s, angles to 0.1 degree, heights to 0.1 m."""
    time_s = np.arange(round(seconds * rate)) / rate
    fine_s = np.arange(round(seconds * rate) * 10) / rate / 10
    ways = np.cumsum(velocity_at(fine_s), axis=0)[::10] / rate / 10
    latitude, longitude = place(ways[:, 0], ways[:, 1])
    yaw = yaw_at(time_s)
    return [
        SimpleNamespace(
            time_s=start_s + time_s[i],
            lat=latitude[i],
            lon=longitude[i],
            height_m=round(50 - ways[i, 2], 1),
            speeds=np.round(velocity_at(time_s)[i], 1) + 0.0,
            yaw=round(float(yaw[i]), 1),
            pitch=-8.5,
            roll=1.5,
            gimbal_yaw=round(float(yaw[i] - gimbal_off), 1),
            gimbal_pitch=gimbal_pitch,
            recording=any(first < time_s[i] < last for first, last in recordings),
        )
        for i in range(len(time_s))
    ]


def signed(degrees):
    return round((degrees + 180) % 360 - 180, 1)


def table(header, rows, separator=",", newline="\n"):
    return newline.join([header, *(separator.join(map(str, row)) for row in rows)]) + newline


def of_day(row):
    """Hours, minutes and seconds of a row's wall clock."""
    hours, rest = divmod(START_S + row.time_s, 3600)
    return hours, *divmod(rest, 60)


def airdata(rows, *, metric=False):
    """Leading spaces in some names and cells, messages in quotes, 15 digits of a degree."""
    foot, mph = (1.0, 1.0) if metric else (FOOT_M, MPH)
    length, speed = ("meters", "m/s") if metric else ("feet", "mph")
    header = (
        f"time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff({length}),"
        f"height_above_ground_at_drone_location({length}),speed({speed}),satellites, xSpeed({speed}), "
        f"ySpeed({speed}), zSpeed({speed}), compass_heading(degrees), pitch(degrees), roll(degrees),isPhoto,"
        f"isVideo,gimbal_heading(degrees),gimbal_pitch(degrees),gimbal_roll(degrees),flycState,message"
    )
    cells = [
        [
            round(row.time_s * 1000),
            "2024-05-01 10:00:00",
            f"{row.lat:.13f}",
            f"{row.lon:.12f}",
            f"{row.height_m / foot:.6f}",
            "Available with any HD 360 subscription" if index == 0 else "",
            f"{np.hypot(*row.speeds[:2]) / mph:.6f}",
            16,
            *(f"{each / mph:.6g}" for each in row.speeds),
            row.yaw % 360,
            f" {row.pitch}",
            f" {row.roll}",
            0,
            int(row.recording),
            round(row.gimbal_yaw % 360, 1),
            row.gimbal_pitch,
            0,
            "P-GPS",
            '"Setting new altitude to 100m (328 ft), home is set"' if index == 7 else "",
        ]
        for index, row in enumerate(rows)
    ]
    return table(header, cells)


def flight_reader(rows, *, separator=",", first_line="sep=,", mode="Follow Yaw"):
    """PhantomHelp's: feet and miles, the clock in halves of a day, and where commas part decimals semicolons."""
    header = (
        "CUSTOM.date [local],CUSTOM.updateTime [local],OSD.flyTime,OSD.flyTime [s],OSD.latitude,OSD.longitude,"
        "OSD.height [ft],OSD.altitude [ft],OSD.hSpeed [MPH],OSD.xSpeed [MPH],OSD.xSpeedMax [MPH],OSD.ySpeed [MPH],"
        "OSD.zSpeed [MPH],OSD.pitch,OSD.roll,OSD.yaw,OSD.yaw [360],OSD.flycState,GIMBAL.mode,GIMBAL.pitch,"
        "GIMBAL.roll,GIMBAL.yaw,GIMBAL.yaw [360],CAMERA.isPhoto,CAMERA.isVideo,BATTERY.temperature [\u00b0F],APP.tip"
    )
    cells = []
    for row in rows:
        hours, minutes, seconds = of_day(row)
        numbers = [
            f"{row.lat:.8f}",
            f"{row.lon:.7f}",
            f"{row.height_m / FOOT_M:.1f}",
            "300.1",
            "10.1",
            f"{row.speeds[0] / MPH:.6f}",
            "12.3",
            f"{row.speeds[1] / MPH:.6f}",
            f"{row.speeds[2] / MPH:.6f}",
            row.pitch,
            row.roll,
            signed(row.yaw),
            round(row.yaw % 360, 1),
        ]
        cells.append(
            [
                "4/13/2022",
                f"{hours:.0f}:{minutes:02.0f}:{seconds:05.2f} AM",
                f"{row.time_s // 60:.0f}m {row.time_s % 60:.1f}s",
                f"{row.time_s:.1f}",
                *numbers,
                "P-GPS",
                mode,
                row.gimbal_pitch,
                0,
                signed(row.gimbal_yaw),
                round(row.gimbal_yaw % 360, 1),
                False,
                row.recording,
                84.6,
                "",
            ]
        )
    if separator != ",":
        cells = [[str(cell).replace(".", ",") for cell in row] for row in cells]
        header = header.replace(",", separator)
    return (f"{first_line}\n" if first_line else "") + table(header, cells, separator, "\r\n")


def txt_log(rows):
    """TXTlogToCSVtool's: metres, six decimals of a degree, an empty cell where nothing is recorded."""
    header = (
        "CUSTOM.updateTime,CUSTOM.isPhoto,CUSTOM.isVideo,CUSTOM.hSpeed [m/s],OSD.latitude,OSD.longitude,"
        "OSD.height [m],OSD.xSpeed [m/s],OSD.ySpeed [m/s],OSD.zSpeed [m/s],OSD.pitch,OSD.roll,OSD.yaw,"
        "OSD.flyTime [s],GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw,GIMBAL.mode,HOME.latitude,HOME.longitude"
    )
    cells = []
    for row in rows:
        hours, minutes, seconds = of_day(row)
        cells.append(
            [
                f"2018/07/04 {hours:02.0f}:{minutes:02.0f}:{seconds:06.3f}",
                "",
                "Recording" if row.recording else "",
                0,
                f"{row.lat:.6f}",
                f"{row.lon:.6f}",
                row.height_m,
                *row.speeds,
                row.pitch,
                row.roll,
                signed(row.yaw),
                round(row.time_s, 1),
                row.gimbal_pitch,
                0,
                signed(row.gimbal_yaw),
                "YawFollow",
                48.7,
                2.2,
            ]
        )
    return table(header, cells)


def litchi(rows):
    """Litchi's: whole degrees of the body, tenths of the gimbal's."""
    header = (
        "latitude,longitude,altitude(m),ultrasonicHeight(m),speed(mps),distance(m),time(millisecond),datetime(utc),"
        "datetime(local),satellites,velocityX(mps),velocityY(mps),velocityZ(mps),pitch(deg),roll(deg),yaw(deg),"
        "isflying,istakingphoto,isTakingVideo,pitchRaw,rollRaw,yawRaw,gimbalPitchRaw,gimbalRollRaw,gimbalYawRaw"
    )
    cells = [
        [
            f"{row.lat:.7f}",
            f"{row.lon:.7f}",
            row.height_m,
            0,
            0,
            0,
            round(row.time_s * 1000),
            "2024-05-01 10:00:00.000",
            "2024-05-01 12:00:00.000",
            16,
            *row.speeds,
            -8,
            1,
            round(signed(row.yaw)),
            1,
            0,
            int(row.recording),
            -85,
            15,
            round(signed(row.yaw) * 10),
            round(row.gimbal_pitch * 10),
            0,
            round(signed(row.gimbal_yaw) * 10),
        ]
        for row in rows
    ]
    return table(header, cells)


DJI_RECORDS = {
    "AirData": airdata,
    "AirData, metric": lambda rows: airdata(rows, metric=True),
    "Flight Reader": flight_reader,
    "Flight Reader, decimal commas": lambda rows: flight_reader(rows, separator=";", first_line="sep=;"),
    "Flight Reader, no first line": lambda rows: flight_reader(rows, first_line=""),
    "TXTlogToCSVtool": txt_log,
    "Litchi": litchi,
}
