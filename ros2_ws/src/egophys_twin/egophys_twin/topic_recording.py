"""One recording: subscriptions to topics as they appear, and the log they are written to."""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription

from egophys_core.errors import RecordingError
from egophys_core.recording import LogWriter
from egophys_twin.message_types import message_class, message_definition
from egophys_twin.offered_qos import offered_qos, subscription_qos

DISCOVERY_PERIOD_S = 0.2
"""How often it is looked whether a topic has a publisher by now."""

WAITING = "no publisher yet"
STOPPED = "recording stopped"


class TopicRecording:
    """Writes what arrives on topics to a log, serialized as it came, until closed.

    Messages are written on the executor's thread: writing is an append, and a flush syncs a chunk of a
    megabyte at most. Meanwhile the middleware keeps what arrives (`subscription_qos`).
    """

    def __init__(
        self,
        node: Node,
        topics: Sequence[str],
        folder: Path,
        *,
        flush_interval_s: float,
        on_failure: Callable[[str, RecordingError], object],
    ) -> None:
        """Open the log and subscribe what is published already.

        Args:
            node: to subscribe with.
            topics: full names.
            folder: rosbag2 folder, must not exist.
            flush_interval_s: age at which messages are written to disk.
            on_failure: called with what failed and why: a topic that cannot be recorded, or the disk.

        Raises:
            RecordingError: the log cannot be made.
        """
        self._node = node
        self._tell = on_failure
        self._log = LogWriter(folder, flush_interval_s=flush_interval_s)
        self._subscriptions: dict[str, Subscription] = {}
        self._counts: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()
        self._states = dict.fromkeys(topics, WAITING)
        self._stopped = ""
        self._refused: list[str] = []
        self._discover()
        self._timers = [
            node.create_timer(DISCOVERY_PERIOD_S, self._discover),
            node.create_timer(flush_interval_s, self._flush),
        ]

    def close(self) -> None:
        """Stop listening and finish the log.

        Raises:
            RecordingError: the disk refuses; what was flushed before stays readable.
        """
        self._stop_listening()
        self._log.close()

    def states(self) -> dict[str, str]:
        """Per topic the number of messages written and of those lost, or why there are none."""
        return self._states | {topic: self._written(topic) for topic in self._subscriptions}

    def _written(self, topic: str) -> str:
        lost = f", {self._lost[topic]} lost" if self._lost[topic] else ""
        return f"{self._counts[topic]}{lost}"

    def fault(self) -> str:
        """What is not recorded though it is published, and why; empty if nothing."""
        return "; ".join(filter(None, [self._stopped, *self._refused]))

    def _discover(self) -> None:
        for topic, state in self._states.items():
            if topic not in self._subscriptions and state == WAITING:
                try:
                    self._subscribe(topic)
                except RecordingError as error:
                    self._states[topic] = str(error)
                    self._refused.append(f"cannot record {topic}: {error}")
                    self._on_failure(f"cannot record {topic}", error)

    def _subscribe(self, topic: str) -> None:
        publishers = self._node.get_publishers_info_by_topic(topic)
        types = sorted({publisher.topic_type for publisher in publishers})
        if not types:
            return
        if len(types) > 1:
            raise RecordingError(f"{topic} is published as {' and as '.join(types)}; rename one of them")
        qos = offered_qos([publisher.qos_profile for publisher in publishers])
        kind = message_class(types[0])
        self._log.add_topic(topic, types[0], qos, message_definition(types[0]))
        self._subscriptions[topic] = self._node.create_subscription(
            kind,
            topic,
            partial(self._write, topic),
            subscription_qos(qos),
            event_callbacks=SubscriptionEventCallbacks(message_lost=partial(self._note_lost, topic)),
            raw=True,
        )

    def _write(self, topic: str, cdr: bytes, info: dict[str, int]) -> None:
        # Not every middleware tells when a message was received; then it is now.
        received_ns = info["received_timestamp"] or self._node.get_clock().now().nanoseconds
        try:
            self._log.write(topic, cdr, received_ns)
            self._counts[topic] += 1
        except RecordingError as error:
            self._on_failure(STOPPED, error)

    def _note_lost(self, topic: str, info: QoSMessageLostInfo) -> None:
        # Messages carry numbers, but rclpy does not tell of which publisher; the middleware counts for each of them.
        is_first = not self._lost[topic]
        self._lost[topic] += info.total_count_change
        try:
            self._log.note_lost(topic, info.total_count_change)
        except RecordingError as error:
            self._on_failure("recording stopped", error)
        if is_first:
            what = f"{topic}: messages were lost before they could be written; the machine or the network is too slow"
            self._on_failure("the log is not complete", RecordingError(what))

    def _flush(self) -> None:
        try:
            self._log.flush()
        except RecordingError as error:
            self._on_failure(STOPPED, error)

    def _on_failure(self, what: str, error: RecordingError) -> None:
        if what == STOPPED:
            if self._stopped:
                return
            self._stopped = f"{what}: {error}"
            self._states = self.states()
            # Half a chunk may be written: what came after it could not be read.
            self._stop_listening()
            with suppress(RecordingError):
                self._log.close()
        self._tell(what, error)

    def _stop_listening(self) -> None:
        while self._timers:
            self._node.destroy_timer(self._timers.pop())
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.popitem()[1])
