"""What drives a twin in an episode: points that hold, as they were recorded, and the middle of hands that press."""

import numpy as np

from egophys_core.episode import Episode
from egophys_core.observation.contact import Hand, contact_flags
from egophys_core.simulation import ContactKind, Controls


def controls_of(episode: Episode, hands: tuple[Hand, ...]) -> Controls:
    """The episode's controllers, which hold; behind them a point for each hand that ever presses, which presses.

    A hand that presses is a ball about its middle. It is not told when it touches what it pushed once more, nor need it
    be, as it never pulls: it presses until it takes hold, or to the end.
    """
    held = contact_flags(episode, hands)
    held[held == ContactKind.PRESS] = ContactKind.NONE
    positions, contact = [episode.controllers], [held]
    for hand in hands:
        presses = _presses(hand, episode.frames)
        if presses.any():
            middle = episode.controllers[:, hand.controllers].mean(axis=1, keepdims=True)
            positions.append(middle.astype(np.float32))
            contact.append(np.where(presses, ContactKind.PRESS, ContactKind.NONE).astype(np.uint8)[:, None])
    return Controls(
        times=episode.times, positions=np.concatenate(positions, axis=1), contact=np.concatenate(contact, axis=1)
    )


def _presses(hand: Hand, frames: int) -> np.ndarray:
    """[T] bool: frames from each press of a hand to its next hold."""
    presses = np.zeros(frames, bool)
    for contact in hand.contacts:
        presses[contact.first :] = contact.kind == ContactKind.PRESS
    return presses
