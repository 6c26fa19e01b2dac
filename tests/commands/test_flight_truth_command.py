"""`flightdepth evaluate flight`: a flight's folder beside its truth."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from plain_install import run_without_extras

from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.commands.demo import (
    CALIBRATION,
    LOG,
    NETWORK,
    SKY_M,
    TRUTH,
    TRUTH_OFFSET_PX,
    TRUTH_STEP_PX,
    VIDEO,
    Witness,
    compare,
)
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.single_flight import source_of, write_depth
from flightdepth.evaluation.flight_errors import RANGES
from flightdepth.evaluation.flight_truth import FlightTruth, FrameErrors
from flightdepth.evaluation.flight_truth_sheets import chosen
from flightdepth.flight import Frame, open_flight
from flightdepth.outputs import FlightFolder, FlightWriter, Preview, Source, read_depth
from flightdepth.ranges import RangedDepth
from flightdepth.runtimes.network import load_network
from tests_networks import difference_card

WIDTH, HEIGHT, FRAMES = 96, 64, 6
CAMERA = Camera(WIDTH, HEIGHT, 60.0, 60.0, 47.5, 31.5)
ROWS, COLUMNS = np.indices((HEIGHT, WIDTH))
TRUE_M = (5 + 40 * ROWS / HEIGHT + 0.1 * COLUMNS).astype(np.float32)  # 5 to 54 m
SKY = ROWS < 8


def seen(depth_m: np.ndarray) -> RangedDepth:
    """A result with this depth, no nearer than 100 m in the sky, and sigma of a tenth."""
    depth_m = np.where(SKY, np.nan, depth_m).astype(np.float32)
    nothing, one = np.full_like(depth_m, np.nan), np.ones(1)
    return RangedDepth(
        depth_m=depth_m,
        confidence=np.where(SKY, 0, 0.8).astype(np.float32),
        sigma_m=0.1 * depth_m,
        range_depths_m=depth_m[None],
        shifts=np.array([3]),
        displacements_m=one,
        centroids_m=one,
        farther_than_m=np.where(SKY, 100, np.nan).astype(np.float32),
        nearer_than_m=nothing,
        latency_ms=5.0,
    )


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A flight whose depth is 4 % too far; its first frame has none."""
    source = Source(flight="a.mp4", telemetry="a.csv", camera=CAMERA, network=difference_card())
    with FlightWriter(tmp_path / "out", source, Preview(WIDTH, HEIGHT)) as writer:
        for i in range(FRAMES):
            image = np.full((HEIGHT, WIDTH, 3), 40 * i, np.uint8)
            result = RangedDepth.unknown(HEIGHT, WIDTH, "first frame", 0.5) if i == 0 else seen(1.04 * TRUE_M)
            writer.add(Frame(i, i * 100_000_000, image), result)
    return tmp_path / "out"


