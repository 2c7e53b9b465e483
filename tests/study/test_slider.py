"""The virtual slider: the preset, its distances, claim 22 and the report's section."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from drawn import without_space
from eres_render import (
    Camera,
    Plane,
    Renderer,
    Trajectory,
    list_scenes,
    load_scene,
    plane_homography,
)
from eres_render.camera import map_pixels
from eres_render.scene.load import scene_root
from finished_runs import make_run, page_of
from sensor import EventCamera
from small_study import only
from study_rows import EI, paper_rows
from tasks.errors import StudyError
from tasks.evaluation.rendered_clip import farther
from tasks.row import Row
from tasks.study.claims.judge import judge_all
from tasks.study.claims.slider import ON_RECORDINGS, ON_THE_SLIDER
from tasks.study.claims.verdict import Status
from tasks.study.config import Render, Simulate, Study, Tracking, preset, to_json
from tasks.study.results.slider import (
    FIELD_PX,
    NOTHING_MM,
    PAPER_SIGMA_MM,
    PRINTS,
    distance_label,
    light_label,
    worse_than_nothing,
)
from tasks.study.run import run_study
from tasks.study.run.jobs import jobs_of
from tasks.tracking import path_at, perturbed, position_error_mm

INF = float("inf")
WALL = Plane(normal=(0.0, 0.0, -1.0), offset_m=0.0)


def facing(x_m=0.0, depth_m=0.236):
    T = np.eye(4)
    T[:3, 3] = x_m, 0.01, -depth_m
    return T


def small_print(folder, *, texels=480):
    """Return the folder of the forest with a coarser texture."""
    shutil.copytree(scene_root() / "slider", folder)
    toml = folder / "forest" / "scene.toml"
    text = toml.read_text().replace("4800", str(texels)).replace("1200", str(texels // 4))
    toml.write_text(text.replace("texel_m = 0.002", f"texel_m = {9.6 / texels}"))
    return folder / "forest"


def test_the_preset_asks_the_papers_question():
    """Promise: three prints, the paper's sizes to a pixel, windows of 6 mm at 0.2, 0.4 and 0.6 m/s,
    and frames for all the events that tracking gets."""
    study = preset("slider")
    assert study.scenes == ("forest", "pebbles", "split_rocks")
    for name in study.scenes:
        scene = load_scene(name)
        assert scene.name == name
        assert scene.name not in list_scenes()
        jobs, path = jobs_of(study, scene), scene.trajectory()
        assert len(jobs) == 21  # 10 samples, those of tracking, and one stretch of video
        for job in jobs:
            for one in job.settings(white_level=1.0):
                width, height = one.model.width, one.model.height
                assert min(abs(np.subtract((width, height), FIELD_PX)).max(axis=1)) <= 1
                travel_m = np.ptp(
                    path.position(1e-6 * one.speed * np.array([one.start_us, one.end_us]))[:, 0]
                )
                if "flow" in job.evaluate:
                    assert travel_m == pytest.approx(0.006, rel=1e-3)
                if "tracking" in job.evaluate:
                    assert one.end_us - one.start_us >= 24_000 - 1
    assert [distance_label(width) for width, _ in FIELD_PX] == ["63.5 cm", "43.3 cm", "23.6 cm"]
    assert [light_label(hz) for hz in study.simulate.cutoffs_hz] == [
        *("ideal", "300 lux", "67 lux", "17 lux")
    ]


def test_the_same_point_at_the_same_pixel_from_farther_away():
    """Analytic: through a lens that is longer by the same factor, to rounding; and so for the
    motion between two poses."""
    camera = Camera(119, 67, fx=164.6)
    far = camera.zoomed(2.7)
    one, two = facing(), facing(0.006)
    poses = farther(np.stack([one, two]), WALL, 2.7)
    assert poses[:, 2, 3] == pytest.approx(-2.7 * 0.236)
    at_px = camera.grid(5)
    rays = camera.rays(at_px) * 0.236 + one[:3, 3]  # on the wall
    assert far.project(rays - poses[0, :3, 3]) == pytest.approx(at_px, abs=1e-9)
    near_H = plane_homography(camera.K, one, two, WALL)
    far_H = plane_homography(far.K, poses[0], poses[1], WALL)
    assert map_pixels(far_H, at_px) == pytest.approx(map_pixels(near_H, at_px), abs=1e-9)


def test_pixels_twice_as_large_see_what_is_seen_from_twice_as_far(tmp_path):
    """Promise: frames from one distance serve all: four pixels of the near camera have the mean
    light of one of the far camera, rendered, to the sampling's 1 %."""
    scene = load_scene(small_print(tmp_path / "prints"))
    near = Camera(64, 36, fx=90.0)
    T = facing(0.03)
    light = Renderer(scene, spp=64, camera=near)
    assert light.integrator == "emission"  # nothing reflects: no light to bake
    mean = light.frame(T).reshape(18, 2, 32, 2).mean(axis=(1, 3))
    coarse = Camera(32, 18, fx=45.0)
    far = Renderer(scene, spp=256, camera=coarse.zoomed(2.0)).frame(farther(T, WALL, 2.0))
    assert np.abs(far / mean - 1).mean() < 0.01
    assert far.std() > 0.05 * far.mean()


