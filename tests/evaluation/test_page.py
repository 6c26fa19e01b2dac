"""A network's page: what it says is what was measured, and its picture shows the pairs."""

import re
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from plane_pairs import plane_pair
from test_evaluate_network import CAMERA, CARD, D0, Constant, pairs

from flightdepth.evaluation.network import evaluate_network
from flightdepth.evaluation.page import GAP_PX, markdown, page_text, sheets, write_page
from flightdepth.evaluation.sparsification import curve_svg
from flightdepth.evaluation.spread import LEFT_OUT
from flightdepth.runtimes.network import Network
from flightdepth.weights.card import Predecessor, Stage

STAGE = Stage(
    name="64", width=64, height=64, focal_px=32, samples=1200, batch=8, learning_rate=0.001, photometric=False
)
SPREAD = {
    "inside_one": 0.683,
    "inside_two": 0.95,
    "believed": {"share": 0.8, "inside_one": 0.66},
    "sparsification": {
        "left_out": list(LEFT_OUT),
        "by_sigma": [1 - 0.8 * share for share in LEFT_OUT],
        "by_error": [1 - share for share in LEFT_OUT],
    },
    "area": 0.09,
}


@pytest.fixture(scope="module")
def network():
    return Network(CARD.model_copy(update={"stages": (STAGE,)}), Constant(6.0))


@pytest.fixture(scope="module")
def result(network):
    return evaluate_network(network, pairs(), set_name="planes", seed=3)


def test_the_page_holds_the_figures(network, result):
    text = page_text(network.card, result, "x.jpg")
    assert text.startswith(f"# {CARD.name}\n")
    assert "| 64 | 64x64 | 32 | 1,200 | 8 | 0.001 |" in text
    assert re.search(r"\| network \| 1\.667 \|", text)
    assert re.search(r"\| best constant \| 1\.333 \|.* 1\.25 \|", text)
    assert re.search(r"\| 0-30 \| 1 \| 1\.00 \|", text)  # forward: truth 5 m, answer 6 m
    assert "On planes, 3 pairs" in text
    assert "![Input, truth, error and prediction](x.jpg)" in text


def test_the_page_tells_the_command_and_the_seed(network, result):
    of_a_seed, of_files = (page_text(network.card, dict(result, seed=seed), "x.jpg") for seed in (3, None))
    assert f"`flightdepth evaluate network {CARD.name} --report DIR`" in of_a_seed
    assert of_a_seed.endswith(", seed 3.\n")
    assert f"`flightdepth evaluate network {CARD.name} --set DIR --report DIR`" in of_files
    assert "seed" not in of_files


def test_the_page_tells_the_options_of_its_set(network, result):
    text = page_text(network.card, result, "x.jpg", "--outdoor --scenes 4")
    assert f"`flightdepth evaluate network {CARD.name} --outdoor --scenes 4 --report DIR`" in text


def test_every_table_has_as_many_cells_in_each_row(network, result):
    for table in re.findall(r"(?:^\|.*\n?)+", page_text(network.card, result, "x.jpg"), re.MULTILINE):
        assert len({line.count("|") for line in table.strip().splitlines()}) == 1


def test_an_error_bar_is_told_where_there_is_one(network, result):
    text = page_text(network.card, dict(result, spread=SPREAD), "x.jpg")
    assert "68.3% of errors inside one sigma, 95.0% inside two; of what flights believe (80%) 66.0%" in text
    assert "the error is 0.60 of what it is with all; 0.50 if the true errors told" in text
    assert "between the curves: 0.090" in text
    assert "Error bar" not in page_text(network.card, result, "x.jpg")


def test_what_shipped_before_is_told_with_its_error(network, result):
    before = Predecessor(sha256="89abcdef01234567" * 4, samples=1200, l1_m=3.25)
    card = network.card.model_copy(update={"went_on_from": before})
    told = "what shipped before: 1,200 pairs, weights 89abcdef01234567, L1 3.250 m"
    assert told in page_text(card, result, "x.jpg")
    assert "shipped before" not in page_text(network.card, result, "x.jpg")


