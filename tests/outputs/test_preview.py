import numpy as np
import pytest
from output_samples import HEIGHT, WIDTH, frame, known, unknown

from flightdepth.flight.records import Frame
from flightdepth.outputs.palette import FARTHER_HATCH, UNKNOWN_HATCH
from flightdepth.outputs.preview import CAPTION_HEIGHT, FOOTER_HEIGHT, GAP, MAX_PANEL, Layout, Preview
from flightdepth.ranges.result import RangedDepth


def panel(preview, picture, number):
    x, y = preview._layout.corner(number)
    return picture[y : y + preview._layout.height, x : x + preview._layout.width]


@pytest.mark.parametrize("panels", [2, 3, 4, 5, 6, 7])
@pytest.mark.parametrize("size", [(854, 480), (3840, 2160), (1080, 1920), (97, 61), (256, 256)])
def test_every_panel_lies_inside_an_even_film(size, panels):
    layout = Layout.of(*size, panels)
    width, height = layout.size
    assert width % 2 == height % 2 == 0
    for i in range(panels):
        x, y = layout.corner(i)
        assert y >= CAPTION_HEIGHT
        assert x + layout.width + GAP <= width
        assert y + layout.height <= height


@pytest.mark.parametrize("size", [(854, 480), (3840, 2160), (1080, 1920)])
def test_the_picture_keeps_its_shape_and_fits_a_screen(size):
    layout = Layout.of(*size, 2)
    assert layout.width / layout.height == pytest.approx(size[0] / size[1], rel=0.01)
    assert layout.width <= MAX_PANEL[0]
    assert layout.height <= MAX_PANEL[1]


@pytest.mark.parametrize("size", [(1280, 128), (1920, 200), (320, 80), (256, 64), (2000, 20)])
def test_a_low_picture_has_what_of_the_legend_there_is_room_for(size):
    width, height = size
    preview = Preview(width, height)
    shown = Frame(0, 0, np.full((height, width, 3), 70, np.uint8))
    drawn = preview.draw(shown, RangedDepth.unknown(height, width, "hovering", 1.0))
    assert drawn.shape == (*preview.size[::-1], 3)


def test_the_input_stands_at_the_left():
    preview = Preview(WIDTH, HEIGHT)
    assert (panel(preview, preview.draw(frame(7), known(10)), 0) == 70).all()


def test_near_and_far_have_the_colours_of_their_places():
    depth_m = np.where(np.arange(WIDTH) < WIDTH / 2, 3, 80)
    preview = Preview(WIDTH, HEIGHT)
    shown = panel(preview, preview.draw(frame(), known(depth_m)), 1).astype(int).sum(axis=2)
    assert shown[:, : shown.shape[1] // 2 - 8].min() > shown[:, shown.shape[1] // 2 + 8 :].max()


def test_unknown_is_hatched_and_the_reason_is_written():
    preview = Preview(WIDTH, HEIGHT)
    picture = preview.draw(frame(), unknown())
    layout = preview._layout
    assert (panel(preview, picture, 1) == UNKNOWN_HATCH.picture(layout.width, layout.height)).all()
    footer = picture[-FOOTER_HEIGHT:].astype(int)
    assert (footer[..., 0] - footer[..., 2] > 60).any()  # in the colour of a warning, which nothing else has


def test_the_latency_is_named(monkeypatch):
    """A film said "895.5 ms", and no more."""
    written = []
    monkeypatch.setattr(
        "flightdepth.outputs.preview.write", lambda _, text, *place: written.append(text) or 0
    )
    Preview(WIDTH, HEIGHT).draw(frame(), known(10))
    assert written[-1] == "known 100%   latency 5.0 ms"


def test_farther_than_is_not_shown_as_unknown():
    result = known(np.nan)
    result.farther_than_m[:] = 120
    preview = Preview(WIDTH, HEIGHT)
    layout = preview._layout
    shown = panel(preview, preview.draw(frame(), result), 1)
    assert (shown == FARTHER_HATCH.picture(layout.width, layout.height)).all()


def test_one_frame_leaves_no_trace_in_the_next():
    preview = Preview(WIDTH, HEIGHT)
    first = preview.draw(frame(), known(10))
    preview.draw(frame(3), unknown())
    assert (preview.draw(frame(), known(10)) == first).all()


def ranges_preview(panels=2):
    return Preview(WIDTH, HEIGHT, range_panels=panels, to_source=lambda map_hw: map_hw)


def test_each_range_has_its_panel():
    result = known(10)
    result.range_depths_m[0], result.range_depths_m[1] = 4, 60
    preview = ranges_preview()
    picture = preview.draw(frame(), result)
    near, far = panel(preview, picture, 2), panel(preview, picture, 3)
    assert near.astype(int).sum() > panel(preview, picture, 1).astype(int).sum() > far.astype(int).sum()


def test_a_range_that_was_merged_away_is_said_to_be_unused():
    preview = ranges_preview()
    picture = preview.draw(frame(), known(10, (0.25,)))
    assert (panel(preview, picture, 3) == preview._empty[0, 0]).all()


@pytest.mark.parametrize("scout_m", [0.05, 0.6, 9.0])
def test_a_scout_does_not_push_the_ranges_out_of_their_panels(scout_m):
    preview = ranges_preview()
    before = preview.draw(frame(), known(10, (0.25, 1.5)))
    lengths = sorted([0.25, 1.5, scout_m])
    result = known(10, tuple(lengths))
    result.range_depths_m[lengths.index(scout_m)] = 90
    after = preview.draw(frame(), result)
    for number in (2, 3):
        assert (panel(preview, after, number) == panel(preview, before, number)).all()


def test_a_range_of_another_lens_is_said_to_be_unused():
    """The lens zoomed between the frame's depth and its picture."""
    preview = Preview(WIDTH, HEIGHT, range_panels=2, to_source=lambda map_hw: None)
    picture = preview.draw(frame(), known(10))
    assert (panel(preview, picture, 2) == preview._empty[0, 0]).all()
