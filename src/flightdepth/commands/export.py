"""`flightdepth export`: a trained network as an ONNX file with its card."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.terminal import counted, say
from flightdepth.errors import BadInput
from flightdepth.files import make_folder

if TYPE_CHECKING:
    from torch import Tensor

    from flightdepth.runtimes.contract import Precision
    from flightdepth.runtimes.network import Network
    from flightdepth.stillbox import OutdoorTestSet, TestPair, TestSet
    from flightdepth.training import Recipe
    from flightdepth.training.run_folder import Trained
    from flightdepth.weights.card import NetworkCard
    from flightdepth.weights.store import StoredNetwork

Weights: TypeAlias = "dict[str, Tensor]"
PRECISIONS: tuple[Precision, ...] = ("bf16", "int8")  # whose cost is measured
INT8_PAIRS = 64  # whose largest values are the ranges of int8
LENSES_DEG = (45.0, 60.0, 90.0, 110.0)  # that a network for any lens is calibrated through
HALF_COST_LIMIT = 0.01  # of the test error: half-precision storage must not cost more


def export(
    trained: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run's folder, or one of its checkpoints.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the two files.")] = Path(),
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the network. Default: the recipe's.")
    ] = None,
    full_precision: Annotated[
        bool, typer.Option("--full-precision", help="Store weights as float32, twice the size.")
    ] = False,
    mean_with: Annotated[
        str | None,
        typer.Option(
            metavar="NETWORK", help="Take the mean of the weights with those that training went on from."
        ),
    ] = None,
    scenes: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, help="Scenes of the fixed test set that the card's errors are from."
        ),
    ] = 300,
) -> None:
    """Write NAME.onnx and its card NAME.json from a training run.

    The averaged weights are stored in half precision where that costs at most 1 %
    of the test error, and measured on the fixed test set.

      flightdepth export runs/depthnet-256 --out networks

    After some more training from a shipped network, half-way back to it is often
    better on what was not trained for (Wortsman et al. 2022, WiSE-FT):

      flightdepth export runs/motion --mean-with motion --out networks
    """
    with extra_packages("flightdepth export", "train"):
        from flightdepth.evaluation.fixed_set import fixed_set
        from flightdepth.training.checkpoint import read_weights
        from flightdepth.training.recipe import FILE_NAME, FILE_NAME_RULE
        from flightdepth.training.run_folder import read_trained
        from flightdepth.weights.store import read_network
    if name is not None and not re.match(FILE_NAME, name):
        raise BadInput("--name", expected=FILE_NAME_RULE, got=repr(name))
    run = read_trained(trained)
    card = card_of(run, run.recipe.name if name is None else name)
    weights = read_weights(run.checkpoint, "averaged")
    card = card.model_copy(update={"metrics": carried_over(run)})
    if mean_with is not None:
        other = read_network(mean_with)
        weights = mean_of(weights, other)
        card = card.model_copy(update={"mean_with": other.card.sha256})
    make_folder("--out", out)
    pairs = rendered(fixed_set(card, scenes=scenes), "test set")
    path = write_network(run.recipe, weights, card, pairs, out, full_precision=full_precision)
    say(f"next: flightdepth evaluate network {path}")


def card_of(run: Trained, name: str) -> NetworkCard:
    """The card without what is measured: metrics and hash."""
    from flightdepth.renderers.raycast import VERSION
    from flightdepth.scenes.config import SET_VERSION
    from flightdepth.training.run_folder import stored_renderers
    from flightdepth.weights.card import FLIGHT_DETAIL, NetworkCard, Predecessor

    recipe, before = run.recipe, run.first_shipped
    if not run.stages:
        raise BadInput(f"checkpoint {run.checkpoint}", expected="some training", got="none yet")
    stages = (before.stages if before else ()) + run.stages
    went_on_from = None
    if before is not None and before.name == name:
        l1_m = before.metrics.get("l1_m")
        went_on_from = Predecessor(sha256=before.sha256, samples=before.samples, l1_m=l1_m)
    last = stages[-1]
    card = NetworkCard(
        **recipe.model_dump(include=NetworkCard.model_fields.keys() - {"name", "stages"}),
        name=name,
        D0_m=recipe.nominal_shift * recipe.scenes.step_m,
        focal_px=recipe.reference_focal_px or last.focal_px,
        any_lens=recipe.reference_focal_px is not None,
        width=last.width,
        height=last.height,
        samples=run.progress.seen,
        stages=stages,
        went_on_from=went_on_from,
        renderer=stored_renderers(run.checkpoint.parent) or VERSION,
        set_version=SET_VERSION,
    )
    return card.at_focal(FLIGHT_DETAIL * card.focal_px)


def mean_of(weights: Weights, other: StoredNetwork) -> Weights:
    """Half-way between trained weights and those of a network file of the same architecture.

    Of residual blocks that the other lacks half remains.
    """
    from flightdepth.architectures.motionnet import silent_blocks
    from flightdepth.training.export import weights_of

    before = silent_blocks(weights) | weights_of(other.onnx)
    if {name: each.shape for name, each in before.items()} != {n: each.shape for n, each in weights.items()}:
        expected = "a network of the run's architecture and width"
        raise BadInput("--mean-with", expected=expected, got=other.card.name)
    return {
        name: (each + before[name]) / 2 if each.is_floating_point() else each
        for name, each in weights.items()
    }


def rendered(pairs: TestSet | OutdoorTestSet, title: str) -> list[TestPair]:
    """Every pair of a set, with a progress bar."""
    return list(counted(pairs, title, "scenes"))


def write_network(
    recipe: Recipe,
    weights: Weights,
    card: NetworkCard,
    pairs: list[TestPair],
    out: Path,
    *,
    full_precision: bool,
) -> Path:
    """Choose the storage, measure, write; the ONNX file's path."""
    from flightdepth.evaluation.network_tables import number
    from flightdepth.runtimes.devices import BF16_COST
    from flightdepth.training.export import deployed, to_onnx
    from flightdepth.weights.store import save_network

    exact = to_onnx(deployed(recipe, weights))
    onnx, storage = (exact, "float32") if full_precision else stored(exact, card, pairs)
    calibration = calibration_pairs(card, len(pairs))
    card = with_int8_ranges(card, onnx, calibration)
    card = with_sigma_scale(card, onnx, calibration)
    metrics = measured(card, onnx, pairs)
    metrics = metrics if BF16_COST in metrics else card.metrics | metrics
    card = card.model_copy(update={"metrics": metrics})
    path = save_network(out, card, onnx)
    say(f"{path}: {len(onnx) / 1e6:.1f} MB, {storage}, {card.samples:,} training pairs")
    own, constant, classical = (
        number(card.metrics.get(f"{who}l1_m"), 3) for who in ("", "constant_", "classical_")
    )
    say(f"L1 {own} m on {len(pairs)} scenes; best constant {constant} m, classical peer {classical} m")
    return path