def test_a_mean_with_another_network_is_told(network, result):
    mean = network.card.model_copy(update={"mean_with": "0123456789abcdef" * 4})
    assert "of network 0123456789abcdef." in page_text(mean, result, "x.jpg")
    assert "mean of these weights" not in page_text(network.card, result, "x.jpg")


def test_the_picture_holds_the_pairs_side_by_side(network):
    shown = pairs()[:2]
    picture = sheets(network, shown)
    height, width = shown[0].current.shape[:2]
    assert picture.shape == (2 * height, 4 * width + GAP_PX, 3)
    assert np.array_equal(picture[:height, :width], shown[0].current)
    assert np.array_equal(picture[:height, 2 * width + GAP_PX : 3 * width + GAP_PX], shown[1].current)


def test_errors_are_those_at_the_nominal_displacement(network):
    """Twice the displacement halves the truth at D0: 12 m are 6 m, as answered; no error, green."""
    far = plane_pair(CAMERA, (2 * D0, 0.0, 0.0), distance_m=12.0)
    error = sheets(network, [far])[: far.current.shape[0], far.current.shape[1] :]
    assert (error.argmax(axis=2) == 1).all()


def test_both_files_are_written(network, result, tmp_path):
    page, picture = write_page(tmp_path, network, result, pairs()[:1])
    assert (page.name, picture.name) == (f"{CARD.name}.md", f"{CARD.name}.jpg")
    assert cv2.imread(str(picture)).shape[:2] == (128, 256)
    assert picture.name in page.read_text()


def test_a_markdown_table():
    assert markdown(("a", "b"), [(1, 2)]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"


def test_the_curve_is_written_beside_the_page(network, result, tmp_path):
    page, _, curve = write_page(tmp_path, network, dict(result, spread=SPREAD), pairs()[:1])
    assert f"![Sparsification curve]({curve.name})" in page.read_text()
    lines = ElementTree.parse(curve).findall("{http://www.w3.org/2000/svg}polyline")
    own, _, best, _ = (
        [tuple(map(float, at.split(","))) for at in each.get("points").split()] for each in lines
    )
    assert own[0] == best[0]  # with all pixels both are the mean error
    drops = [(points[0][1] - points[-1][1]) for points in (own, best)]
    assert drops[0] / drops[1] == pytest.approx(0.8, abs=0.01)
    assert own[-1][0] - own[0][0] == pytest.approx(0.9 * 360)  # nine tenths of the width between the margins


def test_a_point_of_the_curve_stands_at_what_the_axes_say():
    """By the true error, with 40 % left out the error is 0.6 of what it is with all."""
    svg = ElementTree.fromstring(curve_svg(SPREAD))
    labels = {each.text: each for each in svg.iter("{http://www.w3.org/2000/svg}text")}
    line = svg.findall("{http://www.w3.org/2000/svg}polyline")[2]
    x, y = map(float, line.get("points").split()[4].split(","))
    assert (x, y + 4) == (float(labels["40%"].get("x")), float(labels["0.6"].get("y")))


@pytest.mark.parametrize(("share", "y"), [("1", 14), ("0.6", 96.4), ("0", 220)])
def test_more_error_is_higher_in_the_curve_s_picture(share, y):
    """Of 260 px, 14 are above and 40 below."""
    svg = ElementTree.fromstring(curve_svg(SPREAD))
    labels = {each.text: each for each in svg.iter("{http://www.w3.org/2000/svg}text")}
    assert float(labels[share].get("y")) == pytest.approx(y + 4)


def test_the_last_share_on_the_curves_axis_is_whole():
    """Once the page cut it: half of "100%" lay beyond the picture's edge."""
    svg = ElementTree.fromstring(curve_svg(SPREAD))
    (last,) = (each for each in svg.iter("{http://www.w3.org/2000/svg}text") if each.text == "100%")
    widest_px = 4 * 9  # of 12 px: a % is about nine wide
    assert last.get("text-anchor") == "middle"
    assert float(last.get("x")) + widest_px / 2 <= float(svg.get("width"))
