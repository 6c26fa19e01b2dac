"""Clouds on the Earth. What is true comes from pyproj's geodesics and its own UTM, on other ways than the package's."""

from dataclasses import replace

import laspy
import numpy as np
import pytest
from flown_folder import FRAMES, STEP_M, WALL_M, pose, write_flown
from pyproj import Geod, Transformer

from flightdepth.cli import main
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.cloud import CloudSettings, cloud_of
from flightdepth.outputs.georeference import TURN_TOLD, LocalOnlyError, fitted, georeference
from flightdepth.outputs.voxels import Cloud

GEOD = Geod(ellps="WGS84")
MUNICH = (48.1, 11.5, 520.0)
WEAVING_S = np.arange(0, 120, 0.5)
STANDS = np.zeros((len(WEAVING_S), 3))


def there(start, north_m, east_m):
    """Latitude and longitude so far from `start`, along the geodesic."""
    azimuth, distance = np.degrees(np.arctan2(east_m, north_m)), np.hypot(east_m, north_m)
    longitude, latitude, _ = GEOD.fwd(
        np.full_like(distance, start[1]), np.full_like(distance, start[0]), azimuth, distance
    )
    return latitude, longitude


def utm(epsg, latitude, longitude):
    return Transformer.from_crs(4326, epsg, always_xy=True).transform(longitude, latitude)


def weaving(reach_m=200.0):
    """North, east, down of a flight with turns, metres [n, 3]."""
    return np.stack(
        [reach_m * np.sin(WEAVING_S / 19), reach_m * WEAVING_S / 120, -10 * np.sin(WEAVING_S / 11)], axis=1
    )


def flown(ned, start=MUNICH, *, local=None, attitude="log", noise_m=0.0, altitude=True):
    """Poses of a flight from `start` along `ned`, whose local frame has it at `local`."""
    noise = np.random.default_rng(0).normal(0, noise_m, (len(ned), 3)) if noise_m else np.zeros((len(ned), 3))
    poses = []
    for i, (true, own) in enumerate(zip(ned, ned if local is None else local, strict=True)):
        latitude, longitude = there(start, *(true + noise[i])[:2])
        place = np.array([latitude, longitude, start[2] - true[2] + noise[i, 2] if altitude else np.nan])
        poses.append(replace(pose(i, 0.0, attitude=attitude), position_ned=own, place=place))
    return poses


def in_utm(found, *enu):
    points = np.array(enu, dtype=float)
    return found.in_utm(
        Cloud(points, np.zeros((len(points), 3), np.uint8), np.ones(len(points), np.float32))
    ).points_m


PLACES = {
    "Munich": ((48.1, 11.5, 520.0), 32632),
    "the west of its zone": ((48.1, 6.001, 200.0), 32632),
    "the far north, at the zone's east, where north is 2.8 degrees off": ((69.0, 11.999, 30.0), 32632),
    "Cape Town": ((-33.95, 18.45, 60.0), 32734),
    "just south of the equator": ((-0.0005, 37.0, 1800.0), 32737),
    "the last zone before the date line": ((-17.0, 179.9995, 5.0), 32760),
    "the first after it": ((-17.0, -179.9999, 5.0), 32701),
}


@pytest.mark.parametrize("name", PLACES)
def test_a_point_lies_where_it_is_on_earth(name):
    """To the millimetre, 300 m from where the flight began: a false zone, scale or convergence is metres."""
    start, epsg = PLACES[name]
    found = georeference(flown(weaving(), start), true_north=True)
    assert found.crs.to_epsg() == epsg
    point = in_utm(found, (-180.0, 240.0, 7.0))[0]
    expected = utm(epsg, *there(start, 240.0, -180.0))
    assert point == pytest.approx((*expected, start[2] + 7), abs=0.005)
    assert found.apart_m[1] < 0.005


def test_where_the_local_frame_begins_does_not_matter():
    """A segment's origin is its first frame, wherever the log's positions begin."""
    ned, begun = weaving(), np.array([55.0, -30.0, 4.0])
    found = georeference(flown(ned, local=ned - begun), true_north=True)
    east, north = utm(32632, *there(MUNICH, *begun[:2]))
    assert in_utm(found, (0, 0, 0))[0] == pytest.approx((east, north, MUNICH[2] - begun[2]), abs=0.005)


def test_a_receiver_that_strays_for_a_while_pulls_little():
    """A third of the positions 40 m off: their mean would be 13 m off."""
    ned = weaving()
    told = ned.copy()
    told[100:180] += (30.0, -26.0, 15.0)
    found = georeference(flown(told, local=ned), true_north=True)
    assert in_utm(found, (0, 0, 0))[0] == pytest.approx((*utm(32632, *MUNICH[:2]), MUNICH[2]), abs=0.1)
    assert found.apart_m == pytest.approx((0, 39.7), abs=0.2)


def test_how_well_the_way_follows_the_positions_is_told():
    """A receiver that is 2 m off in each direction, by chance: half within 2.35 m (Rayleigh), 95 % within 4.9."""
    found = georeference(flown(weaving(), noise_m=2.0), true_north=True)
    assert found.apart_m == pytest.approx((2.35, 4.9), rel=0.12)
    assert "m from the log's positions" in found.described("mean sea level")
    assert np.abs(in_utm(found, (0, 0, 0))[0][:2] - utm(32632, *MUNICH[:2])).max() < 0.5


def test_the_distances_are_told_in_metres_each_in_its_place():
    found = replace(
        georeference(flown(weaving()), true_north=True), apart_m=(1.234, 5.678), apart_up_m=(0.25, 0.75)
    )
    told = " ".join(found.described("mean sea level").split())
    assert (
        "the way flown lies 1.23 m from the log's positions (95 % within 5.68 m), in height 0.25 m (0.75 m), at"
        in told
    )


def told_of(poses, *, true_north=True):
    """What is said of the frame, in one line."""
    return " ".join(georeference(poses, true_north=true_north).described("mean sea level").split())


def test_where_the_first_camera_stood_is_told():
    """A user sees there that the log is of another place, or in feet; the second frame is the first with a fix."""
    poses = flown(weaving(), (-33.85, 151.21, 40.0))
    poses[0] = replace(poses[0], place=np.full(3, np.nan))
    assert "first camera at latitude -33.850000, longitude 151.210000, height 40.0 m" in told_of(poses)
    assert "longitude 151.210000 the" in told_of(flown(weaving(), (-33.85, 151.21, 40.0), altitude=False))


def test_how_far_altitudes_lie_from_the_way_is_told():
    """A climb of 10 m with its altitudes in feet: 22.8 m too much, evenly spread about their middle."""
    ned = weaving() * (1, 1, 0) - np.linspace((0, 0, 0), (0, 0, 10), len(WEAVING_S))
    feet = [replace(p, place=p.place / (1, 1, 0.3048)) for p in flown(ned)]
    found = georeference(feet, true_north=True)
    assert found.apart_up_m == pytest.approx((22.8 / 4, 0.95 * 22.8 / 2), rel=0.02)
    assert found.apart_m[1] < 0.005
    assert "in height 5.7" in told_of(feet)
    assert georeference(flown(ned, altitude=False), true_north=True).apart_up_m is None


def test_on_how_many_positions_it_rests_is_told():
    """One fix fits any way: 0.00 m apart says nothing then."""
    poses = flown(weaving())
    alone = [poses[0], *(replace(p, place=np.full(3, np.nan)) for p in poses[1:])]
    assert f"at 1 of {len(poses)} frames" in told_of(alone)
    assert f"at {len(poses)} of {len(poses)} frames" in told_of(poses)