def stored(exact: bytes, card: NetworkCard, pairs: list[TestPair]) -> tuple[bytes, str]:
    """The ONNX file, in half precision unless that costs too much, and how it is stored."""
    from flightdepth.evaluation.network import relative_cost
    from flightdepth.training.export import in_half_precision

    half = in_half_precision(exact)
    networks = (running(card, exact), running(card, half))
    cost = relative_cost(*networks, pairs)["relative_cost"]
    said = f"{cost:+.3%} of the test error" if cost is not None else "an unknown part of the test error"
    if cost is None or cost > HALF_COST_LIMIT:
        return exact, f"float32 (half precision would cost {said})"
    return half, f"half precision (costs {said})"


def carried_over(run: Trained) -> dict[str, float]:
    """What bf16 cost the shipped weights that this run went on from, for a CPU that can't tell what it costs these."""
    from flightdepth.runtimes.devices import BF16_COST_BEFORE, bf16_cost

    before = run.shipped
    if before is None or before.name != run.recipe.name:
        return {}
    cost = bf16_cost(before)
    return {} if cost is None else {BF16_COST_BEFORE: cost}


def calibration_pairs(card: NetworkCard, scenes: int) -> list[TestPair]:
    """Pairs that neither training nor a test uses.

    For a network for any lens rooms are seen through `LENSES_DEG` in turn, every other pair is outdoors, and then come
    some as large as it sees flights, so many that they have as many pixels in all.
    """
    from flightdepth.evaluation.sigma_scale import calibration_set, outdoor_calibration_set
    from flightdepth.weights.card import FLIGHT_DETAIL

    if not card.any_lens:
        fewer = min(scenes, INT8_PAIRS)  # all of them only for sigma
        return rendered(calibration_set(card, scenes=fewer), "calibration")
    pairs = []
    for flight_size in (False, True):
        half = max(1, scenes // 2 // (FLIGHT_DETAIL**2 if flight_size else 1))
        lenses = [
            calibration_set(card, scenes=half, horizontal_fov_deg=fov_deg, flight_size=flight_size)
            for fov_deg in LENSES_DEG
        ]
        outdoors = outdoor_calibration_set(card, scenes=half, flight_size=flight_size)
        for scene in counted(range(half), "calibration", "scenes"):
            pairs += [lenses[scene % len(lenses)].pair(scene), outdoors.pair(scene)]
    return pairs


def with_int8_ranges(card: NetworkCard, onnx: bytes, pairs: list[TestPair]) -> NetworkCard:
    """The card with what must be known to run the network on bytes."""
    from flightdepth.evaluation.int8_ranges import fitted_int8_ranges

    ranges = fitted_int8_ranges(card, onnx, pairs[:INT8_PAIRS])
    return card.model_copy(update={"int8_ranges": ranges})


def with_sigma_scale(card: NetworkCard, onnx: bytes, pairs: list[TestPair]) -> NetworkCard:
    """The card of a network that tells its error bar, with what that is multiplied by; any other as it is."""
    if not card.knows_direction:
        return card
    from flightdepth.evaluation.sigma_scale import fitted_sigma_scale

    fitted = fitted_sigma_scale(running(card, onnx), pairs)
    scale, finer = fitted.sigma_scale, 2**fitted.sigma_lens - 1
    sky = scale * math.exp(fitted.sigma_growth)
    say(
        f"sigma_m is {scale:.3f} times what the weights say, up to {sky:.3f} where all is sky,"
        f" and {finer:.1%} more at twice the focal length: then 68 % of the errors are inside it"
    )
    return card.model_copy(update=fitted._asdict() | {"sigma_scale": round(scale, 4)})


def measured(card: NetworkCard, onnx: bytes, pairs: list[TestPair]) -> dict[str, float]:
    """The card's metrics; what is not defined is left out, and the cost of what can't even be emulated."""
    from flightdepth.evaluation.network import evaluate_network, relative_cost

    exact = running(card, onnx)
    found = evaluate_network(exact, pairs, set_name="fixed")
    metrics: dict[str, Any] = {"scenes": float(len(pairs))}
    metrics |= {key: found["network"][key] for key in ("l1_m", "rmse_m", "abs_rel")}
    metrics["delta_125"] = found["network"]["delta"]
    metrics |= {f"{peer}_l1_m": found[peer]["l1_m"] for peer in ("constant", "classical")}
    for precision in PRECISIONS:
        cost = relative_cost(exact, running(card, onnx, precision), pairs)
        if cost["largest_change"]:  # without AVX-512 OpenVINO goes on in float32
            metrics[f"{precision}_relative_cost"] = cost["relative_cost"]
    return {key: value for key, value in metrics.items() if value is not None}


def running(card: NetworkCard, onnx: bytes, precision: Precision = "f32") -> Network:
    """The network on this machine's CPU."""
    from flightdepth.runtimes.network import Network
    from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime

    return Network(card, OpenVinoRuntime(onnx, precision=precision, ranges=card.int8_ranges))