def test_one_lens_needs_a_camera_that_faces_the_plane():
    """Promise: elsewhere the image would change with the distance; refused before rendering."""
    for name, why in (("carpet", "at an angle to the plane"), ("room", "is not planar")):
        study = Study(name="mine", scenes=(name,), simulate=Simulate(same_lens=True))
        with pytest.raises(StudyError, match=f"simulate.same_lens: {name} .*{why}"):
            jobs_of(study, load_scene(name))


def test_a_sensor_that_sees_a_part_of_the_frames_has_the_same_lens(tmp_path):
    """Promise: the distance is that at which the part that it sees has as many pixels; a portrait
    sensor of the frames' height sees what they see, from where they were."""
    sensors = (EventCamera(name="portrait", width=67, height=134),)
    study = Study(
        name="mine",
        scenes=(str(small_print(tmp_path / "prints")),),
        render=Render(resolution=238, height=134, window_s=0.03, every_s=0.15, samples=1),
        simulate=Simulate(widths=(119,), sensors=sensors, cutoffs_hz=(INF,), same_lens=True),
        evaluate=only(tracking=Tracking(sigmas_mm=(5.0,))),
    )
    job = jobs_of(study, load_scene(study.scenes[0]))[0]
    assert {one.name: one.distance for one in job.settings(1.0)} == {"": 2.0, "portrait": 1.0}


@pytest.mark.slow
def test_tracking_has_the_distance_of_each_width(tmp_path):
    """Promise: events, poses and lens of each distance belong together: from 5 mm off, tracking
    ends within 1 mm near and 3 mm from twice as far; doing nothing is the same at both."""
    study = Study(
        name="small",
        scenes=(str(small_print(tmp_path / "prints", texels=960)),),
        render=Render(resolution=238, height=134, spp=16, window_s=0.03, every_s=0.15, samples=1),
        simulate=Simulate(
            widths=(119, 238),
            cutoffs_hz=(INF,),
            contrast_thresholds=(0.05,),  # with 0.2 the far search ends where the noise decides
            speeds=(2.0,),
            same_lens=True,
        ),
        evaluate=only(tracking=Tracking(sigmas_mm=(5.0,), tracking_window_s=0.05)),
    )
    rows = run_study(study, tmp_path / "run")
    found = {(row.method, row.width): row.value for row in rows}
    assert found["photometric_tracking", 238] < 1
    assert found["photometric_tracking", 119] < 3
    assert found["initial_path", 119] == pytest.approx(found["initial_path", 238])


def test_doing_nothing_by_the_papers_protocol():
    """Promise: 54.7 mm follows from the perturbation alone, and 6 of 9 errors are larger."""
    path = path_at(lambda t_s: np.tile(np.eye(4), (len(t_s), 1, 1)), 0.0)

    def still(t_s):
        return np.tile(np.eye(4), (len(t_s), 1, 1))

    errors = [
        position_error_mm(perturbed(path, 1e-3 * PAPER_SIGMA_MM, seed), still, 0.0, path.duration_s)
        for seed in range(400)
    ]
    assert isinstance(path, Trajectory)
    assert np.median(errors) == pytest.approx(NOTHING_MM, rel=0.02)
    assert worse_than_nothing(0.6) == 6


