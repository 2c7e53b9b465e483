"""The command line with a scene in which an object moves: render, info, simulate, truth."""

import h5py
import numpy as np
import pytest

from eres_render import ground_truth, open_sequence, window_times
from moving_objects import FLOOR, SPHERE, folder_of
from sensor.formats import load_events


@pytest.mark.usefixtures("unmeasured_noise")
def test_from_a_scene_with_an_object_to_events_with_its_truth(eres, tmp_path):
    """The camera is at rest, so all events are where the ball is, or was."""
    scene = folder_of(tmp_path / "scene", FLOOR, SPHERE)
    options = ["--continuous", "--duration", 0.2, "--resolution", 48, "--spp", 16]
    assert eres("render", scene, "--out", tmp_path / "out", *options)[0] == 0
    folder, file = tmp_path / "out" / "continuous", tmp_path / "out.h5"
    code, said, _ = eres("info", folder)
    assert code == 0
    assert "moving objects" in said
    assert "ball" in said
    size = ["--resolution", 24]
    assert eres("simulate", folder, "--out", file, *size, "--truth", 0.05)[0] == 0
    sequence = open_sequence(folder)
    truth, times_s = ground_truth(sequence), window_times(sequence, 0.05)
    with h5py.File(file) as opened:
        group = opened["truth"]
        masks = group["instances"][:]
        assert masks.dtype == np.uint8
        np.testing.assert_array_equal(masks[1], truth.instances(times_s[1], 24))
        np.testing.assert_array_equal(
            group["flow_occluded"][1], truth.flow(times_s[1], times_s[2], 24).occluded
        )
        assert group["T_world_object"].shape == (1, len(times_s), 4, 4)
        assert list(group["T_world_object"].attrs["names"]) == ["ball"]
        np.testing.assert_allclose(group["T_world_object"][0, -1, 0, 3], -0.2 + 0.4 * 0.2)
    events = load_events(file)
    assert len(events) > 50
    rows, columns = np.nonzero(masks.any(axis=0))
    near = (abs(events.x[:, None] - columns) <= 1) & (abs(events.y[:, None] - rows) <= 1)
    assert near.any(axis=1).all()
    command = ["truth", folder, "--out", tmp_path / "truth", "--width", 24, "--step", 0.1]
    assert eres(*command)[0] == 0
    assert len(list((tmp_path / "truth/instances").glob("*.png"))) == 3
    assert (tmp_path / "truth/objects/001_ball.txt").is_file()
