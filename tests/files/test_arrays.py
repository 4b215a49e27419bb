"""Arrays on disk: a changed bit is seen, and nothing is unpacked before it is measured."""

import io
import time
import tracemalloc
import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.lib import format as npy

from jaxsim.data.clouds import read_cloud
from jaxsim.data.polar_frames import read_frame
from jaxsim.files import array_names, read_arrays, write_arrays
from jaxsim.weights import ABOUT, checked_arrays, read_state_dict

ARRAYS = {"kernel": np.random.default_rng(0).normal(size=(40, 50)).astype(np.float32), "name": np.array("a")}


def equal(found):
    return found.keys() == ARRAYS.keys() and all((found[name] == ARRAYS[name]).all() for name in ARRAYS)


def header(shape: str, descr: str = "<f4", order: bool = False) -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def test_what_is_written_is_read_with_its_sum(tmp_path):
    write_arrays(tmp_path / "a.npz", ARRAYS)
    assert equal(read_arrays(tmp_path / "a.npz", by="test", summed=True))
    assert [*read_arrays(tmp_path / "a.npz", ("name", "other"), by="test")] == ["name"]


def test_no_flipped_bit_of_150_gives_other_arrays(tmp_path):
    """Even where the archive's own CRC-32 was made to fit."""
    write_arrays(tmp_path / "a.npz", ARRAYS)
    whole = (tmp_path / "a.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        kernel = archive.read("kernel.npy")
        rest = {name: archive.read(name) for name in archive.namelist() if name != "kernel.npy"}
    random = np.random.default_rng(1)
    for k, place in enumerate(random.integers(128 * 8, 8 * len(kernel), 150)):
        flipped = bytearray(kernel)
        flipped[place // 8] ^= 1 << (place % 8)
        if k % 2:
            with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
                for name, content in {"kernel.npy": bytes(flipped), **rest}.items():
                    archive.writestr(name, content)
        else:
            (tmp_path / "a.npz").write_bytes(whole.replace(kernel, bytes(flipped)))
        with pytest.raises(ValueError, match=r"is no readable \.npz of plain arrays"):
            read_arrays(tmp_path / "a.npz", by="test")


def test_a_file_of_an_earlier_version_is_taken_with_a_word_where_a_sum_is_due(tmp_path):
    np.savez(tmp_path / "a.npz", **ARRAYS)
    assert equal(read_arrays(tmp_path / "a.npz", by="test"))
    with pytest.warns(UserWarning, match="written without a SHA-256 by an earlier version; it is not verified"):
        assert equal(read_arrays(tmp_path / "a.npz", by="test", summed=True))


def zipped(path, **members: bytes):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                for k in range(0, len(content), 2**20):
                    file.write(content[k : k + 2**20])
    return path


READERS = {
    "frame": lambda path: read_frame(path.parent, path.stem),
    "cloud": read_cloud,
    "weights": read_state_dict,
    "plain": lambda path: read_arrays(path, by="test"),
}
NAMES = ("range", "intensity", "xyz")


@pytest.fixture(scope="module")
def bomb(tmp_path_factory):
    """Thrice 384 MiB of zeros in 1.2 MB."""
    content = header("(100663296,)") + bytes(4 * 100663296)
    return zipped(tmp_path_factory.mktemp("bomb") / "a.npz", **dict.fromkeys(NAMES, content))


@pytest.mark.parametrize("reader", READERS)
def test_a_zip_bomb_is_refused_before_it_is_unpacked(bomb, reader):
    assert bomb.stat().st_size < 2e6
    tracemalloc.start()
    begun = time.monotonic()
    with pytest.raises(ValueError, match=r"\d+ bytes that would unpack to \d+: not what it says it is"):
        READERS[reader](bomb)
    assert tracemalloc.get_traced_memory()[1] < 2**24
    assert time.monotonic() - begun < 10
    tracemalloc.stop()


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("shape", ["(1099511627776,)", "(2, 3)", "(-4,)", "(99999999999999999999, 99)"])
def test_a_header_that_promises_what_is_not_there_is_refused(tmp_path, reader, shape):
    path = zipped(tmp_path / "a.npz", **dict.fromkeys(NAMES, header(shape) + bytes(16)))
    with pytest.raises(ValueError, match=r"is no readable \.npz of plain arrays"):
        READERS[reader](path)


def test_objects_are_refused_and_run_nothing(tmp_path):
    np.savez(tmp_path / "a.npz", range=np.array([{1: 2}], object), intensity=np.zeros(1))
    with pytest.raises(ValueError, match="holds object, not numbers or text"):
        read_frame(tmp_path, "a")


def test_unknown_members_are_not_read(tmp_path):
    ones = np.ones((3, 5), np.float32)
    with io.BytesIO() as file:
        np.save(file, ones)
        good = file.getvalue()
    zipped(tmp_path / "a.npz", range=good, intensity=good, bomb=b"no array at all")
    image, more = read_frame(tmp_path, "a")
    assert image.valid.all()
    assert more == {}
    assert "bomb" in array_names(tmp_path / "a.npz", by="test")


def test_two_arrays_of_one_name_are_refused(tmp_path):
    content = header("(4,)") + bytes(16)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("a.npy", content)
    with pytest.raises(ValueError, match="two arrays of one name"):
        read_arrays(tmp_path / "a.npz", by="test")


@pytest.mark.parametrize("damage", [b"", b"PK", b"no zip", b"PK\x05\x06" + bytes(18), b"PK\x03\x04" + bytes(100)])
def test_what_is_no_archive_says_so(tmp_path, damage):
    (tmp_path / "a.npz").write_bytes(damage)
    with pytest.raises(ValueError, match=r"a\.npz"):
        read_frame(tmp_path, "a")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.full((2, 2), np.nan, np.float32), "holds NaN or infinite numbers"),
        (np.ones((2, 2), bool), "holds bool, not finite numbers"),
        (np.full((2, 2), "one"), "holds <U3, not finite numbers"),
    ],
)
def test_weights_that_are_none_are_refused(value, message):
    with pytest.raises(ValueError, match=message):
        checked_arrays({"w": value, ABOUT: np.array("{}")}, {"w": (2, 2)})


def test_headers_are_parsed_by_one_thread_at_a_time(tmp_path, monkeypatch):
    """Python 3.11's parser, which reads them, fails now and then where two are in it."""
    write_arrays(tmp_path / "a.npz", ARRAYS)
    inside, most = [], []
    real = npy.read_array

    def watched(*args, **kwargs):
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.01)
        inside.pop()
        return real(*args, **kwargs)

    monkeypatch.setattr(npy, "read_array", watched)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: read_arrays(tmp_path / "a.npz", by="test"), range(8)))
    assert all(map(equal, found))
    assert len(most) > 8
    assert max(most) == 1


def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    write_arrays(tmp_path / "a.npz", ARRAYS)

    def forbidden(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(zipfile, "ZipFile", forbidden)
    with pytest.raises(PermissionError, match="Permission denied"):
        read_arrays(tmp_path / "a.npz", by="frames")
