"""ROS bags: files that rosbags writes come back, topics are chosen, and damage is an error."""

import struct

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from bags import message, typestore_of, write_bag
from event_streams import assert_same, make_events, random_events
from sensor import EventFormatError
from sensor.events import concatenate, no_events
from sensor.formats import load_events, read_events, read_header


@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs"])
def test_bags_that_rosbags_writes(package, tmp_path):
    """Promise: time, place and polarity of every event, the size, and the names of other topics."""
    events = random_events(450, width=346, height=260, start_us=1_600_000_000_123_456, mean_us=30)
    path = write_bag(tmp_path / "a.bag", {"/dvs/events": events}, package)
    assert_same(load_events(path), events)
    header = read_header(path)
    assert (header.width, header.height) == (346, 260)
    assert header.others == ("/said (std_msgs/String)",)


def test_a_first_message_that_does_not_know_the_size_leaves_it_open(tmp_path, eres):
    """Promise: such a bag is read with `size`."""
    empty, events = no_events(0, 0, None), random_events(40, width=12, height=9)
    path = tmp_path / "a.bag"
    store = typestore_of("dvs_msgs")
    with Writer(path) as writer:
        one = writer.add_connection("/e", "dvs_msgs/msg/EventArray", typestore=store)
        writer.write(one, 0, message(store, "dvs_msgs", empty))
        writer.write(one, 1, message(store, "dvs_msgs", events))
    assert read_header(path).width is None
    assert_same(load_events(path, size=(12, 9)), events)
    code, out, _ = eres("info", path)
    assert (code, "size not stored" in out, " 40\n" in out) == (0, True, True)


def test_the_size_is_that_of_the_topic(tmp_path, eres):
    """Promise: cameras of two sizes in one bag, each read with its own."""
    small = random_events(40, width=12, height=9)
    large = random_events(30, width=64, height=48)
    path = write_bag(tmp_path / "a.bag", {"/small": small, "/large": large})
    for topic, events in (("/small", small), ("/large", large)):
        assert_same(load_events(path, topic=topic), events)
        size = f"{events.width}x{events.height} px"
        assert size in eres("info", path, "--topic", topic)[1]
        out = tmp_path / topic[1:]
        code, said, err = eres("video", path, "--topic", topic, "--out", out, "--fps", 1e5)
        assert (code, size in said) == (0, True), err
        code, _, err = eres("view", path, "--topic", topic, "--out", f"{out}.mp4")
        assert code == 0, err


def test_a_bag_is_read_in_parts(tmp_path):
    """Promise: one message is in memory at a time."""
    path = write_bag(tmp_path / "a.bag", {"/dvs/events": random_events(300)}, per_message=50)
    assert [len(part) for part in read_events(path)] == [0, *[50] * 6]


def test_several_topics_need_a_choice(tmp_path, eres, caplog):
    """Promise: no topic is taken by chance; the option names one."""
    left, right = random_events(60, seed=1), random_events(70, seed=2)
    path = write_bag(tmp_path / "a.bag", {"/left": left, "/right": right})
    with pytest.raises(EventFormatError, match="topic: none given; choose from /left, /right"):
        load_events(path)
    with pytest.raises(EventFormatError, match="topic: /up given; choose from /left, /right"):
        load_events(path, topic="/up")
    assert_same(load_events(path, topic="/right"), right)
    code, out, _ = eres("convert", path, tmp_path / "a.h5", "--topic", "/left")
    assert (code, "60 events" in out) == (0, True)
    assert "cannot store /right (dvs_msgs/EventArray), /said (std_msgs/String)" in caplog.text
    assert "/right (dvs_msgs/EventArray)" in eres("info", path, "--topic", "/left")[1]
    with pytest.raises(EventFormatError, match=r"topic: found .*/left.* DSEC"):
        load_events(tmp_path / "a.h5", topic="/left")


def test_messages_out_of_order_can_be_sorted(tmp_path):
    """Promise: times that run backwards are an error that says what to do."""
    early, late = make_events([5, 6], [1, 2], [3, 4], [1, 0]), make_events([9], [7], [8], [1])
    store = typestore_of("dvs_msgs")
    with Writer(tmp_path / "a.bag") as writer:
        one = writer.add_connection("/e", "dvs_msgs/msg/EventArray", typestore=store)
        for k, part in enumerate((late, early)):
            writer.write(one, k, message(store, "dvs_msgs", part))
    with pytest.raises(EventFormatError, match=r"message 1: .*--sort"):
        load_events(tmp_path / "a.bag")
    assert_same(load_events(tmp_path / "a.bag", sort=True), concatenate([early, late]))


def test_other_messages_are_named(tmp_path):
    """Promise: a bag without events says what it has."""
    path = write_bag(tmp_path / "a.bag", {})
    with pytest.raises(EventFormatError, match="found messages std_msgs/String, expected dvs"):
        load_events(path)


def test_damage_is_an_error(tmp_path):
    """Promise: a truncated bag, a message of a wrong length, a pixel outside the sensor."""
    events = random_events(50, width=64, height=48)
    whole = write_bag(tmp_path / "a.bag", {"/e": events}).read_bytes()
    rng = np.random.default_rng(0)
    for size in [0, 5, *rng.integers(1, len(whole), 40)]:
        (tmp_path / "b.bag").write_bytes(whole[:size])
        with pytest.raises(EventFormatError, match=r"b\.bag: "):
            load_events(tmp_path / "b.bag")
    store = typestore_of("dvs_msgs")
    good = message(store, "dvs_msgs", events)
    wide = bytearray(good)
    struct.pack_into("<H", wide, 28 + len("davis"), 64)
    for data, said in ((good[:-1], "which are not an array of events"), (bytes(wide), "found 64")):
        with Writer(tmp_path / f"{said}.bag") as writer:
            one = writer.add_connection("/e", "dvs_msgs/msg/EventArray", typestore=store)
            writer.write(one, 0, data)
        with pytest.raises(EventFormatError, match=said):
            load_events(tmp_path / f"{said}.bag", size=(64, 48))
