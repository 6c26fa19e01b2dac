"""Which code and which network a number came from."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flightdepth.runtimes.judge import judge_sha256
from flightdepth.runtimes.network import Network


def source_commit(folder: Path = Path(__file__).parent) -> str | None:
    """Commit of the working copy that holds `folder`, "+changes" where files differ; None without one."""
    commit = git(folder, "rev-parse", "HEAD")
    if commit is None:
        return None
    # An installed package may lie inside a stranger's repository: its own files must be tracked there.
    if git(folder, "ls-files", "--error-unmatch", __file__) is None:
        return None
    return f"{commit}+changes" if git(folder, "status", "--porcelain", "--untracked-files=no") else commit


def network_facts(network: Network) -> dict[str, Any]:
    """Its name, its weights and what runs them; `judge_sha256` None where depth is not aligned with the pictures."""
    aligned = network.card.knows_direction and network.aligned
    return {
        "name": network.card.name,
        "weights_sha256": network.card.sha256,
        "judge_sha256": judge_sha256() if aligned else None,
        "runtime": network.runtime.description,
    }


def origin(facts: Mapping[str, Any]) -> str:
    """Where a figure comes from, in a line, of `network_facts` and its `commit`."""
    return (
        f"{facts['runtime']}, weights {facts['weights_sha256'][:16]}, commit {facts['commit'] or 'unknown'}"
    )


def origin_of(network: Network) -> str:
    """Where a figure of this network comes from, in a line, if it was measured now."""
    return origin(network_facts(network) | {"commit": source_commit()})


def git(folder: Path, *command: str) -> str | None:
    """Output of a git command, or None where it fails or git is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *command], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
