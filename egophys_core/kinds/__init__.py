"""What an object is: its rest shape and how it is modelled. One file a kind, behind `kind.Kind`."""

import difflib

import numpy as np

from egophys_core.errors import TwinError
from egophys_core.kinds import lattice, rod, sheet, solid
from egophys_core.kinds.kind import Kind
from egophys_core.twin import ObjectModel

KINDS: dict[str, Kind] = {
    module.KIND.name: module.KIND
    for module in (
        sheet,
        solid,
        rod,
        lattice,
    )
}
"""All kinds by name; of those that know an object when they see it the first is taken."""

__all__ = ["KINDS", "Kind", "kind_named", "kind_of", "node_masses", "resting_height"]


def kind_named(name: str) -> Kind:
    """The kind of a name.

    Raises:
        TwinError: there is none of that name.
    """
    if name not in KINDS:
        near = difflib.get_close_matches(name, KINDS, n=1)
        hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(KINDS)}"
        raise TwinError(f"no kind of object is called {name!r}{hint}")
    return KINDS[name]


def kind_of(model: ObjectModel) -> Kind:
    """What a model is of.

    Raises:
        TwinError: there is no such kind.
    """
    return lattice.KIND if lattice.was_called_solid(model) else kind_named(model.kind)


def node_masses(model: ObjectModel) -> np.ndarray:
    """[N] float32 kg: how the mass of a model is shared among its nodes."""
    return kind_of(model).node_masses(model.graph, model.parameters.total_mass)


def resting_height(model: ObjectModel, positions: np.ndarray) -> float:
    """z in metres at which a model whose nodes are at [N, 3] on a table touches it."""
    return kind_of(model).resting_height(positions)
