"""What an object is that a record shows at a few markers."""

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.kinds import KINDS, Kind, kind_named
from egophys_core.kinds.kind import FromMarkers, MarkerBody, SeenMarkers
from egophys_core.kinds.template import Template


def marker_body(seen: SeenMarkers, template: Template | None = None, kind: str | None = None) -> MarkerBody:
    """What markers show.

    Args:
        seen: the record.
        template: what the object looks like, if that is known.
        kind: name of one, given by the user; by default the first that knows the markers.

    Raises:
        EpisodeError: the markers do not tell a direction, or are not those of the kind given.
        OptionsError: a kind that is not modelled from markers.
    """
    for each in [kind_named(kind)] if kind else [each for each in KINDS.values() if each.from_markers]:
        found = marker_model(each).body(seen, template)
        if found is not None:
            return found
    raise EpisodeError(
        f"{seen.name}: its {len(seen.tracks)} markers and {len(seen.held)} held points are not those of a "
        f"{kind or 'known kind'} (those of a rod lie one after the other); leave the kind out, or give another template"
    )


def marker_model(kind: Kind) -> FromMarkers:
    """How a kind is modelled from markers.

    Raises:
        OptionsError: it is not.
    """
    if kind.from_markers is None:
        others = ", ".join(each.name for each in KINDS.values() if each.from_markers)
        raise OptionsError(
            f"a {kind.name} is modelled from what is seen all over its surface; what is seen at a few markers is one "
            f"of {others}: choose one of these, or leave the kind out"
        )
    return kind.from_markers
