"""Pictures of surfaces and grasps in a notebook, which are drawn by modules above their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from lis_grasp.grasping.grasps import GraspSearch
    from lis_grasp.stages.estimate import SurfaceEstimate
    from lis_grasp.surfaces import ImplicitSurface

# Cells along a displayed surface; a picture needs fewer than grasps do.
_CELLS = 40
_SHOWN, _PIXELS = 4, (240, 200)  # grasps, and the size of the picture of each


def register(formatter: Any) -> None:
    """Add the pictures to IPython's `DisplayFormatter`, which finds a type by its name."""
    png, html = (formatter.formatters[kind] for kind in ("image/png", "text/html"))
    png.for_type_by_name("lis_grasp.surfaces.queries", "Predicting", surface_png)
    png.for_type_by_name("lis_grasp.stages.estimate", "SurfaceEstimate", estimate_png)
    html.for_type_by_name("lis_grasp.grasping.grasps", "GraspSearch", search_html)


def surface_png(surface: ImplicitSurface) -> bytes:
    """Return a picture of a surface in the colours of its uncertainty."""
    from lis_grasp.meshing import extract_mesh
    from lis_grasp.visualization.still import Still

    resolution = float((surface.bounds[1] - surface.bounds[0]).max()) / _CELLS
    return Still(solid=extract_mesh(surface, resolution=resolution)).png()


def estimate_png(estimate: SurfaceEstimate) -> bytes:
    """Return a picture of an estimate's mesh, by uncertainty, with its contacts."""
    from lis_grasp.visualization.still import Still

    bad = np.flatnonzero(estimate.verdicts.bad)
    return Still(solid=estimate.mesh, contacts=estimate.contacts, bad_contacts=bad).png()


def search_html(search: GraspSearch) -> str:
    """Return pictures of the best grasps above the table of all; the table without their hand."""
    from lis_grasp.exceptions import LisGraspError
    from lis_grasp.robots.hand import Hand
    from lis_grasp.visualization.notebook import image
    from lis_grasp.visualization.still import Still

    table = search._repr_html_()
    try:
        hand = Hand.load(search.best.hand)
        stills = [Still(hand=hand, grasp=grasp).png(_PIXELS) for grasp in search[:_SHOWN]]
    except LisGraspError:  # no grasp, or a hand of another machine
        return table
    return f"<div>{''.join(image(png, _PIXELS[0]) for png in stills)}{table}</div>"
