"""What the multi-range study compares: each trial is one method, flown in one way, over every sequence."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

from flightdepth.ranges.fusion import Fusion

NOISE_RAD = 0.001  # N0 of the paper's noisy scenes
NOISES_RAD = (0.0, 0.0005, 0.001, 0.002, 0.003, 0.005, 0.01)
SPEED_NOISES_M_S = (0.0, 0.1, 0.2, 0.4)
SPEED_BIASES = (-0.2, -0.1, 0.0, 0.1, 0.2)
RATES_HZ = (5.0, 10.0, 20.0, 50.0)
NOISY_SPEED_M_S = 0.2  # at which rates are compared: without noise a constant speed needs one sample
# What `--quick` leaves of them.
QUICK = {
    "noise_rad": (0.0, 0.001, 0.003, 0.01),
    "noise_m_s": (0.0, NOISY_SPEED_M_S, 0.4),
    "bias": (-0.1, 0.0, 0.1),
    "rate_hz": (5.0, 20.0, 50.0),
    "ranges": (0, 1, 2, 4, 6),
}

DEPTHNET, CLAMPED, TINY, MOTION = "depthnet-256", "clamped-256", "tiny-clamped-256", "motion"
FLOW, CONSTANT = "DIS flow", "best constant"
# The paper's last figure, the networks beyond it, and how many ranges each is given.
FIGURE = {DEPTHNET: (1, 2), CLAMPED: (1, 2, 3), TINY: (1, 2, 3, 4), MOTION: (1, 2, 3)}
KNOWN = (*FIGURE, FLOW, CONSTANT)  # any other method is a network that the user names


@dataclass(frozen=True)
class Telemetry:
    """The velocity log: its rate; noise per axis and sample, m/s; bias, a share of the speed.

    directed  whether it tells the direction to the camera; else its axes are unrelated to the camera's
    """

    rate_hz: float = 20.0
    noise_m_s: float = 0.0
    bias: float = 0.0
    directed: bool = True


@dataclass(frozen=True)
class Trial:
    """method: a network's name, FLOW or CONSTANT. ranges: n of the estimator; 0 pairs each frame with the one D0
    before it at the nominal speed, always. noise_rad: N0 of the pictures. derotate: as the estimator's.
    """

    method: str
    ranges: int
    fusion: Fusion = "paper"
    noise_rad: float = NOISE_RAD
    derotate: bool = False
    telemetry: Telemetry = field(default_factory=Telemetry)

    @property
    def facts(self) -> dict[str, Any]:
        """As JSON has it; `trial_of` is the way back."""
        return asdict(self)

    def digest(self, settings: dict[str, Any]) -> str:
        """Of the trial and of all that its result depends on."""
        text = json.dumps([self.facts, settings], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @property
    def label(self) -> str:
        """What a table calls it, where the noise and the log are said elsewhere."""
        if self.method == CONSTANT:
            return "best constant depth"
        shown = self.method if self.telemetry.directed else f"{self.method}, direction estimated"
        pairs = "fixed shift" if self.ranges == 0 else f"n = {self.ranges}"
        return f"{shown}, {pairs}, derotated" if self.derotate else f"{shown}, {pairs}"


def trial_of(facts: dict[str, Any]) -> Trial:
    """The trial that `Trial.facts` told."""
    return Trial(**{**facts, "telemetry": Telemetry(**facts["telemetry"])})


def figure() -> tuple[Trial, ...]:
    """The paper's last figure, with the paper's fusion."""
    return tuple(Trial(method, n) for method, counts in FIGURE.items() for n in counts)


def peers() -> tuple[Trial, ...]:
    """What does without a network, and what does without a known direction."""
    unknown = Telemetry(directed=False)
    flows = [Trial(FLOW, n, telemetry=log) for log in (Telemetry(), unknown) for n in (1, 2)]
    return (*flows, Trial(MOTION, 2, telemetry=unknown), Trial(CONSTANT, 0))


def named(methods: Iterable[str]) -> tuple[Trial, ...]:
    """Networks that the user names: as those of the figure, with one and two ranges, and as `flightdepth run` flies."""
    methods = tuple(methods)
    return (*_plain(methods), *(as_run(method=method) for method in methods))


def side_by_side(trials: Collection[Trial]) -> tuple[Trial, ...]:
    """Of these trials those of the figure, in its order: its methods, networks that the user names, the peers."""
    others = dict.fromkeys(trial.method for trial in trials if trial.method not in KNOWN)
    return tuple(trial for trial in (*figure(), *_plain(others), *peers()) if trial in trials)


def _plain(methods: Iterable[str]) -> tuple[Trial, ...]:
    return tuple(Trial(method, n) for method in methods for n in (1, 2))


def default_fusion() -> tuple[Trial, ...]:
    """As `flightdepth run` does it: outputs at the ends of a range are bounds."""
    counts = {DEPTHNET: (1, 2), CLAMPED: (1, 2), TINY: (1, 2, 4), MOTION: (1, 2, 3)}
    return tuple(Trial(method, n, "saturation") for method, ns in counts.items() for n in ns)


def orientation_noise() -> tuple[Trial, ...]:
    """N0 from none to ten times the paper's; the last as `flightdepth run` flies."""
    flown = ((DEPTHNET, 1), (CLAMPED, 1), (TINY, 1), (MOTION, 2), (FLOW, 1))
    plain = [Trial(method, n, noise_rad=noise) for noise in NOISES_RAD for method, n in flown]
    return (*plain, *(as_run(noise) for noise in NOISES_RAD))


