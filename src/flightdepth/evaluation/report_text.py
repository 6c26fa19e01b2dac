"""The report's words: the lead, the verdicts, the table, the settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any

from flightdepth.evaluation.network_tables import number
from flightdepth.evaluation.ranges_claims import FAILS, HOLDS, LEAST_SCENES, OPEN
from flightdepth.evaluation.ranges_trials import NOISE_RAD

# Title and explanation of each plot, in the order of the page.
PLOT_TEXTS = {
    "time": (
        "Error against time",
        "The paper's last figure. A point is one number of ranges n, drawn beside it. "
        "Lower and further left is better.",
    ),
    "spans": (
        "Near, middle, far",
        "The same trials by true depth. A network that is clamped to 10-60 m at 0.5 m has to be good far "
        "away to be worth it.",
    ),
    "coverage": (
        "Where the error comes from",
        "A pair can answer only from its network's least to its greatest output times the displacement. The bar is "
        "the mean error, split by where the truth lay among the ranges of the frame's pairs; the dash is what would "
        "be left if each pixel took the best of its ranges, chosen with the truth in sight.",
    ),
    "pairs": (
        "How the pairs are chosen",
        "Always the frame that was flown D0 ago; the one whose displacement suits the mean depth; one "
        "for each of two clusters of depth.",
    ),
    "ranges": (
        "How many ranges",
        "Solid: the paper's fusion of n ranges. Dotted: the best of the n at each pixel, chosen with the truth in "
        "sight, which no fusion can reach. Where solid does not fall with dotted, the ranges see it and the fusion "
        "loses it. The paper's system has at most four.",
    ),
    "noise": (
        "Orientation noise",
        "Each frame is turned by N0 about a fresh random axis, which nobody reports; 0.001 rad moves the "
        "picture by an eighth of a pixel. Green and dotted: as flightdepth run flies by default, with what "
        "rotation the pictures show taken out, and over the pixels only that it claims to know.",
    ),
    "speed": (
        "A wrong speed",
        "Depth is proportional to the displacement that the log tells. A bias (left) goes into depth as it is. Noise "
        "of each sample (right; 20 a second, flown at 1 m/s) averages out over a displacement, the better the "
        "longer it is.",
    ),
    "telemetry": (
        "How often the log speaks",
        "The speed (1 m/s) is told with noise, at this rate, and integrated. The more samples within a "
        "displacement, the less of the noise is left.",
    ),
    "shifts": (
        "The shifts that were used",
        "How many frames back each range looked: median and quartiles over all frames.",
    ),
    "fusion": (
        "What it does not claim to know",
        "Open: the paper's fusion gives each pixel a depth. Full: the default takes the ends of a "
        "network's range as bounds, drops ranges that "
        "contradict each other, and leaves those pixels unknown. The errors belong to different pixels. The line: as "
        "`flightdepth run` flies, with one to four ranges.",
    ),
    "flicker": (
        "Flicker",
        "Depth of one frame, moved by the motion, against that of the next: the median change of a pixel.",
    ),
    "confidence": (
        "Confidence",
        "Confidence is meant as the chance that depth is right within 25 %. On the diagonal it keeps its "
        "word; below, it promises too much.",
    ),
}
CHIPS = {HOLDS: "holds", FAILS: "fails", OPEN: "open"}


def lead(found: Mapping[str, Any]) -> str:
    """Heading and what the page is about."""
    about, config = found["about"], found["about"]["sequences"]["config"]
    frames = about["sequences"]["frames"]
    missing = about["missing_networks"]
    left_out = f" Not in this build, so left out: {escape(', '.join(missing))}." if missing else ""
    return (
        "<h1>Depth from several ranges, with noise</h1>"
        f"<p>{about['scenes']} synthetic flights of {frames} frames at "
        f"{config['speed_m_s'] * config['time_step_s']:g} m "
        f"a frame, {about['sequences']['width']} px, orientation noise N0 = {NOISE_RAD:g} rad where "
        "nothing else is said; the path keeps "
        f"{config['clearance_m']:g} m from everything. The estimator flies as it would on a drone: its "
        "own clusters choose its own pairs. "
        "Error is |estimate - truth| / truth over the pixels that have both, the truth not "
        "clipped. Whiskers are 95 % intervals over scenes; scenes differ more than methods do, so methods are "
        f"compared scene by scene, under What holds.{left_out}</p>"
    )


def verdicts(found: Mapping[str, Any]) -> str:
    """Each claim with its comparisons; what decides is the interval of the paired difference over scenes."""
    groups = groupby(found["claims"], key=lambda row: row["claim"])
    listed = [(claim, list(rows)) for claim, rows in groups]
    text = "".join(f"<h3>{escape(claim)}: {tally(rows)}</h3>{_comparisons(rows)}" for claim, rows in listed)
    if not text:
        return ""
    rule = (
        "<p>A comparison holds when the 95 % interval of the difference of relative errors, paired scene by "
        "scene, lies below 0; it does not hold when the interval lies above. With fewer than "
        f"{LEAST_SCENES} scenes nothing is decided.</p>"
    )
    return rule + text


def tally(rows: Sequence[Mapping[str, Any]]) -> str:
    """How often each verdict fell, in words."""
    counts = {said: sum(row["verdict"] == said for row in rows) for said in (HOLDS, FAILS, OPEN)}
    return ", ".join(f"{said} in {count}" for said, count in counts.items() if count)


def _comparisons(rows: list[Mapping[str, Any]]) -> str:
    cells = "".join(
        f"<tr><td><span class='chip {CHIPS[row['verdict']]}'>{row['verdict']}</span></td>"
        f"<td style='text-align:left'>{escape(versus(row, 'against'))}</td><td>{number(row['ratio'], 2)}</td>"
        f"<td>{points(row['difference']['low'])} to {points(row['difference']['high'])}</td>"
        f"<td>{row['scenes_better']} of {row['scenes']}</td></tr>"
        for row in rows
    )
    heads = "<tr><th></th><th></th><th>error, ratio</th><th>difference, 95 %</th><th>scenes better</th></tr>"
    return (
        f"<div class='wide'><table class='claims'><thead>{heads}</thead><tbody>{cells}</tbody></table></div>"
    )


def versus(row: Mapping[str, Any], joint: str) -> str:
    """The two sides of a comparison, and under what they were compared where it is not all depths and NOISE_RAD."""
    span = "" if row["span"] == "all" else f", {row['span']} depths"
    noise = "" if row["noise_rad"] == NOISE_RAD else f", N0 = {row['noise_rad']:g}"
    return f"{row['better']} {joint} {row['worse']}{span}{noise}"


COLUMNS = (
    ("error", "mean |error| / truth, all depths"),
    ("95 %", "bootstrap interval over scenes"),
    ("near", "true depth below 15 m"),
    ("middle", "15 to 50 m"),
    ("far", "50 to 150 m"),
    ("&lt; 1.25", "pixels within a factor of 1.25"),
    ("known", "pixels with a depth"),
    ("flicker", "median change between frames beyond the motion"),
    ("shifts", "median shift of each range, frames"),
    ("same frame", "frames in which ranges chose the same one"),
    ("network ms", "processor time of the network, one core"),
    ("all ms", "processor time of the whole frame, one core"),
)


def table(found: Mapping[str, Any]) -> str:
    """Every trial, a row each."""
    heads = "".join(f"<th title='{escape(told)}'>{name}</th>" for name, told in COLUMNS)
    rows = "".join(f"<tr><td>{escape(name_of(row))}</td>{_cells(row)}</tr>" for row in found["trials"])
    head = f"<thead><tr><th></th>{heads}</tr></thead>"
    return f"<div class='wide'><table>{head}<tbody>{rows}</tbody></table></div>"


def name_of(row: Mapping[str, Any]) -> str:
    """A trial in words: what is not as in the paper's figure is said."""
    trial, log = row["trial"], row["trial"]["telemetry"]
    told = [row["label"]]
    told += ["default fusion"] if trial["fusion"] == "saturation" else []
    told += [f"N0 {trial['noise_rad']:g}"] if trial["noise_rad"] != NOISE_RAD else []
    told += [f"speed noise {log['noise_m_s']:g} m/s"] if log["noise_m_s"] else []
    told += [f"speed {log['bias']:+.0%}"] if log["bias"] else []
    told += [f"{log['rate_hz']:g} Hz"] if log["rate_hz"] != 20 else []
    return ", ".join(told)


