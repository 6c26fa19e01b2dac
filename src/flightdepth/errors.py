"""The errors a user can meet: one line each, saying what, expected, got and how to mend it."""

from __future__ import annotations


class FlightDepthError(Exception):
    """Something could not be done. The command line prints its text as one line and exits with `exit_code`."""

    exit_code = 3


class BadInput(FlightDepthError):
    """What the user gave cannot be used: a file, an option or a value. Exit code 2."""

    exit_code = 2

    def __init__(
        self, what: str, *, expected: str | None = None, got: str | None = None, mend: str | None = None
    ) -> None:
        parts = [what]
        if expected is not None:
            parts.append(f"expected {expected}")
        if got is not None:
            parts.append(f"got {got}")
        text = ": ".join([parts[0], ", ".join(parts[1:])]) if len(parts) > 1 else what
        super().__init__(f"{text}. {mend}" if mend else text)


class MissingExtra(FlightDepthError):
    """A feature needs an optional package that is not installed."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an optional package: pip install 'flightdepth[{extra}]'")
        self._given = feature, extra

    def __reduce__(self) -> tuple[type[MissingExtra], tuple[str, str]]:
        """So that it comes back from another machine."""
        return MissingExtra, self._given
