"""Velodyne's packets: a real recording, whole and cut."""

import contextlib

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, source_for, write_log
from tests.data.logs.made_logs import frames_of


def test_velodynes_packets(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    kind, frames = frames_of(samples / "velodyne_vlp16/my.pcap", tmp_path)
    assert kind == "velodyne"
    image, more = frames.read(frames.names[0])
    np.testing.assert_allclose(np.rad2deg(frames.grid.elevation_rad), np.arange(15, -16, -2), atol=0.01)
    # The sensor's window is 78 degrees wide; beyond it the decoder interpolates, and nothing was measured.
    assert np.rad2deg(frames.grid.azimuth_rad[[0, -1]]) == pytest.approx((38.7, -39.9), abs=0.2)
    assert image.valid.mean() > 0.99
    assert 0 < more["time"].max() < 0.21
    # The window slides on from turn to turn: of the second only a quarter is in the recording.
    assert len(frames.names) == 1


def turns_of(recording: bytes, *, count: int) -> list[bytes]:
    """The data packets of a VLP-16's first turn, so many times, each a turn later than the one before."""
    packets, at = [], 24
    while at < len(recording):
        size = int.from_bytes(recording[at + 8 : at + 12], "little")
        if size == 1248:
            packets.append(recording[at : at + 16 + size])
        at += 16 + size
    sent = []
    for k in range(count):
        for packet in packets[:35]:
            stamp = int.from_bytes(packet[-6:-2], "little") + 200_000 * k
            sent.append(packet[:-6] + stamp.to_bytes(4, "little") + packet[-2:])
    return sent


def test_a_turn_that_a_recording_cuts_is_passed_over(samples, tmp_path):
    """Where no packet went out no ray was lost: a third of a turn that is missing must not look like lost rays."""
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    recording = (samples / "velodyne_vlp16/my.pcap").read_bytes()
    path = tmp_path / "cut.pcap"
    path.write_bytes(recording[:24] + b"".join(turns_of(recording, count=4)[:-12]))
    kind, source = source_for(path, "")
    written = write_log(path, kind, source, out=tmp_path / "out", options=LogOptions())
    assert (written.frames, written.partial) == (3, 1)


def test_a_whole_turn_counts_although_the_file_ends_within_a_packet(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    recording = (samples / "velodyne_vlp16/my.pcap").read_bytes()
    path = tmp_path / "cut.pcap"
    path.write_bytes(recording[:24] + b"".join(turns_of(recording, count=3))[:-100])
    kind, source = source_for(path, "")
    written = write_log(path, kind, source, out=tmp_path / "out", options=LogOptions())
    assert (written.frames, written.partial) == (3, 0)


@pytest.mark.parametrize(("share", "frames"), [(0.95, 1), (0.7, 0)])
def test_the_last_turn_of_a_file_that_ends_within_a_packet_is_passed_over(samples, tmp_path, share, frames):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    recording = (samples / "velodyne_vlp16/my.pcap").read_bytes()
    path = tmp_path / "cut.pcap"
    path.write_bytes(recording[: int(len(recording) * share)])
    kind, source = source_for(path, "")
    cannot = contextlib.nullcontext() if frames else pytest.raises(ValueError, match="no whole turn")
    with cannot:
        written = write_log(path, kind, source, out=tmp_path / "out", options=LogOptions())
        assert (written.frames, written.partial) == (frames, 1)


def test_a_pcap_of_something_else(tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    (tmp_path / "x.pcap").write_bytes(bytes(100))
    with pytest.raises(ValueError, match=r"velodyne: .*x.pcap"):
        frames_of(tmp_path / "x.pcap", tmp_path / "out")


def test_a_packet_that_promises_gigabytes_is_no_packet(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    whole = bytearray((samples / "velodyne_vlp16/my.pcap").read_bytes())
    whole[24 + 8 : 24 + 12] = b"\xff\xff\xff\xef"  # the first packet's length
    (tmp_path / "x.pcap").write_bytes(whole)
    with pytest.raises(ValueError, match=r"velodyne: .*x.pcap cannot be read .* promises \d+ bytes; it is damaged"):
        frames_of(tmp_path / "x.pcap", tmp_path / "out")