@pytest.mark.parametrize(
    ("times", "noise_m", "said"),
    [
        (1.044, 0.1, "4.4 % longer, far"),
        (0.9, 0.1, "10.0 % shorter, near"),
        (1.01, 0.0, ""),
        (1.044, 30.0, ""),
    ],
)
def test_a_way_of_another_length_is_told(times, noise_m, said):
    """A Karma's velocities summed to a way 4.4 % longer than its positions', and nothing said so."""
    told = told_of(flown(weaving(), local=weaving() * times, noise_m=noise_m))
    length, _, side = said.partition(", ")
    line = f"is {length} than the log's positions tell: where these are right, depth is so much too {side}"
    assert line in told if said else "than the log's positions tell" not in told


@pytest.mark.parametrize(("drift", "noise_m"), [(weaving(1.0), 2.5), (STANDS + 3.3, 0.0)])
def test_a_hovering_drones_way_has_no_length(drift, noise_m):
    """It drifts by a metre, its receiver by more; or neither does, but for the last bits."""
    assert "than the log's positions" not in told_of(flown(STANDS, local=drift, noise_m=noise_m))


def test_a_receiver_that_stands_still_tells_no_length():
    """The way flown was told to be thousands of times longer than its noise, and depth so much too far."""
    assert "than the log's positions" not in told_of(flown(STANDS, local=weaving(), noise_m=0.3))


def turned(ned, degrees):
    """The same way in a map whose y axis points so many degrees left of north."""
    turn = np.exp(-1j * np.radians(degrees)) * (ned[:, 1] + 1j * ned[:, 0])
    return np.c_[turn.imag, turn.real, ned[:, 2]]


@pytest.mark.parametrize(
    ("way", "told", "follows"),
    [
        ("latitude and longitude swapped", weaving()[:, [1, 0, 2]], False),
        ("a receiver that stands still", STANDS, False),
        ("another flight", weaving()[::-1] * (1, -3, 1), False),
        ("a north that is 10 degrees off", turned(weaving(), 10.0), False),
        ("a velocity that drifts", weaving() + np.outer(WEAVING_S, (0.1, 0.0, 0.0)), True),
        ("the way itself", weaving(), True),
    ],
)
def test_a_way_that_the_positions_do_not_follow_is_known(way, told, follows):
    assert georeference(flown(told, local=weaving()), true_north=True).follows == follows


def test_a_hovering_drone_follows():
    """The receiver's error is all that its positions show."""
    assert georeference(flown(STANDS, noise_m=2.5), true_north=True).follows


@pytest.mark.parametrize(
    ("apart_m", "spread_m", "follows"),
    [(4.9, 0.0, True), (5.1, 0.0, False), (9.9, 100.0, True), (10.1, 100.0, False), (4.9, 20.0, True)],
)
def test_a_way_follows_within_a_receivers_error_or_a_tenth_of_its_spread(apart_m, spread_m, follows):
    found = georeference(flown(weaving()), true_north=True)
    assert replace(found, apart_m=(apart_m, 99.0), spread_m=spread_m).follows == follows


@pytest.mark.parametrize("degrees", [-170.0, -20.0, 3.0, 90.0])
def test_a_north_that_may_be_any_is_found(degrees):
    ned = weaving()
    poses = flown(ned, local=turned(ned, degrees), noise_m=0.5)
    found = georeference(poses, true_north=False)
    assert np.degrees(np.angle(found.turn)) == pytest.approx(degrees, abs=0.2)
    own = turned(np.array([[240.0, -180.0, -7.0]]), degrees)[0]
    expected = utm(32632, *there(MUNICH, 240.0, -180.0))
    assert in_utm(found, (own[1], own[0], -own[2]))[0][:2] == pytest.approx(expected, abs=1.0)
    assert "the way flown, turned by" in found.described("mean sea level")


def test_by_how_much_a_way_was_turned_is_told():
    told = told_of(flown(weaving(), local=turned(weaving(), -20.0)), true_north=False)
    assert "the way flown, turned by -20.0 degrees, lies 0.00 m" in told


