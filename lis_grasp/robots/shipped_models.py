"""Paths of the shipped hand models."""

from pathlib import Path

from lis_grasp.exceptions import InvalidFileError

HAND_NAMES = ("allegro", "wsg50", "barrett")
"""The hands that the package ships, by the name that `Hand.load` takes."""

VENDOR_HANDS = (
    *("allegro_right", "allegro_left", "leap", "shadow", "barrett_bh280", "schunk_svh"),
    *("robotiq_2f85", "panda_hand", "jaco", "dex3_left", "ability_hand", "inspire_hand"),
    *("wuji_right", "dex5_right", "linker_l10", "linker_o7", "robotiq_3f"),
)
"""Vendors' hands whose YAML the package ships; the model is installed apart, as an error says."""

READY_HANDS = (*HAND_NAMES, *VENDOR_HANDS)
"""Every hand whose YAML the package ships."""

_PACKAGE = Path(__file__).resolve().parent.parent


def model_path(relative: str) -> Path:
    """Return the path of a shipped model file or folder below ``models/``.

    Raises `InvalidFileError` if the package ships no such file.
    """
    # The wheel carries models/ as lis_grasp/_models; a source checkout has it beside the package.
    for root in (_PACKAGE / "_models", _PACKAGE.parent / "models"):
        path = root / relative
        if path.exists():
            return path
    raise InvalidFileError(
        f"the package ships no model '{relative}'; give the path of a file instead"
    )
