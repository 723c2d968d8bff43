"""`egophys perceive BAG --out DIR`."""

import argparse
import heapq
import shutil
import time
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import Report, print_json, print_remarks, print_table, progress_bar
from egophys_core.cli.object_argument import add_object_argument, with_object
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.files import new_folder, require_apart, write_atomically, write_json
from egophys_core.json_numbers import nulled
from egophys_core.options import to_mapping
from egophys_core.perception.options import PerceptionOptions

if TYPE_CHECKING:
    from egophys_core.perception.camera.board import Board
    from egophys_core.perception.observation import Observation
    from egophys_core.perception.perceive import Perceived

IMAGE_TOPIC, INFO_TOPIC = "/ego/image_raw/compressed", "/ego/camera_info"
OVERLAY_TOPIC = "/perception/overlay/compressed"
VIEW_FRAME = "ego_camera_view"
"""Frame of the overlays: the square, upright view of the camera."""
EPISODE_NAME, SHEET_NAME, VIDEO_NAME, REPORT_NAME = "episode", "contact_sheet.png", "overlay.mp4", "report.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("bag", type=Path, metavar="BAG", help=".mcap or .db3 file or rosbag2 folder with a video")
    parser.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="DIR",
        help=f"new or empty folder for {EPISODE_NAME}/, {SHEET_NAME}, {VIDEO_NAME} and {REPORT_NAME}",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    add_topic_arguments(parser)
    add_board_arguments(parser, prefix="board-", placed=True)
    add_object_argument(parser)
    add_option_arguments(parser, PerceptionOptions)


