import random
import struct

import numpy as np
import pytest
from flight_files import gyro_payload, klv, lned_payload, nest

from flightdepth.flight.gpmf import GpmfError, records, streams

LNED = frozenset(["LNED"])
ROWS = [(1000, 1.0, 2.0, 3.0), (1252, 4.0, 5.0, 6.0)]


def test_records_of_a_level_come_in_order():
    data = klv("ABCD", "c", 1, 5, b"hello") + klv("EFGH", "L", 4, 1, b"\0\0\0\7")
    assert [(r.key, r.kind, r.repeat) for r in records(data)] == [("ABCD", "c", 5), ("EFGH", "L", 1)]


def test_padding_is_skipped_and_left_out_of_the_text():
    assert next(records(klv("ABCD", "c", 1, 5, b"hello"))).text() == "hello"


@pytest.mark.parametrize(("kind", "code"), list(zip("bBsSlLjJfd", "bBhHlLqQfd", strict=True)))
def test_every_number_type_is_read_as_written(kind, code):
    size = struct.calcsize(">" + code)
    record = next(records(klv("ABCD", kind, 2 * size, 2, struct.pack(">4" + code, 1, 2, 3, 4))))
    assert record.numbers().tolist() == [[1, 2], [3, 4]]


def test_a_complex_type_is_read_by_its_layout():
    record = next(records(klv("ABCD", "?", 11, 1, struct.pack(">fhfB", 1.5, -2, 4.0, 9))))
    assert record.numbers("fsfB").tolist() == [[1.5, -2, 4, 9]]


def test_a_layout_may_repeat_a_type():
    record = next(records(klv("ABCD", "?", 13, 1, struct.pack(">3fB", 1, 2, 3, 4))))
    assert record.numbers("f[3]B").tolist() == [[1, 2, 3, 4]]


def test_a_stream_is_scaled_and_has_units():
    stream = streams(lned_payload(ROWS), LNED)[0]
    assert stream.values[:, 0].tolist() == [1.0, 1.252]
    assert stream.values[:, 4:].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert stream.units[:2] == ("s", "m")
    assert (stream.device, stream.name) == ("Karma", "Local Position NED")


@pytest.mark.parametrize(("told", "units"), [(1, ("rad/s",) * 3), (3, ("rad/s",) * 3), (2, ("",) * 3)])
def test_one_unit_is_that_of_all_columns(told, units):
    rates = struct.pack(">3h", 1, 2, 3)
    parts = [klv("SIUN", "c", 5, told, b"rad/s" * told), klv("GYRO", "s", 6, 1, rates)]
    (stream,) = streams(nest("DEVC", nest("STRM", *parts)), frozenset(["GYRO"]))
    assert stream.units == units


def test_one_scale_divides_all_columns():
    stream = streams(gyro_payload([[0.5, -0.25, 1.0]]), frozenset(["GYRO"]))[0]
    assert np.allclose(stream.values, [[0.5, -0.25, 1.0]])


def test_other_streams_are_passed_over():
    assert streams(lned_payload(ROWS), frozenset(["GPS5"])) == []


def test_a_stream_without_samples_is_passed_over():
    assert streams(lned_payload([]), LNED) == []


@pytest.mark.parametrize(
    "payload",
    [
        nest("DEVC", klv("ABCD", "L", 4, 1, b"\0\0\0\7"))[:-4],
        klv("ABCD", "L", 4, 1, b"\0\0\0\7"),
        nest("DEVC", klv("ABCD", "L", 4, 1, b"\0\0\0\7") + b"EF"),
        nest("DEVC", nest("STRM", klv("LNED", "?", 4, 1, bytes(4)))),
        nest("DEVC", nest("STRM", klv("TYPE", "c", 1, 2, b"f!"), klv("LNED", "?", 4, 1, bytes(4)))),
        nest("DEVC", nest("STRM", klv("TYPE", "c", 1, 1, b"d"), klv("LNED", "?", 4, 1, bytes(4)))),
        nest("DEVC", nest("STRM", klv("SCAL", "l", 4, 1, bytes(4)), klv("LNED", "f", 4, 1, bytes(4)))),
        nest("DEVC", nest("STRM", klv("LNED", "c", 4, 1, bytes(4)))),
        nest("DEVC", nest("STRM", klv("LNED", "f", 3, 4, bytes(12)))),
    ],
    ids=[
        "cut",
        "no-device",
        "rest",
        "no-layout",
        "bad-layout",
        "wrong-size",
        "zero-scale",
        "text",
        "odd-size",
    ],
)
def test_broken_payloads_are_refused(payload):
    with pytest.raises(GpmfError):
        streams(payload, LNED)


@pytest.mark.parametrize(("size", "repeat"), [(0, 5), (0, 0), (4, 0)])
def test_a_record_without_bytes_holds_no_numbers(size, repeat):
    """numpy could not tell the width of such, and said so as an error of its own."""
    record = next(records(klv("DZST", "l", size, repeat, b"")))
    assert record.numbers().size == 0


def test_samples_of_no_bytes_are_no_samples():
    payload = nest("DEVC", nest("STRM", klv("LNED", "l", 0, 5, b"")))
    assert streams(payload, LNED) == []


def test_cut_anywhere_a_payload_reads_or_is_refused():
    payload = lned_payload(ROWS)
    for size in range(1, len(payload)):
        with pytest.raises(GpmfError):
            streams(payload[:size], LNED)


def test_trash_anywhere_a_payload_reads_or_is_refused():
    payload = lned_payload(ROWS)
    for seed in range(500):
        rng = random.Random(seed)
        data = bytearray(payload)
        for _ in range(3):
            data[rng.randrange(len(data))] = rng.randrange(256)
        try:
            assert len(streams(bytes(data), LNED)) <= 1
        except GpmfError:
            continue
