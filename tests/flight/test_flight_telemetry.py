"""What is said of a file or a folder that is no log."""

import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.telemetry import is_log, read_telemetry
from tests_logs import dataflash_flight, ulog_flight


def test_a_folder_of_logs_is_refused_with_their_names(tmp_path):
    """It was "something else"."""
    (tmp_path / "notes.md").write_text("no log")
    with pytest.raises(BadInput, match="got a folder without a log"):
        read_telemetry(tmp_path)
    (tmp_path / "08_15_42.ulg").write_bytes(ulog_flight(3))
    (tmp_path / "00000012.BIN").write_bytes(dataflash_flight(3))
    with pytest.raises(BadInput, match=r"give one of them \(00000012\.BIN, 08_15_42\.ulg\)"):
        read_telemetry(tmp_path)
    (tmp_path / "rosbag2_2026_05_01").mkdir()
    (tmp_path / "rosbag2_2026_05_01" / "metadata.yaml").touch()
    with pytest.raises(BadInput, match=r"08_15_42\.ulg, rosbag2_2026_05_01\)"):
        read_telemetry(tmp_path)
    for number in range(20):
        (tmp_path / f"{number}.ulg").write_bytes(ulog_flight(3))
    with pytest.raises(BadInput, match="and 13 more"):
        read_telemetry(tmp_path)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"ULogEnc\x01" + bytes(500), r"encrypted log \(\.ulge\)"),
        # Was read as a CSV: "expected each column once".
        (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\r\n", r"as text: give the \.bin"),
    ],
)
def test_logs_of_autopilots_that_are_not_read_are_called_by_name(tmp_path, data, said):
    path = tmp_path / "flight.log"
    path.write_bytes(data)
    assert not is_log(path)
    with pytest.raises(BadInput, match=said):
        read_telemetry(path)