def add_topic_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that name the topics of the video; the defaults are those of `open_video`."""
    parser.add_argument("--image-topic", default=IMAGE_TOPIC, metavar="TOPIC", help=f"default {IMAGE_TOPIC}")
    parser.add_argument("--info-topic", default=INFO_TOPIC, metavar="TOPIC", help=f"default {INFO_TOPIC}")


def run(parsed: argparse.Namespace) -> int:
    """Perceive and write."""
    options, board = with_object(options_from(parsed, PerceptionOptions), parsed.object), board_from(parsed)
    require_apart(parsed.out, [parsed.bag])
    with new_folder(parsed.out) as folder, progress_bar() as report:
        began = time.perf_counter()
        topics = {"image_topic": parsed.image_topic, "info_topic": parsed.info_topic}
        perceived = _perceive(parsed.bag, folder, options, board, topics, report)
        content = {
            "video": parsed.bag.resolve().name,
            "start_stamp_ns": perceived.start_ns,
            "duration_s": float(perceived.episode.times[-1]),
            "elapsed_s": time.perf_counter() - began,
            "options": to_mapping(options),
            "board": _board_content(board),
            **nulled(asdict(perceived.report)),
        }
        write_json(folder / REPORT_NAME, content)
    if parsed.json:
        print_json({"out": str(parsed.out), **content})
        return 0
    _print_report(perceived)
    print(f"{EPISODE_NAME}/, {SHEET_NAME}, {VIDEO_NAME} and {REPORT_NAME} written to {parsed.out}")
    _print_verdict(perceived)
    return 0


def _perceive(
    bag: Path, folder: Path, options: PerceptionOptions, board: "Board", topics: dict[str, str], report: Report
) -> "Perceived":
    """Perceive, and write the episode and the pictures into the folder."""
    import numpy as np

    from egophys_core.perception.camera.image_encoding import COMPRESSED_IMAGE, jpeg_message, png_of
    from egophys_core.perception.contact_sheet import EvenSample, contact_sheet
    from egophys_core.perception.overlay import TAIL_VIEWS, draw_picture
    from egophys_core.perception.overlay_video import OverlayVideo
    from egophys_core.perception.overlay_window import Window, follow
    from egophys_core.perception.perceive import perceive
    from egophys_core.perception.report_message import REPORT_TOPIC, STRING, report_message
    from egophys_core.recording import SENSOR_QOS, LogWriter, write_episode

    sample: EvenSample[np.ndarray] = EvenSample()
    tails: deque[np.ndarray] = deque(maxlen=TAIL_VIEWS)
    windows: deque[Window] = deque(maxlen=1)
    first_stamp_ns: list[int] = []
    pictures, points, said = (folder / f"{name}.part" for name in ("pictures", "points", "said"))
    with LogWriter(pictures) as log, OverlayVideo(folder / VIDEO_NAME) as video:
        log.add_topic(OVERLAY_TOPIC, COMPRESSED_IMAGE, SENSOR_QOS)

        def show(observation: "Observation") -> None:
            stamp_ns = observation.view.stamp_ns
            if not first_stamp_ns:
                first_stamp_ns.append(stamp_ns)
            label = (
                f"view {video.pictures}, {(stamp_ns - first_stamp_ns[0]) * 1e-9:.2f} s, "
                f"{np.count_nonzero(observation.visible)} of {len(observation.visible)} points seen"
            )
            windows.append(follow(observation.masks.object, windows[0] if windows else None))
            picture = draw_picture(observation, window=windows[0], tails=tuple(tails), label=label)
            tails.append(np.where(observation.visible[:, None], observation.pixels, np.nan))
            sample.add(picture)
            video.write(stamp_ns, picture)
            log.write(OVERLAY_TOPIC, jpeg_message(picture, stamp_ns=stamp_ns, frame_id=VIEW_FRAME), stamp_ns)

        perceived = perceive(bag, **topics, options=options, board=board, on_observation=show, progress=report)
    write_episode(perceived.episode, points, start_ns=perceived.start_ns)
    with LogWriter(said) as log:
        log.add_topic(REPORT_TOPIC, STRING)
        log.write(REPORT_TOPIC, report_message(nulled(asdict(perceived.report))), perceived.start_ns)
    _merge(folder / EPISODE_NAME, pictures, points, said)
    title = f"{bag.resolve().name}: {perceived.report.kind}, {perceived.report.tracked} points"
    write_atomically(folder / SHEET_NAME, png_of(contact_sheet(sample.items(), title=title)))
    return perceived


def _merge(merged: Path, *logs: Path) -> None:
    """Write one bag with the messages of several, by time, and remove those."""
    from egophys_core.recording import SENSOR_QOS, LogWriter, list_topics, read_records

    with LogWriter(merged) as log:
        for topic in (topic for each in logs for topic in list_topics(each)):
            log.add_topic(topic.name, topic.type, SENSOR_QOS)
        for record in heapq.merge(*(read_records(each) for each in logs), key=lambda record: record.log_time_ns):
            log.write(record.topic, record.cdr, record.log_time_ns)
    for each in logs:
        shutil.rmtree(each)


def _board_content(board: "Board") -> dict[str, Any]:
    return {
        "columns": board.columns,
        "rows": board.rows,
        "tag_side_m": board.tag_side,
        "gap_m": board.gap,
        "first_id": board.first_id,
        "family": str(board.family),
        "origin_m": list(board.origin),
    }


def _print_report(perceived: "Perceived") -> None:
    found, episode = perceived.report, perceived.episode
    grip = f"view {found.grip_frame}" if found.grip_frame >= 0 else "never"
    rows = [
        ("views", str(found.frames)),
        ("camera pose found, interpolated", f"{found.posed}, {found.pose_inferred}"),
        ("object taken for a", found.kind),
        ("points followed", str(found.tracked)),
        ("of all views and points, with a place", f"{100 * found.coverage:.0f} %"),
        ("points in the episode", str(len(episode.point_ids))),
        ("views with a hand", str(found.hand_seen)),
        ("hand takes hold", grip),
    ]
    if found.thickness_m > 0:
        rows.insert(3, ("height of its skin over the table", f"{1000 * found.thickness_m:.1f} mm"))
    print_table(episode.name, ("found", ""), rows)
    said = {remark.text for remark in found.remarks}
    for note in (note for note in found.notes if note not in said):
        print(f"note: {note}")


def _print_verdict(perceived: "Perceived") -> None:
    report = perceived.report
    rows = [
        (
            f"{second.start_s:.0f}",
            f"{100 * second.coverage:.0f} %",
            f"{100 * second.doubtful:.0f} %",
            f"{second.confidence:.2f}",
            str(second.hands),
            str(second.touching),
        )
        for second in report.seconds
    ]
    header = ("second", "coverage", "doubtful", "confidence", "hands", "touching")
    print_table("of the points, and hands in each second", header, rows)
    print_remarks("for a twin", report.remarks)
    print(report.verdict + ("; `egophys build` refuses it without --force" if report.verdict == "poor" else ""))