SERIES = {
    "flow": ("photometric_flow", "initial_flow", "rnepe_px", ""),
    "tracking": ("photometric_tracking", "initial_path", "position_error_mm", "sigma 5 mm"),
}
LIGHTS = (INF, 900.0, 51.0)


def slider_rows(lead=0.3, changed=None, samples=9, tasks=tuple(SERIES)):
    """Return errors of 1 at the full size and 1 - `lead` at the middle one; `changed` maps
    (task, print, cutoff) to another lead."""
    rows = []
    for task in tasks:
        method, nothing, metric, variant = SERIES[task]
        for scene in PRINTS:
            for hz in LIGHTS:
                for speed in (1.0, 2.0, 3.0):
                    for width, _ in FIELD_PX:
                        here = (changed or {}).get((task, scene, hz), lead)
                        value = 1.0 - here * (width == FIELD_PX[1][0])
                        at = (width, hz, 0.2, speed)
                        rows += [
                            row
                            for k in range(samples)
                            for row in (
                                Row(scene, task, method, *at, k, metric, value + 0.01 * k, 1e6,
                                    variant),
                                Row(scene, task, nothing, *at, k, metric, 3.5, 0.0, variant),
                            )
                        ]  # fmt: skip
    return rows


def verdict(rows):
    (found,) = judge_all(rows, {}, [ON_THE_SLIDER])
    return found


def test_claim_22_follows_the_rows():
    """Promise: it holds in a light where the middle is better on every print, and if it does in one
    light with a cutoff; one print breaks it in its light alone, and ideal light does not count."""
    assert verdict(slider_rows()).status is Status.HOLDS
    worse = verdict(slider_rows(changed={("tracking", "pebbles", 51.0): -0.3}))
    assert worse.status is Status.HOLDS
    lights = [line for line in worse.ours.splitlines() if re.match(r"\d+ lux: |all", line)]
    assert lights == [
        "300 lux: holds",
        "17 lux: does not hold",
        "all lights at once: does not hold",
    ]
    assert re.search(r"tracking.* pebbles \S+ \[[^]]*\] \(does not hold\); split", worse.ours)
    every = {(task, "pebbles", hz): -0.3 for task in SERIES for hz in LIGHTS}
    assert verdict(slider_rows(changed=every)).status is Status.DOES_NOT_HOLD
    ideal = {(task, scene, INF): -0.3 for task in SERIES for scene in PRINTS}
    assert verdict(slider_rows(changed=ideal)).status is Status.HOLDS
    assert verdict(slider_rows(0.0)).status is Status.UNDECIDED
    one_print = [row for row in slider_rows() if row.scene == "pebbles"]
    assert "Judged on pebbles only." in verdict(one_print).note
    few = verdict(slider_rows(samples=3))
    assert few.status is Status.UNDECIDED
    assert "too few for an interval" in few.note


def test_a_cutoff_by_area_compares_two_lights():
    """Promise: 649 px has (1190 / 649)^2 = 3.36 times the cutoff, if the run has one within a
    factor of 1.5; here it loses by 0.3 in each light, and brighter light is better by 1."""
    rows = [replace(row, value=row.value - (row.cutoff_hz > 51)) for row in slider_rows(-0.3)]
    rows = [
        replace(row, cutoff_hz=min(row.cutoff_hz, 201.0)) for row in rows if row.cutoff_hz < INF
    ]
    found = verdict(rows)
    assert found.status is Status.DOES_NOT_HOLD
    by_area = [line for line in found.ours.splitlines() if "by area" in line]
    assert by_area == ["17 lux, but 201 Hz at 649 px (by area 171 Hz): holds"]


def test_recordings_with_known_and_with_unknown_cutoffs_are_judged_together():
    """Promise: each light has a line, and an unknown cutoff is not compared with others by area."""
    (judged,) = judge_all(slider_rows(), {}, [ON_RECORDINGS])
    assert judged.status is Status.HOLDS
    lights = [line for line in judged.ours.splitlines() if line.startswith("cutoff")]
    assert lights == ["cutoff unknown: holds", "cutoff 900 Hz: holds", "cutoff 51 Hz: holds"]


