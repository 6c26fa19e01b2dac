"""What `flightdepth run` takes of memory at most, on the sample flight: python benchmarks/memory.py [--end S].

The whole process: Python, the video's decoder, the engine and its weights, the earlier pictures that it may pair,
files and film that it writes. Linux and macOS.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

from flightdepth.commands.demo import SAMPLE
from flightdepth.commands.terminal import counted

WAYS = (
    ("motion",),
    ("motion", "--detail", "2"),
    ("motion", "--ranges", "1"),
    ("motion-tiny",),
    ("motion-tiny", "--detail", "2"),
    ("depthnet-256",),
    ("tiny-clamped-256",),
)
BYTES = 1 if sys.platform == "darwin" else 1024  # that ru_maxrss counts in


def most_mb(options: tuple[str, ...], end_s: float) -> float:
    """Megabytes, resident, of one run of the sample flight's first seconds."""
    with tempfile.TemporaryDirectory() as folder:
        flight = (str(SAMPLE / "flight.mp4"), "--telemetry", str(SAMPLE / "telemetry.csv"))
        lens = ("--camera", str(SAMPLE / "camera.json"))
        command = (sys.executable, "-m", "flightdepth", "run", *flight, *lens, "--end", str(end_s))
        out = ("--out", str(Path(folder) / "depth"), "--network", *options)
        with (Path(folder) / "said").open("w+") as said:
            run = subprocess.Popen((*command, *out), stdout=said, stderr=subprocess.STDOUT)
            _, status, usage = os.wait4(run.pid, 0)
            if status:
                said.seek(0)
                raise SystemExit(said.read())
    return usage.ru_maxrss * BYTES / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--end", type=float, default=5.0, help="second of the flight at which to stop")
    end_s = parser.parse_args().end
    table = Table("run --network", "MB", title=f"the most memory, first {end_s:g} s of the sample flight")
    for options in counted(WAYS, "runs", "runs"):
        table.add_row(" ".join(options), f"{most_mb(options, end_s):.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()
