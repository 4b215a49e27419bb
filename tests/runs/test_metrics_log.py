import json

import numpy as np
import pytest

from jaxsim.runs.metrics_log import MetricsLog, TrainingDiverged, read_metrics


def test_a_resumed_run_writes_again_what_came_after_its_checkpoint(tmp_path):
    log = MetricsLog(tmp_path, 0)
    for step in (1, 2, 3):
        log.write(step, {"loss": 1.0 / step})
    MetricsLog(tmp_path, 2).write(3, {"loss": 9.0})
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert lines == [{"step": 1, "loss": 1.0}, {"step": 2, "loss": 0.5}, {"step": 3, "loss": 9.0}]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_tensorboard_gets_the_same_points(tmp_path):
    pytest.importorskip("tensorboardX", reason="tensorboardX is not installed")
    from tensorboardX.proto.event_pb2 import Event

    with MetricsLog(tmp_path, 0) as log:
        log.write(10, {"loss/gan": 0.25})
    (path,) = (tmp_path / "tensorboard").glob("events.*")
    content, points = path.read_bytes(), {}
    while content:  # records: length (8 bytes), checksum (4), event, checksum (4)
        size = int.from_bytes(content[:8], "little")
        event = Event.FromString(content[12 : 12 + size])
        points |= {value.tag: (event.step, value.simple_value) for value in event.summary.value}
        content = content[16 + size :]
    assert points == {"loss/gan": (10, 0.25)}


@pytest.mark.parametrize(("value", "cause"), [(0.5, "the batch is finite"), (np.nan, "NaN or infinity in inputs")])
def test_what_broke_a_run_is_kept_and_told(tmp_path, value, cause):
    batch = {"inputs": np.full((1, 2, 2, 1), value, np.float32)}
    with pytest.raises(TrainingDiverged, match=f"loss/gan not finite at step 7.*{cause}"):
        MetricsLog(tmp_path, 0).stop_on_nan(7, batch, {"loss/gan": np.nan, "loss/rest": 1.0, "finite": False})
    np.testing.assert_array_equal(np.load(tmp_path / "diverged_000007.npz")["inputs"], batch["inputs"])


@pytest.mark.parametrize("half", [b'{"step": 3, "lo', b'{"step": 3, "lo' + bytes(40), bytes(200)])
def test_a_half_last_line_is_left_out_and_written_again(tmp_path, half):
    log = MetricsLog(tmp_path, 0)
    for step in (1, 2):
        log.write(step, {"loss": 0.5})
    whole = (tmp_path / "metrics.jsonl").read_bytes()
    (tmp_path / "metrics.jsonl").write_bytes(whole + half)
    assert not MetricsLog(tmp_path, 2).validated(3)
    assert (tmp_path / "metrics.jsonl").read_bytes() == whole


def test_a_run_resumes_after_the_largest_gradient(tmp_path):
    """One that is clipped ends no training."""
    MetricsLog(tmp_path, 0).write(1, {"grad_norm/generator": float(np.float32(3e38))})
    assert read_metrics(MetricsLog(tmp_path, 1).path)[0]["step"] == 1


@pytest.mark.parametrize(
    "line",
    [
        *("{", "3", '{"loss": 1}', '{"step": "3"}', '{"step": true}'),
        *('{"step": 3, "loss": NaN}', '{"step": 3, "loss": -1e39}', '{"step": 3, "validation/mae": 1e39}'),
        *('{"step": 3, "loss": "1"}', f'{{"step": 3, "loss": {10**400}}}'),
    ],
)
def test_a_line_that_is_none_is_named(tmp_path, line):
    (tmp_path / "metrics.jsonl").write_text(f'{{"step": 1}}\n{line}\n')
    with pytest.raises(ValueError, match=r"metrics\.jsonl, line 2 is not what a training writes"):
        MetricsLog(tmp_path, 2)
