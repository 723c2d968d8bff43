"""What perception has to say of a video, in the bag with the points it made of it, for who builds from these."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from egophys_core.perception.remarks import Level, Remark
from egophys_core.recording import jazzy_types, list_topics, read_records

REPORT_TOPIC = "/perception/report"
STRING = "std_msgs/msg/String"


def report_message(report: Mapping[str, Any]) -> bytes:
    """The CDR of a report, as `report.json` has it."""
    types = jazzy_types()
    return bytes(types.serialize_cdr(types.types[STRING](data=json.dumps(report)), STRING))


def recorded_remarks(bag: Path) -> tuple[Remark, ...]:
    """The remarks on the video that a bag's points were perceived in; none of points from elsewhere.

    Raises:
        RecordingError: not a bag.
    """
    if not any(topic.name == REPORT_TOPIC and topic.type == STRING for topic in list_topics(bag)):
        return ()
    messages: list[Any] = [
        jazzy_types().deserialize_cdr(each.cdr, STRING) for each in read_records(bag, (REPORT_TOPIC,))
    ]
    return tuple(
        Remark(**{**remark, "level": Level(remark["level"])})
        for message in messages
        for remark in json.loads(message.data)["remarks"]
    )
