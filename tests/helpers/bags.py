"""ROS bags of events, made by rosbags."""

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\n{package}/Event[] events\n"


def typestore_of(package):
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(EVENT, f"{package}/msg/Event"))
    array = ARRAY.format(package=package)
    store.register(get_types_from_msg(array, f"{package}/msg/EventArray"))
    return store


def message(store, package, events):
    """Return the bytes of a message, made by rosbags from its objects."""
    types = store.types
    time = types["builtin_interfaces/msg/Time"]
    event = types[f"{package}/msg/Event"]
    each = [
        event(x=int(x), y=int(y), ts=time(*divmod(1000 * int(t), 10**9)), polarity=bool(p > 0))
        for t, x, y, p in zip(*events.columns, strict=True)
    ]
    header = types["std_msgs/msg/Header"](seq=1, stamp=time(0, 0), frame_id="davis")
    array = types[f"{package}/msg/EventArray"](header, events.height, events.width, each)
    return bytes(store.serialize_ros1(array, f"{package}/msg/EventArray"))


def write_bag(path, streams, package="dvs_msgs", per_message=100):
    """Write a bag with a topic for each stream, several messages each."""
    store = typestore_of(package)
    with Writer(path) as writer:
        for topic, events in streams.items():
            one = writer.add_connection(topic, f"{package}/msg/EventArray", typestore=store)
            for k in range(0, len(events), per_message):
                part = events[k : k + per_message]
                writer.write(one, 1000 * int(part.t_us[-1]), message(store, package, part))
        text = writer.add_connection("/said", "std_msgs/msg/String", typestore=store)
        said = store.types["std_msgs/msg/String"](data="hello")
        writer.write(text, 0, store.serialize_ros1(said, "std_msgs/msg/String"))
    return path
