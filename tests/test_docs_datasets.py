"""The commands and the snippet of docs/datasets.md, on the sample flight as a folder of pictures."""

import json
import re
import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import flightdepth as fd
from flightdepth.cli import main
from flightdepth.commands.demo import POSES, TRUTH, VIDEO
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.video import Video
from flightdepth.motion import (
    NED_FROM_CAMERA,
    NED_FROM_ENU,
    quaternion_from_rotation,
    rotation_from_quaternion,
)

TEXT = (Path(__file__).parents[1] / "docs" / "datasets.md").read_text(encoding="utf-8")
RUN, EVALUATE = re.findall(r"^(flightdepth .*)$", TEXT, re.MULTILINE)
SNIPPET, OF_A_BODY = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
RATE_HZ, FRAMES = 30, 41


@pytest.fixture(scope="module")
def truth():
    """Positions [n, 3] and attitudes [n, 3, 3] of the sample's first frames, north, east, down."""
    rows = np.loadtxt(POSES, delimiter=",", skiprows=1)[:FRAMES]
    return rows[:, 1:4], np.array([rotation_from_quaternion(row[4:8]) for row in rows])


def quaternions_xyzw(turns):
    return np.array([np.roll(quaternion_from_rotation(turn), -1) for turn in turns])


def test_a_folder_of_pictures_with_a_trajectory_is_flown_and_compared(tmp_path, monkeypatch, truth):
    monkeypatch.chdir(tmp_path)
    Path("pictures").mkdir()
    with Video(VIDEO, end_s=(FRAMES - 0.5) / RATE_HZ) as video:
        for frame in video.frames():
            picture = cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR)
            cv2.imwrite(f"pictures/{frame.index:06d}.jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, 98))
    ned, turns = truth
    world_from_ned = NED_FROM_ENU.T
    rows = [
        np.arange(FRAMES) / RATE_HZ,
        *(ned @ world_from_ned.T).T,
        *quaternions_xyzw(world_from_ned @ turns).T,
    ]
    np.savetxt("poses.txt", np.stack(rows, axis=1), fmt="%.7f", header="time x y z qx qy qz qw")
    Path("depth").mkdir()
    for name in ("000020.png", "000030.png", "000040.png"):
        shutil.copy(TRUTH / name, "depth")
    command = RUN.replace("--rate 10", f"--rate {RATE_HZ}").replace("--hfov 90", "--hfov 75")
    command += " --network motion-tiny --ranges 1"
    assert main(shlex.split(command)[1:]) == 0
    rows = fd.FlightFolder("out").rows
    assert [row.picture for row in rows] == [f"{index:06d}.jpg" for index in range(FRAMES)]
    assert sum(not row.reason for row in rows) >= FRAMES - 2
    assert main([*shlex.split(EVALUATE)[1:], "--json", "errors.json"]) == 0
    errors = json.loads(Path("errors.json").read_text(encoding="utf-8"))
    assert errors["truth"]["frames"] == 3
    assert errors["ranges"][-1]["abs_rel"] < 0.1  # the sample flight's is 0.053


@pytest.mark.parametrize("kind", ["tartanair", "kitti"])
def test_poses_without_times_become_a_log(tmp_path, monkeypatch, truth, kind):
    monkeypatch.chdir(tmp_path)
    ned, turns = truth
    if kind == "tartanair":
        rows = np.c_[ned, quaternions_xyzw(turns @ NED_FROM_CAMERA.T)]
        expected = ned, turns
    else:  # of a level first camera that looks north
        first = turns[0].T
        rows = np.concatenate([first @ turns, (first @ (ned - ned[0]).T).T[:, :, None]], axis=2).reshape(
            -1, 12
        )
        expected = (ned - ned[0]) @ first.T @ NED_FROM_CAMERA.T, NED_FROM_CAMERA @ first @ turns
    np.savetxt("pose_left.txt", rows)
    exec(SNIPPET.replace("*tartanair(", f"*{kind}("), {})
    log = read_telemetry(Path("poses.csv"))
    assert log.name == "CSV poses.csv: velocity by its positions in metres"
    told = np.array([rotation_from_quaternion(sample.world_from_camera) for sample in log.attitudes])
    np.testing.assert_allclose(told, expected[1], atol=1e-6)
    velocity = log.velocities[1].velocity  # half-way between the first two
    assert np.linalg.norm(velocity) > 1
    np.testing.assert_allclose(velocity, (expected[0][1] - expected[0][0]) * 10, atol=0.1)


@pytest.mark.parametrize("kind", ["euroc", "airsim"])
def test_poses_of_a_body_become_the_cameras(tmp_path, monkeypatch, truth, kind):
    monkeypatch.chdir(tmp_path)
    ned, turns = truth
    times_s = 1_400_000_000 + np.arange(FRAMES) / 10
    if kind == "euroc":  # z up; the camera's axes and place in the IMU's
        t_bs = np.eye(4)
        t_bs[:3, :3] = rotation_from_quaternion(np.array([0.5, -0.5, 0.5, -0.5]))
        t_bs[:3, 3] = 0.1, -0.2, 0.3
        bodies = NED_FROM_ENU.T @ turns @ t_bs[:3, :3].T
        places = ned @ NED_FROM_ENU - bodies @ t_bs[:3, 3]
        rows = [
            ",".join(map(str, [round(time * 1e9), *place, *quaternion_from_rotation(body), 0, 0, 0]))
            for time, place, body in zip(times_s, places, bodies, strict=True)
        ]
        Path("data.csv").write_text("\n".join(["#timestamp, p_RS_R_x [m]", *rows]), encoding="utf-8")
        call = f"euroc('data.csv', {t_bs.ravel().tolist()})"
    else:
        rows = [
            "\t".join(
                map(str, ["Drone", round(time * 1e3), *place, *quaternion_from_rotation(body), "a.png"])
            )
            for time, place, body in zip(times_s, ned, turns @ NED_FROM_CAMERA.T, strict=True)
        ]
        head = "VehicleName TimeStamp POS_X POS_Y POS_Z Q_W Q_X Q_Y Q_Z ImageFile".replace(" ", "\t")
        Path("airsim_rec.txt").write_text("\n".join([head, *rows]), encoding="utf-8")
        call = 'airsim("airsim_rec.txt")'
    exec(OF_A_BODY.replace('airsim("airsim_rec.txt")', call), {})
    log = read_telemetry(Path("trajectory.txt"))
    assert log.utc is not None
    assert log.utc.at(0) == pytest.approx(1_400_000_000 * 10**9, abs=10**6)
    told = np.array([rotation_from_quaternion(sample.world_from_camera) for sample in log.attitudes])
    np.testing.assert_allclose(told, turns, atol=1e-6)
    way = np.sum([sample.velocity for sample in log.velocities[:1]], axis=0)
    np.testing.assert_allclose(way, (ned[1] - ned[0]) * 10, atol=0.1)
