"""Recorded points -> Episode: each rule of `decode_episode`, and the way back."""

import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from egophys_core.episode import Episode
from egophys_core.errors import EpisodeError, RecordingError
from egophys_core.recording import (
    EpisodeWarning,
    PointFrame,
    Record,
    decode_episode,
    encode_points,
    read_episode,
    write_episode,
)
from egophys_core.recording.contact_field import recorded_contact

OBJECT, CONTROLLER = "/object/points", "/controller/points"
FRAME_NS = 33_333_333


def record(topic, stamp_ns, points, *, frame_id="world", type_name="sensor_msgs/msg/PointCloud2", contact=None):
    """A message of points given as {id: (x, y, z)} or {id: (x, y, z, confidence)}, with flags of contact or without."""
    rows = np.array([[*values, 1.0][:4] for values in points.values()], np.float32).reshape(-1, 4)
    cdr = encode_points(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        xyz=rows[:, :3],
        ids=np.array(list(points), np.uint32),
        confidence=rows[:, 3],
        contact=None if contact is None else np.array(contact),
    )
    return Record(topic=topic, type=type_name, log_time_ns=stamp_ns, cdr=cdr)


def objects(count=30, points=None):
    """Points 4 and 2, moving by 25 cm a frame, unless others are given."""
    moving = ({4: (i / 4, 0, 0), 2: (0, i / 4, 0)} for i in range(count))
    return [record(OBJECT, i * FRAME_NS, points or next(moving)) for i in range(count)]


def controllers(count=30, offset_ns=0, missing=()):
    """Controller 1 always seen, controller 5 moving by one centimetre a frame and not seen in `missing`."""
    return [
        record(
            CONTROLLER,
            i * FRAME_NS + offset_ns,
            {1: (0, 0, 1)} | ({} if i in missing else {5: (0.01 * i, 0, 0)}),
        )
        for i in range(count)
    ]


def decode_quietly(records):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return decode_episode(records, name="test")


def test_points_stack_by_id_with_nan_where_missing():
    messages = objects(20)
    messages[3] = record(OBJECT, 3 * FRAME_NS, {4: (7, 8, 9, 0.25)})
    episode = decode_quietly(messages + controllers(20))
    assert episode.points.shape == (20, 2, 3)
    np.testing.assert_array_equal(episode.point_ids, [2, 4])
    np.testing.assert_array_equal(episode.points[3], [[np.nan] * 3, [7, 8, 9]])
    np.testing.assert_array_equal(episode.confidence[3], np.float32([0, 0.25]))
    np.testing.assert_array_equal(episode.points[5], [[0, 1.25, 0], [1.25, 0, 0]])
    np.testing.assert_allclose(episode.times, np.arange(20) * FRAME_NS * 1e-9, atol=1e-12)
    assert episode.name == "test"


def test_times_count_from_the_first_pair():
    with pytest.warns(EpisodeWarning, match="dropped 3 of 20 object and 0 of 17 controller messages"):
        episode = decode_episode(objects(20) + controllers(20)[3:], name="test")
    assert episode.times[0] == 0
    assert episode.frames == 17
    assert episode.points[0, 1, 0] == 0.75


