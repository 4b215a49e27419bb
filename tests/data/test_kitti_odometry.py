"""KITTI's odometry benchmark with SemanticKITTI's labels, in files of the true format and in real ones."""

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import KittiOdometry, open_dataset, select
from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.point_labels import read_point_labels
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.discover import read_comparison
from jaxsim.evaluate.baselines import fit_baselines
from jaxsim.frame import Cloud
from jaxsim.geometry import scan_on_window
from jaxsim.prepare import prepare_frame
from jaxsim.simulate.discover_sides import write_lambert

LABELLED = PrepareConfig(inputs=("depth", "semantic", "row"), depth="ip_basic_fast", columns=64, network_size=(44, 64))


def test_scans_come_by_sequence_with_classes_and_objects_of_what_the_camera_sees(odometry_root):
    dataset = open_dataset(DataConfig(kind="kitti_odometry", root=odometry_root))
    assert [dataset.name_of(i) for i in range(4)] == [
        *("sequence_00-000000", "sequence_00-000001", "sequence_08-000000", "sequence_11-000000")
    ]
    frame = dataset[1]
    assert (frame.scene, frame.time_s) == ("sequence_00", 0.1039)
    semantic, instance = frame.camera.semantic, frame.camera.instance
    assert {*np.unique(semantic)} == {0, IDS["road"], IDS["building"]}
    # Above the top line there is no point, below lies the road, and walls are one object.
    assert semantic[0].max() == 0
    assert (semantic[-1] == IDS["road"]).mean() > 0.9
    np.testing.assert_array_equal(instance > 0, semantic == IDS["building"])
    assert len(np.unique(instance)) == 2
    assert dataset[3].camera.semantic is None


def test_parts_are_told_by_sequence_labels_and_images(odometry_root):
    dataset = KittiOdometry(odometry_root)
    assert {name: select(name, dataset) for name in dataset.splits} == {
        "sequence_00": [0, 1],
        "sequence_08": [2],
        "sequence_11": [3],
        "labelled": [0, 1, 2],
        "pictured": [0],
        "training": [0, 1],
        "evaluation": [2],
    }
    assert len(KittiOdometry(odometry_root, sequences=("08", "08"))) == 1
    with pytest.raises(ValueError, match=r"no sequence 07 with velodyne/NUMBER.bin .* it has 00, 08, 11"):
        KittiOdometry(odometry_root, sequences=("07",))


def test_labels_become_the_semantic_input_and_the_baseline_of_classes(odometry_root):
    dataset = KittiOdometry(odometry_root)
    pairs = [prepare_frame(dataset[i], dataset.spec, LABELLED)[0] for i in (1, 2)]
    assert {*np.unique(pairs[0].painted.semantic)} <= {0, IDS["road"], IDS["building"]}
    assert "per-class mean" in fit_baselines(pairs[:1])


def test_what_a_frame_lacks_is_told_where_it_is_needed(odometry_root):
    dataset = KittiOdometry(odometry_root)
    with pytest.raises(ValueError, match=r"sequence_11-000000: .*semantic need class labels.*or choose frames that"):
        prepare_frame(dataset[3], dataset.spec, LABELLED)
    coloured = PrepareConfig(inputs=("rgb", "depth"), depth="ip_basic_fast", columns=64)
    with pytest.raises(ValueError, match=r"sequence_00-000001: .*rgb need an image.*--prepare.inputs depth"):
        prepare_frame(dataset[1], dataset.spec, coloured)
    pair, _ = prepare_frame(dataset[0], dataset.spec, coloured)
    assert pair.painted.rgb.max() > 0


def test_an_image_of_a_camera_that_is_not_kittis_has_to_be_there(odometry_root):
    path = odometry_root / "sequences/00/calib.txt"
    path.write_text(path.read_text().replace("721.5377", "900"))
    with pytest.raises(ValueError, match=r"calib.txt: P2 has the focal length 900, none of KITTI's .*copy image_2"):
        KittiOdometry(odometry_root)[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: values[:-1], r"000000.label has \d+ bytes, and its scan \d+ points"),
        (lambda values: np.append(values[:-1], [77]).astype("<u4"), r"000000.label has class 77, which is none"),
        (lambda values: values[:0], r"000000.label has 0 bytes"),
    ],
)
def test_labels_of_another_scan_or_set_are_refused(odometry_root, change, message):
    path = odometry_root / "sequences/00/labels/000000.label"
    change(np.fromfile(path, "<u4")).astype("<u4").tofile(path)
    with pytest.raises(ValueError, match=message):
        KittiOdometry(odometry_root)[0]


def test_a_folder_of_another_level_is_told(odometry_root):
    with pytest.raises(ValueError, match="the folder of one sequence; pass the one that holds sequences/"):
        KittiOdometry(odometry_root / "sequences/00")
    (odometry_root / "sequences/08/calib.txt").unlink()
    with pytest.raises(ValueError, match=r"no sequences/: .* holds labels/, velodyne/"):
        KittiOdometry(odometry_root / "sequences/08")


def test_frames_of_a_log_have_the_labels_of_their_points(odometry_root, tmp_path):
    kind, source = source_for(odometry_root / "sequences/00")
    assert kind == "kitti"
    write_log(odometry_root / "sequences/00", kind, source, out=tmp_path / "out", options=LogOptions(columns=360))
    frames = open_polar_frames(tmp_path / "out")
    image, more = frames.read(frames.names[0])
    semantic, instance = more["semantic"], more["instance"]
    assert {*np.unique(semantic[image.valid])} == {IDS["road"], IDS["building"]}
    np.testing.assert_array_equal(instance[image.valid] > 0, semantic[image.valid] == IDS["building"])
    assert semantic[~image.valid].max(initial=0) == 0


def test_discover_asks_about_the_classes_of_a_log(odometry_root, tmp_path):
    kind, source = source_for(odometry_root / "sequences/00")
    write_log(odometry_root / "sequences/00", kind, source, out=tmp_path / "measured", options=LogOptions(columns=360))
    write_lambert(tmp_path / "measured", tmp_path)
    comparison = read_comparison(simulated=tmp_path / "simulated", measured=tmp_path / "measured")
    hit = np.asarray(comparison.scan.hit)
    assert {*np.unique(np.asarray(comparison.scan.semantic)[hit])} == {IDS["road"], IDS["building"]}


def test_real_labels_reach_the_cells_of_their_points(samples, tmp_path):
    (tmp_path / "sequences").mkdir()
    (tmp_path / "sequences/00").symlink_to(samples / "semantickitti_00")
    dataset = KittiOdometry(tmp_path)
    assert dataset.spec.name == "hdl64e"  # the motion was taken out: nothing to fit beams to
    frame = dataset[0]
    pair, grid = prepare_frame(frame, dataset.spec, LABELLED)
    cloud = frame.cloud
    of_points, _ = read_point_labels(samples / "semantickitti_00/labels/000000.label", len(cloud.xyz_m))
    labelled = Cloud(cloud.xyz_m, of_points.astype(np.float32), cloud.valid, cloud.row)
    truth = scan_on_window(labelled, grid, pair.row_share[:, 0], lines=64)
    classes = np.round(np.asarray(truth.intensity)).astype(int)
    both = np.asarray(truth.valid) & pair.painted.valid & ~pair.painted.occluded & (classes > 0)
    same = pair.painted.semantic == classes
    assert same[both].mean() > 0.95
    assert same[both & (classes == IDS["road"])].mean() > 0.99
