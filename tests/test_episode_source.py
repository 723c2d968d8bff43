"""Where episodes come from: points if there are any, video if told or if there is nothing else."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from egophys_core import episode_source
from egophys_core.episode import Episode
from egophys_core.episode_source import EpisodeSource, Source, is_video, load_episodes, require_episode
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.identification import episode_digest
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.perceive import Perceived, PerceptionReport
from egophys_core.perception.remarks import Level, Remark
from egophys_core.perception.report_message import REPORT_TOPIC, STRING, report_message
from egophys_core.recording import (
    SENSOR_QOS,
    LogWriter,
    inspect_recording,
    list_topics,
    read_episode,
    read_records,
    write_episode,
)

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
VIDEO, POINTS = EXAMPLES / "towel_lift_video.mcap", EXAMPLES / "towel_lift_video_points.mcap"
REPORT = PerceptionReport(
    frames=2,
    posed=2,
    pose_inferred=0,
    scale_is_known=True,
    kind="sheet",
    thickness_m=0.0,
    tracked=3,
    coverage=1.0,
    hand_seen=2,
    grip_frame=0,
    notes=("a note",),
    seconds=(),
    remarks=(Remark(name="rest", level=Level.DOUBTFUL, text="it hardly rests", advice="wait"),),
)
NEVER_RESTS = Remark(name="rest", level=Level.BAD, text="it never rests", advice="do not touch it")


def merged(folder, *bags, frames=5, said=None):
    """A bag with the first messages of each topic of several bags, and with a report of perception if there is one."""
    with LogWriter(folder) as log:
        if said is not None:
            log.add_topic(REPORT_TOPIC, STRING)
            log.write(REPORT_TOPIC, report_message(dataclasses.asdict(said)), 1_700_000_000_000_000_000)
        for bag in bags:
            for topic in list_topics(bag):
                log.add_topic(topic.name, topic.type, SENSOR_QOS)
                for record in list(read_records(bag, [topic.name]))[:frames]:
                    log.write(record.topic, record.cdr, record.log_time_ns)
    return folder


def untidy_episode():
    """What no reader would give: another NaN, places of no confidence, times between nanoseconds."""
    points = np.zeros((2, 3, 3), np.float32)
    points[:] = [[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.0, 0.1, 0.1]]
    points[1, 1] = np.array([0xFFC00001] * 3, np.uint32).view(np.float32)
    confidence = np.ones((2, 3), np.float32)
    confidence[1, 1] = 0.0
    return Episode(
        name="video.mcap",
        times=np.array([0.0, 1 / 30]),
        points=points,
        confidence=confidence,
        point_ids=np.arange(3, dtype=np.uint32),
        controllers=np.zeros((2, 1, 3), np.float32),
        controller_ids=np.arange(1, dtype=np.uint32),
        ground_height=0.001,
    )


@pytest.fixture
def both(tmp_path):
    """A bag with points and video."""
    return merged(tmp_path / "both", VIDEO, POINTS)


@pytest.fixture
def perception(monkeypatch):
    """Perception that answers at once; gives the calls it got."""
    calls = []

    def perceive(path, *, options, board, progress):
        calls.append((path, options, board))
        for stage, share in (("camera poses", 0.5), ("camera poses", 1.0), ("shape", 0.5), ("shape", 1.0)):
            progress(stage, share)
        return Perceived(episode=untidy_episode(), start_ns=1, report=REPORT)

    monkeypatch.setattr(episode_source, "perceive", perceive)
    return calls


@pytest.mark.parametrize(
    ("source", "expected"),
    [(Source.AUTO, (True, False, False)), (Source.POINTS, (False,) * 3), (Source.VIDEO, (True,) * 3)],
)
def test_points_are_taken_unless_there_are_none_or_video_is_asked_for(both, source, expected):
    chosen = EpisodeSource(source=source)
    assert tuple(is_video(path, chosen) for path in (VIDEO, POINTS, both)) == expected


def test_points_under_other_names_count(both):
    assert is_video(both, EpisodeSource(object_topic="/a", controller_topic="/b"))


def test_what_an_episode_needs_is_looked_for_before_the_work(both):
    for path, source in ((both, Source.AUTO), (VIDEO, Source.AUTO), (VIDEO, Source.VIDEO), (POINTS, Source.POINTS)):
        require_episode(path, inspect_recording(path), EpisodeSource(source=source))
    hands_alone = [topic for topic in inspect_recording(POINTS) if topic.name == "/controller/points"]
    for topics, source, reason in (
        (inspect_recording(POINTS), {"source": Source.VIDEO}, "no images; the recording has /object/points"),
        (inspect_recording(VIDEO), {"source": Source.POINTS}, "no messages on /object/points; the recording has /ego"),
        (inspect_recording(POINTS), {"object_topic": "/towel"}, "no messages on /towel; "),
        (hands_alone, {}, "no messages on /object/points; the recording has /controller/points"),
        ([], {}, "no messages on /object/points; the recording has no topics at all"),
    ):
        with pytest.raises(RecordingError, match=f"bag: {reason}"):
            require_episode(Path("bag"), topics, EpisodeSource(**source))


def test_recorded_points_are_read_as_ever(both, perception):
    (loaded,) = load_episodes([both], EpisodeSource())
    assert loaded.report is None
    assert not perception
    assert episode_digest(loaded.episode) == episode_digest(read_episode(both))


def test_a_perceived_episode_is_what_a_reader_of_its_recording_gets(both, perception, tmp_path):
    options = PerceptionOptions(queries=200)
    (loaded,) = load_episodes([both], EpisodeSource(source=Source.VIDEO, perception=options))
    assert perception == [(both, options, EpisodeSource().board)]
    assert loaded.report == REPORT
    episode = loaded.episode
    assert (episode.name, episode.ground_height) == ("video.mcap", 0.001)
    write_episode(episode, tmp_path / "again", start_ns=1_700_000_000_000_000_000)
    again = read_episode(tmp_path / "again", ground_height=0.001)
    for field in dataclasses.fields(Episode):
        one, other = (getattr(each, field.name) for each in (episode, again))
        if isinstance(one, np.ndarray):
            assert one.tobytes() == other.tobytes(), field.name


def test_a_video_in_which_nothing_is_held_is_refused_even_if_forced(monkeypatch):
    episode = dataclasses.replace(
        untidy_episode(), controllers=np.zeros((2, 0, 3), np.float32), controller_ids=np.zeros(0, np.uint32)
    )
    remark = Remark(name="hands", level=Level.BAD, text="no hand is seen", advice="handle it")
    report = dataclasses.replace(REPORT, remarks=(*REPORT.remarks, remark))
    found = Perceived(episode=episode, start_ns=1, report=report)
    monkeypatch.setattr(episode_source, "perceive", lambda path, **_: found)
    for force in (False, True):
        with pytest.raises(
            EpisodeError, match=r"towel_lift_video\.mcap: no hand is seen: handle it\. .*--force neither"
        ):
            load_episodes([VIDEO], EpisodeSource(force=force))


def test_a_poor_video_is_taken_only_by_force(monkeypatch, tmp_path):
    poor = dataclasses.replace(REPORT, remarks=(*REPORT.remarks, NEVER_RESTS))
    found = Perceived(episode=untidy_episode(), start_ns=1, report=poor)
    monkeypatch.setattr(episode_source, "perceive", lambda path, **_: found)
    # As `egophys perceive` leaves it: points, with what was said of the video.
    perceived = merged(tmp_path / "perceived", POINTS, said=poor)
    for path in (VIDEO, perceived):
        with pytest.raises(EpisodeError) as refused:
            load_episodes([path], EpisodeSource())
        assert f"{path.name}: the video is poor: it never rests: do not touch it. " in str(refused.value)
        assert "--force" in str(refused.value)
        assert "hardly" not in str(refused.value)
        (loaded,) = load_episodes([path], EpisodeSource(force=True))
        assert loaded.report == (poor if path == VIDEO else None)
    (usable,) = load_episodes([merged(tmp_path / "usable", POINTS, said=REPORT)], EpisodeSource())
    assert usable.episode.frames == 5


def test_progress_goes_through_all_recordings_and_stops_where_told(perception):
    told = []
    load_episodes([VIDEO, POINTS], EpisodeSource(), progress=lambda stage, share: told.append((stage, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert told[0] == (f"read {VIDEO.name}", 0.0)
    assert told[-1] == (f"read {POINTS.name}", 0.5)
    assert {stage for stage, _ in told} >= {"perceive: camera poses", "perceive: shape"}

    def stop(stage, share):
        if stage == "perceive: shape":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_episodes([VIDEO], EpisodeSource(), progress=stop)


def test_a_bag_with_neither_says_what_it_has(tmp_path):
    with LogWriter(tmp_path / "words") as log:
        log.add_topic("/words", "std_msgs/msg/String")
    for source in Source:
        with pytest.raises(RecordingError, match="/words"):
            load_episodes([tmp_path / "words"], EpisodeSource(source=source))