@pytest.mark.parametrize(("share", "placed"), [(0.035, True), (0.07, False)])
def test_north_is_told_where_half_of_the_positions_lie_nearer_than_a_twentieth_of_the_spread(share, placed):
    """Half of what a receiver tells lies within 1.18 of its error (Rayleigh)."""
    ned = weaving()
    spread_m = np.hypot(*(ned - ned.mean(axis=0))[:, :2].T).mean()
    poses = flown(ned, noise_m=share * spread_m / 1.18)
    if placed:
        assert georeference(poses, true_north=False).apart_m[0] < TURN_TOLD * spread_m
    else:
        with pytest.raises(LocalOnlyError, match="north may be any direction"):
            georeference(poses, true_north=False)


def test_a_true_north_is_not_turned():
    """A velocity that drifts aside looks like a turn; it is none."""
    ned = weaving()
    drifting = ned + np.outer(WEAVING_S, (0.1, 0.0, 0.0))
    assert georeference(flown(ned, local=drifting), true_north=True).turn == 1


@pytest.mark.parametrize("reach_m", [0.0, 3.0])
def test_a_way_too_short_to_tell_north_stays_local(reach_m):
    ned = weaving(reach_m)
    with pytest.raises(LocalOnlyError, match="north may be any direction"):
        georeference(flown(ned, noise_m=1.5), true_north=False)


def test_without_an_altitude_heights_stay_local():
    found = georeference(flown(weaving(), altitude=False), true_north=True)
    assert in_utm(found, (0, 0, 12.5))[0][2] == 12.5
    assert "heights above the first camera" in found.described(None)


def test_altitudes_of_some_positions_are_enough():
    poses = flown(weaving())
    for index in range(0, len(poses), 3):
        poses[index] = replace(poses[index], place=poses[index].place * (1, 1, np.nan))
    found = georeference(poses, true_north=True)
    assert in_utm(found, (0, 0, 7.0))[0][2] == pytest.approx(MUNICH[2] + 7, abs=0.005)
    assert found.apart_up_m == pytest.approx((0, 0), abs=0.005)
    assert found.frames == (len(poses), len(poses))


def test_an_attitude_that_nothing_tells_does_not_keep_a_way_from_its_place():
    assert georeference(flown(weaving(), attitude="unknown"), true_north=True).apart_m[1] < 0.005


def test_positions_of_some_frames_are_enough():
    poses = flown(weaving())
    for index in range(0, len(poses), 3):
        poses[index] = replace(poses[index], place=np.full(3, np.nan))
    found = georeference(poses, true_north=True)
    assert in_utm(found, (0, 0, 0))[0][:2] == pytest.approx(utm(32632, *MUNICH[:2]), abs=0.005)


@pytest.mark.parametrize(
    ("poses", "why"),
    [
        (flown(weaving(), attitude="assumed"), "tells no attitude"),
        ([*flown(weaving()), *flown(weaving(), attitude="assumed")], "tells no attitude"),
        ([pose(i, i / 2) for i in range(9)], "no latitude and longitude"),
        (flown(weaving(), (85.0, 10.0, 2.0)), "UTM does not reach latitude 85.0"),
    ],
)
def test_what_cannot_be_placed_says_why(poses, why):
    with pytest.raises(LocalOnlyError, match=why):
        georeference(poses, true_north=True)


def test_the_fit_is_the_one_that_made_it():
    rng = np.random.default_rng(1)
    way = rng.normal(0, 50, 60) + 1j * rng.normal(0, 50, 60)
    turn, shift = fitted(way, np.exp(0.7j) * way + (3 - 4j), turns=True)
    assert (turn, shift) == (pytest.approx(np.exp(0.7j)), pytest.approx(3 - 4j))


# The command


