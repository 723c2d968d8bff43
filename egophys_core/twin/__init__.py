"""The twin of an object: its spring graph, parameters, provenance, and its file."""

from egophys_core.twin.codebook import Codebook
from egophys_core.twin.directions import level_axes
from egophys_core.twin.graph import SpringGraph, SpringKind, bridge_components, connect, connected_components
from egophys_core.twin.model import ObjectModel, chain, per_kind
from egophys_core.twin.parameters import GRAVITY, PhysicalParameters
from egophys_core.twin.spring_features import static_features
from egophys_core.twin.storage import TWIN_FILE, decode_twin, encode_twin, load_twin, save_twin
from egophys_core.twin.twin import Provenance, Twin

__all__ = [
    "GRAVITY",
    "TWIN_FILE",
    "Codebook",
    "ObjectModel",
    "PhysicalParameters",
    "Provenance",
    "SpringGraph",
    "SpringKind",
    "Twin",
    "bridge_components",
    "chain",
    "connect",
    "connected_components",
    "decode_twin",
    "encode_twin",
    "level_axes",
    "load_twin",
    "per_kind",
    "save_twin",
    "static_features",
]