@pytest.fixture
def evaluate(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Run the command on it; (exit code, stdout, stderr, figures)."""

    def call(*options: object):
        figures = tmp_path / "figures.json"
        words = ["evaluate", "flight", out, "--truth", tmp_path / "truth", "--json", figures, *options]
        code = main([str(word) for word in words])
        said = capsys.readouterr()
        found = json.loads(figures.read_text()) if code == 0 else {}
        return code, said.out, said.err, found

    return call


def write_truth(folder: Path, truth_m: np.ndarray = TRUE_M, *, per_m: float = 100, first: int = 0) -> None:
    """As 16-bit PNGs, one a frame, sky as large as can be."""
    folder.mkdir()
    stored = np.where(SKY, 65535, np.rint(truth_m * per_m)).astype(np.uint16)
    for i in range(FRAMES):
        cv2.imwrite(str(folder / f"depth_{first + i:05d}.png"), stored)


def test_a_flight_beside_its_truth(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth")
    code, stdout, stderr, found = evaluate()
    assert (code, stderr) == (0, "")
    whole = found["ranges"][-1]
    assert whole["abs_rel"] == pytest.approx(0.04, abs=1e-3)
    assert whole["depth_over_truth"]["median"] == pytest.approx(1.04, abs=1e-3)
    assert whole["known"] == pytest.approx((FRAMES - 1) / FRAMES)
    assert whole["inside_sigma"] == 1
    assert "depth is 4% too far in every range, as of a wrong speed or lens" in stdout
    assert "sky, 12 % of the truth: 0 % was given a depth, 83 % a farther_than" in stdout
    assert "6 of 6 frames have a truth, 1 of them without depth: first frame (1 frame)" in stdout
    assert "worst frames by relative error: 1 (4.0 %)" in stdout
    assert found["truth"] == {
        "frames": 6,
        "numbers_a_metre": [100],
        "length_of_rays": False,
        "first": 0,
        "sky_from_m": None,
    }


def test_units_rays_and_first_numbers_give_the_same(evaluate, tmp_path) -> None:
    along = np.sqrt(1 + ((COLUMNS - 47.5) / 60) ** 2 + ((ROWS - 31.5) / 60) ** 2)
    write_truth(tmp_path / "truth", TRUE_M * along, per_m=256, first=1000)
    code, _, stderr, found = evaluate("--unit", 256, "--ray", "--first", 1000)
    assert (code, stderr) == (0, "")
    assert found["ranges"][-1]["abs_rel"] == pytest.approx(0.04, abs=1e-3)
    assert found["ranges"][-1]["depth_over_truth"]["median"] == pytest.approx(1.04, abs=1e-3)


def test_a_ray_taken_for_depth_is_an_error(evaluate, tmp_path) -> None:
    along = np.sqrt(1 + ((COLUMNS - 47.5) / 60) ** 2 + ((ROWS - 31.5) / 60) ** 2)
    write_truth(tmp_path / "truth", TRUE_M * along)
    assert evaluate()[3]["ranges"][-1]["depth_over_truth"]["median"] < 1


def test_ranges_are_those_asked_for(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth")
    _, stdout, _, found = evaluate("--bins", "10,20")
    assert [(row["from_m"], row["to_m"]) for row in found["ranges"]] == [(0, 10), (10, 20), (0, 20)]
    assert "0-10 m" in stdout
    assert "of the truth, from 20 m on" in stdout


def test_far_makes_sky_of_what_lies_beyond(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth")
    _, _, _, found = evaluate("--far", 30)
    assert found["sky"]["pixels"] == FRAMES * np.count_nonzero(SKY | (np.rint(TRUE_M * 100) >= 3000))
    assert found["sky"]["with_depth"] > 0.3


def test_frames_without_truth_and_truth_without_frames_are_counted(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth", first=3)
    _, stdout, _, _ = evaluate()
    assert "3 of 6 frames have a truth, all of them with depth" in stdout
    assert (
        "3 of the truth's files are of no frame: their numbers are 3 to 8, the frames' 0 to 5 (--first)"
        in stdout
    )


def test_another_unit_is_hinted_at(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth", per_m=256)
    code, _, stderr, _ = evaluate()
    assert code == 0
    assert "stored 256 to the metre, not 100? (--unit 256)" in " ".join(stderr.split())


def test_pictures_left_out_of_the_video_are_a_warning(evaluate, out, tmp_path) -> None:
    record = json.loads((out / "flight.json").read_text())
    record["counts"]["dropped"] = {"damaged frames": 2, "velocity glitch": 1, "frames without a time": 1}
    (out / "flight.json").write_text(json.dumps(record))
    write_truth(tmp_path / "truth")
    assert "3 pictures of the video were left out" in evaluate()[2]


def test_a_flight_that_begins_in_its_video_is_a_warning_until_its_first_number_is_told(
    evaluate, out, tmp_path
) -> None:
    """Depth of frame 25 beside the truth of frame 0 looked like a network that is 36 % off."""
    table = out / "frames.csv"
    header, *rows = table.read_text().splitlines()
    later = [row.split(",", 2) for row in rows]
    rows = [f"{index},{int(stamp_ns) + 2_500_000_000},{rest}" for index, stamp_ns, rest in later]
    table.write_text("\n".join([header, *rows]) + "\n")
    write_truth(tmp_path / "truth")
    code, _, stderr, _ = evaluate()
    assert code == 0
    assert "the flight begins 2.50 s into its video" in stderr
    assert "(--first 25)" in stderr.replace("\n", " ")
    for number in reversed(range(FRAMES)):
        (tmp_path / "truth" / f"depth_{number:05d}.png").rename(
            tmp_path / "truth" / f"depth_{25 + number:05d}.png"
        )
    assert evaluate("--first", 25)[2] == ""


# Pictures


def test_pictures_show_input_error_truth_and_depth(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth", TRUE_M / 1.3)
    code, stdout, _, _ = evaluate("--pictures", tmp_path / "sheets")
    assert code == 0
    assert "pictures: 6 in" in stdout
    sheets = sorted((tmp_path / "sheets").iterdir())
    assert [path.name for path in sheets] == [f"errors-{i:06d}.png" for i in range(FRAMES)]
    shown = cv2.imread(str(sheets[3]))[..., ::-1]
    height, width = (shown.shape[0] - 30) // 2, (shown.shape[1] - 100) // 2
    assert shown[24 + height // 2 - 12, width // 2].astype(int) == pytest.approx([120] * 3, abs=6)  # input
    assert shown[height - 20, width + width // 2].tolist() == [230, 0, 0]  # 30 % too far
    assert shown[30, width + width // 2].tolist() == [90, 90, 90]  # the sky has no depth


def test_a_flight_without_its_preview_has_its_pictures_but_for_the_input(evaluate, out, tmp_path) -> None:
    write_truth(tmp_path / "truth", TRUE_M / 1.3)
    (out / "preview.mp4").unlink()
    assert evaluate("--pictures", tmp_path / "sheets")[0] == 0
    shown = cv2.imread(str(tmp_path / "sheets" / "errors-000003.png"))[..., ::-1]
    height, width = (shown.shape[0] - 30) // 2, (shown.shape[1] - 100) // 2
    assert (shown[30 : height - 20, 10 : width - 20] == 0).all()
    assert shown[height - 20, width + width // 2].tolist() == [230, 0, 0]


def test_long_flights_have_the_worst_frames_and_some_between() -> None:
    found = FlightTruth(RANGES)
    found.frames = [FrameErrors(i, 1, 1.0, 0.5 if i in (3, 977, 978) else 0.1, 1.0) for i in range(1000)]
    indices = chosen(found, 16, 3)
    assert len(indices) == 16
    assert {0, 3, 77, 977, 978} <= set(indices)


# Refusals


def refused(evaluate, *options: object) -> str:
    code, _, stderr, _ = evaluate(*options)
    assert code == 2
    assert len(stderr.splitlines()) == 1
    return stderr


def test_truth_of_other_frames_is_refused(evaluate, tmp_path) -> None:
    write_truth(tmp_path / "truth", first=1000)
    assert "expected numbers 0 to 5, of this flight's frames, got 1000 to 1005" in refused(evaluate)


def test_truth_of_another_shape_is_refused(evaluate, tmp_path) -> None:
    (tmp_path / "truth").mkdir()
    np.save(tmp_path / "truth" / "3.npy", np.ones((64, 64)))
    assert "3.npy: expected the shape of the flight's 96x64" in refused(evaluate)


def test_a_file_that_cannot_be_read_is_named(evaluate, tmp_path) -> None:
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "3.pfm").write_text("Pf")
    assert "3.pfm: expected a map" in refused(evaluate)


def test_no_truth_is_refused(evaluate) -> None:
    assert "expected a folder, got none" in refused(evaluate)


def test_a_folder_that_is_no_flight_is_refused(tmp_path, capsys) -> None:
    write_truth(tmp_path / "truth")
    assert main(["evaluate", "flight", str(tmp_path), "--truth", str(tmp_path / "truth")]) == 2
    assert "expected what `flightdepth run` writes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--unit", "0"),
        ("--unit", "nan"),
        ("--far", "-1"),
        ("--bins", "20,10"),
        ("--bins", "0,5"),
        ("--bins", "a"),
    ],
)
def test_a_value_that_cannot_be_is_refused(evaluate, tmp_path, option, value) -> None:
    write_truth(tmp_path / "truth")
    assert option in refused(evaluate, option, value)


@pytest.mark.parametrize(
    ("option", "place", "expected"),
    [
        ("--pictures", "truth", "another folder than that of --truth"),
        ("--pictures", "out/depth", "a place outside"),
        ("--pictures", "out", "a place outside"),
        ("--json", "out/flight.json", "a place outside"),
        ("--json", "out/errors.json", "a place outside"),
    ],
)
def test_neither_the_flight_nor_its_truth_is_written_into(
    evaluate, tmp_path, option, place, expected
) -> None:
    """Pictures took the place of the truth, and figures that of `flight.json`."""
    write_truth(tmp_path / "truth")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert expected in refused(evaluate, option, tmp_path / place)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


# The sample flight


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    """The demo on its first three quarters of a second: its folder, and the moments that it saw."""
    target = tmp_path_factory.mktemp("demo") / "out"
    settings = RunSettings(telemetry=LOG, camera=CALIBRATION, network="motion-tiny", end=0.75)
    witness = Witness()
    with open_flight(VIDEO, settings.telemetry, settings.camera, end_s=settings.end) as flight:
        network = load_network("motion-tiny")
        source = source_of("sample flight", flight, network, settings)
        write_depth(source, flight, network, target, settings, watch=witness.see)
        yield target, witness.moments, compare(witness.moments, flight.camera, network.card)[0]


def test_the_errors_are_those_of_the_demo(demonstrated, tmp_path) -> None:
    """But for depth in whole centimetres."""
    target, _, errors = demonstrated
    figures = tmp_path / "figures.json"
    assert main(["evaluate", "flight", str(target), "--truth", str(TRUTH), "--json", str(figures)]) == 0
    rows = json.loads(figures.read_text())["ranges"]
    for row, expected in zip(rows, errors.result()[NETWORK], strict=False):
        assert row["pixels"] == expected.pixels
        assert row["known"] == expected.known
        assert row["abs_rel"] == pytest.approx(expected.abs_rel, abs=2e-4)
        assert row["l1_m"] == pytest.approx(expected.l1_m, abs=0.005)
        assert row["delta"] == pytest.approx(expected.delta, abs=1e-3)


def test_depth_is_looked_up_where_the_demo_looks(demonstrated, tmp_path) -> None:
    target, moments, _ = demonstrated
    figures = tmp_path / "figures.json"
    main(["evaluate", "flight", str(target), "--truth", str(TRUTH), "--json", str(figures)])
    found = json.loads(figures.read_text())
    assert [frame["index"] for frame in found["frames"]] == [moment.index for moment in moments]
    folder, sky, given = FlightFolder(target), 0, 0
    for moment in moments:
        truth_m = read_depth(TRUTH / f"{moment.index:06d}.png")
        part = slice(TRUTH_OFFSET_PX, None, TRUTH_STEP_PX)
        sky += np.count_nonzero(truth_m > SKY_M)
        given += np.isfinite(folder.depth_m(moment.index)[part, part][truth_m > SKY_M]).sum()
    assert found["sky"]["pixels"] == sky
    assert found["sky"]["with_depth"] == pytest.approx(given / sky)


def test_it_needs_no_extra(out, tmp_path) -> None:
    write_truth(tmp_path / "truth")
    words = ["evaluate", "flight", out, "--truth", tmp_path / "truth", "--pictures", tmp_path / "pictures"]
    done = run_without_extras(words)
    assert done.returncode == 0, done.stderr