def _cells(row: Mapping[str, Any]) -> str:
    errors, whole = row["errors"], row["errors"]["all"]
    shifts = [f"{middle:.0f}" for _, middle, _ in row["shifts"]["quartiles"]]
    interval = f"{points(whole['abs_rel']['low'])} to {points(whole['abs_rel']['high'])}"
    cells = [points(whole["abs_rel"]["mean"]), interval]
    cells += [points(errors[span]["abs_rel"]["mean"]) for span in ("near", "middle", "far")]
    cells += [points(whole[key]["mean"]) for key in ("delta", "known")]
    cells += [points(row["flicker"]["mean"]), ", ".join(shifts) or "-", points(row["shifts"]["coincide"])]
    cells += [number(row["predict_ms"], 1), number(row["whole_ms"], 1)]
    return "".join(f"<td>{cell}</td>" for cell in cells)


def settings(found: Mapping[str, Any]) -> str:
    """Where the figures come from."""
    about = found["about"]
    told = {
        "command": "flightdepth evaluate ranges",
        "sequences": f"{about['scenes']} of {about['sequences']['frames']} frames, measured from frame "
        f"{about['measured_from_frame']} on; seed {about['sequences']['seed']}, set "
        f"{about['sequences']['set_version']}, "
        f"{about['sequences']['renderer']}",
        "machine": about["machine"],
        "code": about["commit"],
    }
    told |= {f"weights of {name}": sha[:16] for name, sha in about["weights_sha256"].items()}
    told |= {f"runtime of {name}": text for name, text in about["runtimes"].items()}
    return (
        "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(str(v))}</dd>" for k, v in told.items()) + "</dl>"
    )


def points(share: float | None) -> str:
    """A share in per cent; a dash where there is none."""
    return "-" if share is None else f"{100 * share:.1f} %"
