"""What the names of a folder's pictures tell: their order, and where they are times, these."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from flightdepth.errors import BadInput
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.still import SUFFIXES
from flightdepth.flight.universal_time import can_be

DIGITS = re.compile(r"([0-9]+)")
# Seconds since 1970 with a point (TUM), nano- (EuRoC, AirSim), micro- or milliseconds without. All begin with 1 until
# May 2033, and what begins with 20 is a date, as some cameras write it.
TIME = re.compile(
    r"(?<![0-9])(?:(?P<s>1[0-9]{9})\.(?P<fraction>[0-9]{1,9})|1[0-9]{18}|1[0-9]{15}|1[0-9]{12})(?![0-9])"
)
RESULT = "flight.json"  # in a folder that `run` wrote
LISTED = 5  # folders in a message
UNIT_NS = {19: 1, 16: 1_000, 13: 1_000_000}  # by the number of digits


class Named(NamedTuple):
    """A picture's name and its number, or the time that the name tells, ns since 1970."""

    number: int
    name: str


def pictures_in(folder: Path) -> list[str]:
    """Names of the pictures that lie directly in a folder, all of one kind; hidden and other files are left alone."""
    what = f"pictures in {folder}"
    try:
        with os.scandir(folder) as entries:  # which tells files from folders without asking for each
            shown = [entry for entry in entries if not entry.name.startswith(".")]
            files = [entry.name for entry in shown if not entry.is_dir()]
    except OSError as error:
        raise BadInput(what, expected="a readable folder", got=error.strerror or str(error)) from error
    if RESULT in files:
        mend = f"Look at it with `flightdepth view {folder}`, or give the video itself."
        raise BadInput(
            f"flight {folder}", expected="a video, or pictures", got="what `run` wrote of one", mend=mend
        )
    names = [name for name in files if Path(name).suffix.lower() in SUFFIXES]
    kinds = Counter(Path(name).suffix.lower() for name in names)
    if not kinds:
        raise BadInput(
            what,
            expected="some (PNG, JPEG, BMP, TIFF, WebP, PPM, PGM)",
            got=f"a folder of {len(files)} other files" if files else "a folder without files",
            mend=f"Give the folder in which they lie{_folders_named(shown)}, or a video.",
        )
    if len(kinds) > 1:
        got = " and ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        raise BadInput(what, expected="one kind", got=got, mend="Give each kind a folder of its own.")
    try:
        "".join(names).encode()
    except UnicodeEncodeError as error:
        raise BadInput(what, expected="names in UTF-8", got="others", mend="Rename them.") from error
    return names


def _folders_named(entries: Sequence[os.DirEntry[str]]) -> str:
    """The folders among entries, for a message."""
    folders = sorted(entry.name for entry in entries if entry.is_dir())
    if not folders:
        return ""
    more = f" and {len(folders) - LISTED} more" if len(folders) > LISTED else ""
    return f" (here are {', '.join(folders[:LISTED])}{more})"


def by_time(names: Sequence[str]) -> list[Named] | None:
    """Pictures in the order of the times that their names tell, ns since 1970; None where they tell none.

    Before and after the time all names are the same.
    """
    found = [TIME.search(name) for name in names]
    times = [Named(_since_1970_ns(match), match.string) for match in found if match is not None]
    around = {
        (match.string[: match.start()], match.string[match.end() :].lower()) for match in found if match
    }
    told = len(times) == len(names) and len(around) == 1 and all(can_be(time.number) for time in times)
    return sorted(times) if told else None


def _since_1970_ns(match: re.Match[str]) -> int:
    if match["s"] is None:
        return int(match[0]) * UNIT_NS[len(match[0])]
    return int(match["s"]) * NS_PER_S + int(match["fraction"].ljust(9, "0"))


def by_number(folder: Path, names: Sequence[str]) -> list[Named]:
    """Pictures in the order of the one number in which their names differ.

    Raises:
        BadInput: they differ in more, so that they may be several series.
    """
    parts = {name: DIGITS.split(Path(name).stem) for name in names}  # text at even places, digits at odd ones
    texts = {tuple(part[::2]) for part in parts.values()}
    numbers = {name: tuple(int(digits) for digits in part[1::2]) for name, part in parts.items()}
    places = [place for place, told in enumerate(zip(*numbers.values(), strict=False)) if len(set(told)) > 1]
    if len(texts) > 1 or len(places) > 1 or (not places and len(names) > 1):
        ordered = sorted(names, key=lambda name: (parts[name][::2], numbers[name]))
        raise BadInput(
            f"pictures in {folder}",
            expected="one series, whose names differ in one number alone",
            got=f"{ordered[0]} and {ordered[-1]} among {len(names)}",
            mend="Give each series a folder of its own, or number the pictures: 000001.png.",
        )
    place = places[0] if places else None
    return sorted(Named(0 if place is None else numbers[name][place], name) for name in names)


def periods(folder: Path, pictures: Sequence[Named]) -> list[int]:
    """Where numbered pictures lie in their series, the first at 0; where numbers are left out, time passed.

    They may count by any step, as in every tenth of a series: the largest that leads to all of them is one period.

    Raises:
        BadInput: more are left out than are there, so that the numbers hardly count pictures.
    """
    first = pictures[0].number
    steps = [picture.number - first for picture in pictures]
    step = math.gcd(*steps) or 1
    if steps[-1] // step + 1 > 2 * len(steps):
        raise BadInput(
            f"pictures in {folder}",
            expected="numbers that count them",
            got=f"{len(steps)} numbered {first} to {pictures[-1].number}",
            mend="Number them one by one, or name them by their times: 19 digits, nanoseconds since 1970.",
        )
    return [each // step for each in steps]
