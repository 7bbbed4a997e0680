"""Errors raised on purpose; each says what was required, what came, and what to do."""


class LisGraspError(Exception):
    """Base of every error that the package raises on purpose."""


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