@pytest.fixture
def converted(tmp_path, capsys):
    """Convert a folder of those poses; what it said, and its points."""

    def call(poses, name="flight.laz", **source):
        folder = write_flown(tmp_path / "out", poses=poses)
        record = folder.record.model_copy(update={"source": folder.record.source.model_copy(update=source)})
        (folder.folder / "flight.json").write_text(record.model_dump_json())
        assert main(["convert", str(folder.folder), str(tmp_path / name), "--every", "1"]) == 0
        return " ".join(capsys.readouterr().out.split()), tmp_path / name, FlightFolder(folder.folder)

    return call


def wall_poses(start=MUNICH, **changes):
    ned = np.c_[STEP_M * np.arange(FRAMES), np.zeros((FRAMES, 2))]
    return [replace(each, **changes) for each in flown(ned, start)]


@pytest.mark.parametrize("start", [MUNICH, (-33.95, 18.45, 60.0)])
@pytest.mark.parametrize("kind", ["las", "laz"])
def test_a_cloud_in_utm_goes_through_laspy(converted, kind, start):
    said, file, folder = converted(wall_poses(start), f"flight.{kind}", altitude_above="mean sea level")
    las = laspy.read(file)
    epsg = las.header.parse_crs().to_epsg()
    assert epsg == (32632 if start is MUNICH else 32734)
    assert f"EPSG:{epsg}" in said and "heights above mean sea level" in said
    local = cloud_of(folder, CloudSettings(every=1)).points_m
    east, north, up = local.T
    expected = np.stack([*utm(epsg, *there(start, north, east)), start[2] + up], axis=1)
    assert las.header.scales.tolist() == [0.001] * 3
    assert np.abs(las.xyz - expected).max() < 0.002
    wall_east, wall_north = utm(epsg, *there(start, WALL_M, 0.0))
    assert np.hypot(las.x - wall_east, las.y - wall_north).min() < 0.2


def test_each_point_is_the_only_return_of_its_pulse(converted):
    """0 of 0, as it was, is no return of LAS: tools that filter by returns found none, the header counted none."""
    las = laspy.read(converted(wall_poses())[1])
    assert set(las.return_number) == set(las.number_of_returns) == {1}
    assert las.header.number_of_points_by_return[0] == len(las)


def test_positions_that_the_way_does_not_follow_are_warned_of(tmp_path, capsys):
    """Found in review: latitude and longitude swapped, or another flight's, gave a cloud in a wrong place."""
    ned = np.c_[STEP_M * np.arange(FRAMES), np.zeros((FRAMES, 2))]
    for times, warned in ((1, False), (20, True)):
        write_flown(tmp_path / "out", poses=flown(times * ned, local=ned))
        assert main(["convert", str(tmp_path / "out"), str(tmp_path / "a.las"), "--every", "1"]) == 0
        assert ("go another way than its velocities" in " ".join(capsys.readouterr().err.split())) == warned


def test_a_flight_without_positions_stays_local_and_says_so(converted):
    said, file, folder = converted([pose(i, STEP_M * i) for i in range(FRAMES)])
    assert "metres east, north, up, not in UTM: poses.csv tells no latitude and longitude" in said
    las = laspy.read(file)
    assert las.header.parse_crs() is None
    assert np.abs(las.xyz - cloud_of(folder, CloudSettings(every=1)).points_m).max() < 0.001


def test_a_ply_stays_local(converted):
    """Its numbers have 24 bits: half a metre of UTM's."""
    said, file, _ = converted(wall_poses(), "flight.ply")
    assert said.endswith("metres east, north, up")
    assert b"east, north, up; origin: the first camera" in file.read_bytes()[:200]


def test_a_map_whose_north_may_be_any_stays_local_after_5_metres(converted):
    ned = np.c_[STEP_M * np.arange(FRAMES), np.zeros((FRAMES, 2))]
    said, file, _ = converted(flown(ned, noise_m=1.5), true_north=False)
    assert "not in UTM: north may be any direction" in said
    assert laspy.read(file).header.parse_crs() is None