def test_claim_22_is_not_measured_elsewhere():
    """Promise: neither by rows of other scenes, nor by flow alone, nor if a cell is missing."""
    found = verdict(paper_rows(EI, samples=1))
    assert (found.status, found.ours) == (Status.NOT_MEASURED, "no rows of the virtual slider")
    alone = verdict(slider_rows(tasks=("flow",)))
    assert alone.status is Status.NOT_MEASURED
    assert "pose tracking: not measured" in alone.ours
    lost = [
        row
        for row in slider_rows()
        if (row.scene, row.width, row.speed, row.sample) != ("forest", 1190, 3.0, 4)
    ]
    assert verdict(lost).status is Status.NOT_MEASURED


def test_the_papers_numbers_of_claim_22():
    """Expected: 31 mm and 0.07 px, the means that its text rounds to 0.1 px."""
    paper = verdict(slider_rows(samples=1)).paper
    assert "mean +0.07" in paper
    assert "mean +31.08" in paper
    assert "6 of its 9 position errors at 0.6 m/s are larger than the 54.7 mm" in paper


def made_on_slider(folder, rows, **changed):
    """Return the folder of a run of the preset, with some fields of study.json changed."""
    make_run(folder, rows)
    config = to_json(preset("slider"))
    config["simulate"] |= changed.pop("simulate", {})
    (folder / "study.json").write_text(json.dumps({**config, **changed}))
    return folder


@pytest.mark.parametrize(
    "changed",
    [
        {"simulate": {"same_lens": None}},
        {"simulate": {"bus_mev_s": 12.0}},
        {"render": {"resolution": 1280, "height": 720}},
    ],
    ids=["cameras at one distance", "a bus", "other distances"],
)
def test_another_study_of_the_prints_is_not_on_the_slider(tmp_path, eres, changed):
    """Promise: claim 22 is about distances of one lens without a bus, named for the size of the
    preset's frames; a study of other cameras has neither its verdict nor its section."""
    run = made_on_slider(tmp_path, slider_rows(samples=1), **changed)
    assert "\n22 " not in eres("claims", run)[1]
    assert 'id="slider"' not in page_of(run)


def test_speeds_in_meters_per_second_are_no_factors(tmp_path):
    """Promise: 1 m/s is not the paper's lowest speed, which is the factor 1."""
    rows = [replace(row, speed_m_s=row.speed) for row in slider_rows(samples=1)]
    assert 'id="slider"' not in page_of(made_on_slider(tmp_path, rows))


def test_the_report_has_the_162_numbers_beside_ours(tmp_path):
    """Promise: a run on the slider shows all of the paper's numbers, and claim 22 alone; another
    run has no such section."""
    run = made_on_slider(tmp_path / "slider", slider_rows(samples=1))
    page = without_space(page_of(run))
    section = page.split('<section id="slider"')[1].split("</section>")[0]
    rows = re.findall(r'<th scope="row">paper</th>((?:<td[^>]*>.*?</td>)+)', section)
    cells = [cell for row in rows for cell in re.findall(r"<td[^>]*>(.*?)</td>", row)]
    printed = [cell for cell in cells if " of 3" not in cell]
    assert len(printed) == 162
    # Of all errors: at 0.4 m/s none is larger than that of doing nothing.
    assert sum("<s>" in cell for cell in printed) == 6
    assert "6 of its 9 position errors" in section
    assert "23.6 cm" in section
    assert "17 lux" in section
    assert re.findall(r"<small>claim (\d+)</small>", page) == ["22"]
    other = page_of(make_run(tmp_path / "carpet", paper_rows(EI, samples=1)))
    assert 'id="slider"' not in other


def test_a_coarser_render_keeps_its_shape():
    """Promise: `--resolution` keeps the frames' shape, and sensors theirs to a pixel."""
    render = replace(preset("slider").render, resolution=595, height=335)
    assert [render.height_at(width) for width in (595, 442)] == [335, 249]


def test_both_readings_of_prints_are_judged_on_claim_22_alone(tmp_path, eres):
    """Promise: a slider study with two photoreceptors has a report and verdicts of both."""
    rows = slider_rows(samples=1)
    run = made_on_slider(tmp_path, rows + [replace(row, photoreceptor="v2e") for row in rows])
    assert 'id="photoreceptor"' in page_of(run)
    code, out, _ = eres("claims", run)
    assert (code, out.count("With v2e's limit for small steps: ")) == (0, 1)
