"""The effects of a batch as its kernels see them: which functions they are composed of, and which numbers these read.

Every kernel with effects has those of the whole library, and a lane group skips what none of its rollouts has: one for
each choice of effects would have to be compiled for each. Only an effect from outside makes a kernel of its own.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from egophys_core.effects import LIBRARY, NAMES
from egophys_core.effects.effect import Effect
from egophys_core.lanes import LANES, Lanes, group_count, pack
from egophys_core.simulation.batch import BatchEffect, RolloutBatch
from egophys_core.simulation.terms.effects import ABSENT, NO_LAW, SEVERAL_LAWS, EffectArrays, EffectTerms


def effect_terms(batch: RolloutBatch) -> EffectTerms | None:
    """What the kernels of a batch are composed of; None without effects."""
    if not batch.effects:
        return None
    if all(each.effect.name in NAMES for each in batch.effects):
        return library_terms()
    return _terms([each.effect for each in batch.effects])


@cache
def library_terms() -> EffectTerms:
    """Of the whole library."""
    return _terms([LIBRARY[name] for name in NAMES])


def _terms(effects: Sequence[Effect]) -> EffectTerms:
    return EffectTerms(
        forces=tuple((each.name, each.node_force.function) for each in effects if each.node_force),
        laws=tuple(
            (each.name, each.spring_law.function, each.spring_law.memories) for each in effects if each.spring_law
        ),
    )


def first_columns(batch: RolloutBatch) -> dict[str, int]:
    """Where the numbers of each effect begin, by name."""
    ends = np.cumsum([0, *(each.numbers.shape[1] for each in batch.effects)])
    return {each.effect.name: int(first) for each, first in zip(batch.effects, ends, strict=False)}


def memory_count(batch: RolloutBatch) -> int:
    """Numbers that each spring of the batch remembers."""
    return sum(each.effect.spring_law.memories for each in batch.effects if each.effect.spring_law)


def effect_arrays(batch: RolloutBatch, device: str, *, requires_grad: bool = False) -> EffectArrays:
    """What the kernels of a batch read of its effects."""
    arrays = EffectArrays()
    values = [each.numbers for each in batch.effects] or [np.zeros((batch.count, 1), np.float32)]
    packed = pack(np.concatenate(values, axis=1))
    arrays.numbers = wp.array(packed, dtype=Lanes, device=device, requires_grad=requires_grad)
    terms, groups = effect_terms(batch) or EffectTerms(forces=(), laws=()), group_count(batch.count)
    names = [*(name for name, _ in terms.forces), *(name for name, *_ in terms.laws)]
    columns = np.full((groups, len(names)), ABSENT, np.int32)
    slots = np.zeros(max(len(terms.laws), 1), np.int32)
    remembered, first = 0, first_columns(batch)
    for each in batch.effects:
        effect = each.effect
        if not (effect.node_force or effect.spring_law):
            continue
        index = names.index(effect.name)
        columns[_groups_with(each), index] = first[effect.name]
        if effect.spring_law:
            slots[index - len(terms.forces)] = remembered
            remembered += effect.spring_law.memories
    laws = columns[:, len(terms.forces) :] != ABSENT
    alone = laws.argmax(axis=1) if laws.shape[1] else np.zeros(groups, int)
    law = np.select([laws.sum(axis=1) == 0, laws.sum(axis=1) == 1], [NO_LAW, alone], SEVERAL_LAWS)
    arrays.columns = wp.array(columns, dtype=int, device=device)
    arrays.slots = wp.array(slots, dtype=int, device=device)
    arrays.law = wp.array(law.astype(np.int32), dtype=int, device=device)
    return arrays


def _groups_with(effect: BatchEffect) -> np.ndarray:
    """[G'] lane groups of which a rollout has the effect."""
    return np.unique(np.flatnonzero(effect.present) // LANES)