def as_run(noise_rad: float = NOISE_RAD, *, ranges: int = 2, method: str = MOTION) -> Trial:
    """The defaults of `flightdepth run` (motion, two ranges, bounds, seen rotation taken out), with as many ranges."""
    return Trial(method, ranges, "saturation", noise_rad, derotate=True)


def as_flown() -> tuple[Trial, ...]:
    """`flightdepth run` with one to four ranges."""
    return tuple(as_run(ranges=n) for n in range(1, 5))


def wrong_speed() -> tuple[Trial, ...]:
    """A speed with noise, and a biased one."""
    logs = [Telemetry(noise_m_s=noise) for noise in SPEED_NOISES_M_S]
    return _told([*logs, *(Telemetry(bias=bias) for bias in SPEED_BIASES)])


def log_rates() -> tuple[Trial, ...]:
    """A noisy speed told at several rates."""
    return _told([Telemetry(rate_hz=rate, noise_m_s=NOISY_SPEED_M_S) for rate in RATES_HZ])


def _told(logs: Iterable[Telemetry]) -> tuple[Trial, ...]:
    flown = (DEPTHNET, TINY, MOTION, FLOW)
    return tuple(dict.fromkeys(Trial(method, 1, telemetry=log) for log in logs for method in flown))


# What `--sweep` knows, in the order of flying.
SWEEPS: dict[str, Callable[[], tuple[Trial, ...]]] = {
    # One fixed shift; beside the optimal shift (one range) and the clusters of the figure.
    "shift": lambda: tuple(Trial(method, 0) for method in (*FIGURE, FLOW)),
    "noise": orientation_noise,
    "speed": wrong_speed,
    "telemetry": log_rates,
    "fusion": lambda: (*default_fusion(), *as_flown()),
    # n up to 6; the paper's system has at most 4.
    "ranges": lambda: tuple(Trial(method, n) for method in FIGURE for n in range(1, 7)),
}


def all_trials(
    sweeps: Iterable[str] = (), *, quick: bool = False, networks: Iterable[str] = ()
) -> tuple[Trial, ...]:
    """The figure, `networks` and the peers, and what is swept, every trial once; `quick`: fewer settings of a sweep."""
    swept = [trial for name in sweeps for trial in SWEEPS[name]() if not quick or is_quick(trial)]
    return tuple(dict.fromkeys((*figure(), *named(networks), *peers(), *swept)))


def is_quick(trial: Trial) -> bool:
    """Whether a sweep keeps the trial where time is short."""
    settings = asdict(trial) | asdict(trial.telemetry)
    few = trial.fusion == "paper" or trial.ranges == 2
    kept = few and all(settings[name] in values for name, values in QUICK.items())
    return kept or trial in as_flown()