def test_stamps_within_half_a_frame_pair():
    assert decode_quietly(objects() + controllers(offset_ns=FRAME_NS // 2 - 1)).frames == 30


def test_stamps_further_apart_do_not():
    late = [record(CONTROLLER, i * FRAME_NS * 4 + FRAME_NS * 6 // 10, {1: (0, 0, 1)}) for i in range(8)]
    slow_objects = [record(OBJECT, i * FRAME_NS, {1: (i * 0.1, 0, 0)}) for i in range(30)]
    with pytest.warns(EpisodeWarning, match="22 of 30 object and 0 of 8 controller"):
        assert decode_episode(slow_objects + late, name="test").frames == 8
    with (
        pytest.warns(EpisodeWarning, match="30 of 30 object"),
        pytest.raises(EpisodeError, match=r"only 0 of 30 messages .* same clock"),
    ):
        decode_episode(objects() + controllers(offset_ns=40 * FRAME_NS), name="test")


def test_faster_controllers_pair_one_to_one():
    fast = [record(CONTROLLER, i * FRAME_NS // 3, {1: (0.01 * i, 0, 1)}) for i in range(90)]
    with pytest.warns(EpisodeWarning, match="0 of 30 object and 60 of 90 controller"):
        episode = decode_episode(objects() + fast, name="test")
    np.testing.assert_allclose(episode.controllers[:, 0, 0], 0.03 * np.arange(30), atol=1e-6)


def test_messages_out_of_order_are_sorted():
    messages = objects()
    messages[4], messages[9] = messages[9], messages[4]
    with pytest.warns(EpisodeWarning, match="2 of 30 messages are stamped before their predecessor"):
        episode = decode_episode(messages + controllers(), name="test")
    np.testing.assert_array_equal(episode.points[:, 0, 1], np.arange(30) / 4)


@pytest.mark.parametrize("topic", [OBJECT, CONTROLLER])
@pytest.mark.parametrize(
    ("jump_s", "until", "reason"),
    [
        (710407499, 30, r"jump ahead by 710407499\.033 s from frame 9 \(0\.300 s\) to frame 10 \(710407499\.333 s\)"),
        (710407499, 11, "jump ahead by 710407499.* cut the recording there"),
        (11, 30, r"jump ahead by 11\.033 s .*, in one recording at most 10 s ahead; was a clock set"),
        (-5, 30, r"jump back by 4\.967 s from frame 9 .* to frame 10 \(-4\.667 s\), in one recording at most 1 s back"),
    ],
    ids=["for good", "one message", "break", "back"],
)
def test_stamps_that_jump_are_one_error(topic, jump_s, until, reason):
    def stamped(each, frame):
        shift = jump_s if each.topic == topic and 10 <= frame < until else 0
        return record(each.topic, frame * FRAME_NS + shift * 10**9, {1: (0.01 * frame, 0, 0)})

    messages = [stamped(each, frame) for some in (objects(), controllers()) for frame, each in enumerate(some)]
    with pytest.raises(EpisodeError, match=f"test {topic}: the stamps {reason}"):
        decode_quietly(messages)


def test_of_repeated_stamps_the_last_stays():
    again = record(OBJECT, 29 * FRAME_NS, {2: (1, 2, 3)})
    with pytest.warns(EpisodeWarning, match="1 of 31 messages repeat a header stamp"):
        episode = decode_episode([*objects(), again, *controllers()], name="test")
    np.testing.assert_array_equal(episode.points[29], [[1, 2, 3], [np.nan] * 3])


def test_of_an_id_twice_in_a_message_the_last_stays():
    rows = np.float32([[1, 1, 1], [2, 2, 2], [3, 3, 3]])
    cdr = encode_points(stamp_ns=0, frame_id="world", xyz=rows, ids=np.array([2, 4, 2]), confidence=np.ones(3))
    first = Record(topic=OBJECT, type="sensor_msgs/msg/PointCloud2", log_time_ns=0, cdr=cdr)
    with pytest.warns(EpisodeWarning, match="1 points repeat the id"):
        episode = decode_episode([first, *objects()[1:], *controllers()], name="test")
    np.testing.assert_array_equal(episode.points[0], [[3, 3, 3], [2, 2, 2]])


def test_points_not_finite_count_as_not_seen():
    messages = objects()
    messages[6] = record(OBJECT, 6 * FRAME_NS, {2: (np.nan, 0, 0), 4: (np.inf, 0, 0)})
    with pytest.warns(EpisodeWarning, match="2 points with NaN or infinite"):
        episode = decode_episode(messages + controllers(), name="test")
    assert not episode.visible[6].any()
    assert (episode.confidence[6] == 0).all()


def test_points_of_confidence_zero_count_as_not_seen():
    messages = objects()
    messages[6] = record(OBJECT, 6 * FRAME_NS, {2: (1, 1, 1, 0.0), 4: (1, 1, 1, 0.5)})
    episode = decode_quietly(messages + controllers())
    np.testing.assert_array_equal(episode.visible[6], [False, True])


def test_ids_never_seen_are_left_out():
    points = {2: (0, 0, 0), 9: (1, 1, 1, 0.0)}
    np.testing.assert_array_equal(decode_quietly(objects(points=points) + controllers()).point_ids, [2])


def test_short_controller_gap_is_interpolated():
    episode = decode_quietly(objects() + controllers(missing=range(8, 21)))
    np.testing.assert_array_equal(episode.controller_ids, [1, 5])
    np.testing.assert_allclose(episode.controllers[:, 1, 0], 0.01 * np.arange(30), atol=1e-6)


def test_controller_missing_at_the_ends_is_held():
    episode = decode_quietly(objects() + controllers(missing=[0, 1, 2, 29]))
    np.testing.assert_allclose(episode.controllers[:3, 1, 0], 0.03, atol=1e-6)
    np.testing.assert_allclose(episode.controllers[29, 1, 0], 0.28, atol=1e-6)


@pytest.mark.parametrize("missing", [range(8, 24), range(16), range(14, 30)])
def test_controller_missing_longer_is_dropped(missing):
    with pytest.warns(EpisodeWarning, match=r"controller 5 is not seen for 0\.5\d s"):
        episode = decode_episode(objects() + controllers(missing=missing), name="test")
    np.testing.assert_array_equal(episode.controller_ids, [1])


def test_frames_far_apart_are_no_gap():
    messages = [record(OBJECT, i * 10**9, {1: (i, 0, 0)}) for i in range(4)]
    hands = [record(CONTROLLER, i * 10**9, {1: (i, 0, 0)}) for i in range(4)]
    assert decode_quietly(messages + hands).controllers.shape == (4, 1, 3)


def test_no_controller_left_is_an_error():
    hands = [record(CONTROLLER, i * FRAME_NS, {1: (0, 0, 1)} if i < 5 else {}) for i in range(30)]
    with (
        pytest.warns(EpisodeWarning, match="dropped"),
        pytest.raises(EpisodeError, match="no controller on /controller/points is seen throughout"),
    ):
        decode_episode(objects() + hands, name="test")


def test_another_frame_is_refused_with_what_to_write():
    camera = [record(OBJECT, i * FRAME_NS, {1: (i, 0, 0)}, frame_id="camera") for i in range(3)]
    with pytest.raises(EpisodeError, match=r"in frame 'camera', needed is 'world'.* record them with frame_id 'world'"):
        decode_episode(camera, name="test")
    with pytest.raises(EpisodeError, match="in frame 'world', needed is 'camera'"):
        decode_episode(camera + controllers(3), name="test", frame="camera")


def test_millimetres_are_refused():
    large = [record(OBJECT, i * FRAME_NS, {1: (350, 20, 40)}) for i in range(30)]
    with pytest.raises(EpisodeError, match="millimetres"):
        decode_episode(large + controllers(), name="test")


def test_topic_without_messages_or_of_another_type_is_refused():
    with pytest.raises(EpisodeError, match="no messages on /controller/points"):
        decode_episode(objects(), name="test")
    wrong = [record(OBJECT, 0, {1: (0, 0, 0)}, type_name="sensor_msgs/msg/PointCloud")]
    with pytest.raises(RecordingError, match=r"is sensor_msgs/msg/PointCloud, needed is"):
        decode_episode(wrong, name="test")


def test_topics_can_be_named(tmp_path):
    episode = decode_quietly(objects() + controllers())
    write_episode(episode, tmp_path / "bag", object_topic="/a", controller_topic="/b", frame="table")
    with pytest.raises(RecordingError, match=r"no topic /object/points; the bag has /a .*, /b "):
        read_episode(tmp_path / "bag")
    again = read_episode(tmp_path / "bag", object_topic="/a", controller_topic="/b", frame="table", ground_height=0.25)
    np.testing.assert_array_equal(again.points, episode.points)
    assert again.name == "bag"
    assert again.ground_height == 0.25


def holding(flags, *, missing=()):
    """Controllers 1 and 5 with these flags in each frame, 5 not in the frames `missing`; None: without the field."""
    return [
        record(
            CONTROLLER,
            i * FRAME_NS,
            {1: (0, 0, 1)} if i in missing else {5: (0, 0, 2), 1: (0, 0, 1)},
            contact=None if each is None else each[:1] if i in missing else each[::-1],
        )
        for i, each in enumerate(flags)
    ]


def test_contact_of_controllers_is_read_by_id():
    flags = [(1, 0)] * 10 + [(0, 1)] * 20
    episode = decode_quietly(objects() + holding(flags))
    np.testing.assert_array_equal(episode.contact, np.array(flags, bool), strict=True)
    assert decode_quietly(objects() + controllers()).contact is None


def test_a_controller_not_seen_does_what_it_did_before():
    flags = [(1, 0)] * 10 + [(1, 1)] * 20
    episode = decode_quietly(objects() + holding(flags, missing=(0, 1, 10, 11, 12)))
    np.testing.assert_array_equal(episode.contact[:, 1], np.arange(30) >= 13)


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        ([(1, 0)] * 12 + [None] * 18, r"18 of 30 messages, the first in frame 12, have no field contact.*or in none"),
        (
            [(1, 0)] * 7 + [(1, 2)] * 23,
            r"frame 7: contact of controller 5 is 2; it must be 1 .* or 0",
        ),
    ],
    ids=["in some frames", "no flag"],
)
def test_contact_that_is_no_flag_or_comes_and_goes_is_one_error(flags, reason):
    with pytest.raises(RecordingError, match=f"test {CONTROLLER}: {reason}"):
        decode_quietly(objects() + holding(flags))


def test_contact_of_another_type_is_refused():
    forces = PointFrame(
        stamp_ns=0,
        frame_id="world",
        ids=np.array([1], np.uint32),
        xyz=np.zeros((1, 3), np.float32),
        confidence=np.ones(1, np.float32),
        contact=np.array([0.5], np.float32),
    )
    with pytest.raises(RecordingError, match="log: frame 0: field contact must be uint8, got float32"):
        recorded_contact([forces], np.array([1], np.uint32), "log")


@st.composite
def episodes(draw):
    frames, points = draw(st.integers(2, 8)), draw(st.integers(1, 5))
    hands = draw(st.integers(1, 3))
    metres = st.floats(-10, 10, width=32)
    positions = draw(hnp.arrays(np.float32, (frames, points, 3), elements=metres))
    seen = draw(hnp.arrays(np.bool_, (frames, points)))
    seen[0] = True  # an id that is never seen is not recorded
    confidence = draw(hnp.arrays(np.float32, (frames, points), elements=st.floats(0.125, 1, width=32)))
    return Episode(
        name="bag",
        times=np.arange(frames) * (draw(st.integers(1, 1000)) * 1e-3),
        points=np.where(seen[..., None], positions, np.float32(np.nan)),
        confidence=np.where(seen, confidence, np.float32(0)),
        point_ids=np.sort(draw(hnp.arrays(np.uint32, points, unique=True))),
        controllers=draw(hnp.arrays(np.float32, (frames, hands, 3), elements=metres)),
        controller_ids=np.sort(draw(hnp.arrays(np.uint32, hands, unique=True))),
        contact=draw(st.none() | hnp.arrays(np.bool_, (frames, hands))),
    )


@settings(max_examples=40, deadline=None)
@given(episode=episodes(), start_ns=st.integers(0, 2 * 10**18))
def test_written_episode_reads_back(episode, start_ns):
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        write_episode(episode, Path(folder) / "bag", start_ns=start_ns)
        again = read_episode(Path(folder) / "bag")
    np.testing.assert_allclose(again.times, episode.times, atol=2e-9)
    for name in ("points", "confidence", "point_ids", "controllers", "controller_ids", "contact"):
        np.testing.assert_array_equal(getattr(again, name), getattr(episode, name), strict=True)
