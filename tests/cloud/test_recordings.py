"""Clouds as recordings: what other programs' own libraries read of them."""

import numpy as np
import pytest

from jaxsim.cloud.export import table_of
from jaxsim.cloud.recordings import Stamped, write_mcap
from tests.cloud.made_export import lined


def test_an_mcap_is_read_by_the_formats_own_libraries(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    c, time_s = lined()
    table = table_of(c, time_s)
    count = write_mcap(tmp_path / "a.mcap", [Stamped(5.25, table), Stamped(5.35, table[:7])], frame="top")
    assert count == 2
    with (tmp_path / "a.mcap").open("rb") as file:
        read = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        messages = [message for _, _, _, message in read.iter_decoded_messages(topics=["/points"])]
    first = messages[0]
    assert (first.header.frame_id, first.header.stamp.sec, first.header.stamp.nanosec) == ("top", 5, 250_000_000)
    assert [f.name for f in first.fields] == ["x", "y", "z", "intensity", "ring", "time"]
    np.testing.assert_array_equal(np.frombuffer(bytes(first.data), table.dtype), table)
    assert messages[1].width == 7
