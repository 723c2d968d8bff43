"""recorder_node: writes topics as they are, not decoded, to a rosbag2 MCAP log."""

import sys
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import declare_names, declare_number, declare_texts
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node

from egophys_core.errors import RecordingError
from egophys_twin.topic_recording import TopicRecording

TOPICS_PARAMETER = {"topics": ([""], "names of the topics to record; types are found when they appear")}
FOLDER_PARAMETER = {"output_folder": ("", "rosbag2 folder to write; must not exist when the node activates")}
STATUS_PERIOD_S = 0.5


class RecorderNode(ManagedNode):
    """Records the topics of its list while it is active; a log for each activation."""

    def __init__(self) -> None:
        """Declare the parameters."""
        super().__init__("recorder_node")
        declare_names(self, TOPICS_PARAMETER)
        declare_texts(self, FOLDER_PARAMETER)
        doc = "age, s, at which messages are on disk; a killed recorder loses younger ones"
        declare_number(self, "flush_interval_s", 1.0, low=0.05, high=60.0, doc=doc)
        self._topics: list[str] = []
        self._recording: TopicRecording | None = None

    def configure(self) -> None:
        """Check the parameters; nothing is written yet."""
        names = filter(None, self.get_parameter("topics").value)
        self._topics = list(dict.fromkeys(self.resolve_topic_name(name) for name in names))
        if not self._topics:
            raise RecordingError("nothing to record; set the parameter topics to a list of topic names")
        if not self.get_parameter("output_folder").value:
            raise RecordingError("nowhere to record to; set the parameter output_folder")
        self._folder = Path(self.get_parameter("output_folder").value).expanduser().absolute()
        self._status = self.own(self.create_publisher(DiagnosticStatus, "~/status", latched()), self.destroy_publisher)
        self.own(self.create_timer(STATUS_PERIOD_S, self._publish_status), self.destroy_timer)

    def activate(self) -> None:
        """Open the log and record what is published, and what comes to be published later."""
        self._recording = TopicRecording(
            self,
            self._topics,
            self._folder,
            flush_interval_s=self.get_parameter("flush_interval_s").value,
            on_failure=self.refuse,
        )

    def deactivate(self) -> None:
        """Stop listening and finish the log."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.close()

    def status(self) -> str:
        """Whether anything is recorded, and where to."""
        return f"recording {len(self._topics)} topics to {self._folder}" if self._recording else "not recording"

    def opening_line(self) -> str:
        """Where to; `~/status` tells of each topic."""
        return self.status()

    def fault(self) -> str:
        """What is not recorded, though it was asked for."""
        return self._recording.fault() if self._recording else ""

    def health(self) -> dict[str, str]:
        """Messages written of each topic."""
        return self._recording.states() if self._recording else {}

    def _publish_status(self) -> None:
        self._status.publish(self.diagnostic(self.health()))


def main() -> int:
    """Run the node; the exit code."""
    return run_node(RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
