"""What a topic's publishers offer, as a subscription that gets all of it and as a log states it."""

from collections.abc import Sequence

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import QosDurability, QosReliability

from egophys_core.recording import LATCHED_QOS, TopicQos


def offered_qos(profiles: Sequence[QoSProfile]) -> TopicQos:
    """The strongest quality that all publishers of a topic offer, so that all of them match.

    How many messages they keep is not told over the network: what is kept for late subscribers is taken for
    state, of which the last message counts.
    """
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in profiles)
    keeps = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
    return TopicQos(
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if keeps else QosDurability.VOLATILE,
        depth=LATCHED_QOS.depth if keeps else TopicQos().depth,
    )


def subscription_qos(qos: TopicQos) -> QoSProfile:
    """A subscription that matches, and drops nothing however late it is served."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )
