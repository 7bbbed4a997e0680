"""Errors raised on purpose; each says what was required, what came, and what to do."""

import reprlib

# Messages name what came, which may be a whole damaged file: the middle of such is left out.
_LONGEST = 800


def shown(value: object) -> str:
    """Return a value as a message names it: short, however large or deep the value is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an int of more digits than Python writes
        return f"a very long {type(value).__name__}"


class LisGraspError(Exception):
    """Base of every error that the package raises on purpose; its message is one line."""

    def __init__(self, message: str) -> None:
        line = " ".join(message.split("\n")).strip()
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
        super().__init__(line)


class InvalidContactsError(LisGraspError):
    """Contacts that no surface can be estimated from, or that contradict their own format."""


class InvalidMeshError(LisGraspError):
    """A mesh that cannot be used as an object and could not be repaired."""


class InvalidHandError(LisGraspError):
    """A hand description (YAML or URDF) that is incomplete or contradicts itself."""


class InvalidOptionError(LisGraspError):
    """An option outside its permitted range or set."""


class InvalidFileError(LisGraspError):
    """A file that is missing, unreadable, or not of the format its name promises."""


class EstimationError(LisGraspError):
    """A surface that could not be estimated or meshed from valid contacts."""


class SimulationError(LisGraspError):
    """A simulation that diverged or could not be set up."""
