"""Prepared pairs as a TFDS data set of ArrayRecord files, made and read without TensorFlow.

    OUT/jaxsim_pairs/KIND/1.0.0/jaxsim_pairs-train.array_record-00000-of-00092    64 pairs each
                                jaxsim_pairs-eval.array_record-00000-of-00034
                                features.json, dataset_info.json                  TFDS' own
                                metadata.json                                     `About`

Any program with TFDS reads it: `tfds.data_source("jaxsim_pairs/kitti_step", split="train", data_dir=OUT)`.

It is a ShardBasedBuilder: each file's pairs are known beforehand, so that files can be made anywhere, one by one, and
are the same bytes whoever makes them. (A GeneratorBasedBuilder sorts by the keys' hashes, and cuts its files at other
places with Beam than without.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np
import tensorflow_datasets as tfds
from array_record.python.array_record_module import ArrayRecordWriter
from etils import epath
from google.protobuf import json_format
from pydantic import TypeAdapter
from tensorflow_datasets.core import example_serializer

from jaxsim.config import DataKind
from jaxsim.data.records import ARRAYS, Example
from jaxsim.files import check_name, read_json, replacing
from jaxsim.geometry import LidarSpec

NAME, VERSION = "jaxsim_pairs", "1.0.0"
"""The version is the format's: it changes where a record's arrays do. Which jaxsim made a set is in its metadata."""
FORMAT = "array_record"
MAKING = ".making"
"""Ends the name of a set's folder until the set is whole."""


@dataclass(frozen=True)
class SplitPairs:
    """One split's pairs, in the order of its records."""

    positions: tuple[int, ...]
    """Numbers of the frames in their data set."""
    names: tuple[str, ...]
    scenes: tuple[str, ...]
    windows: tuple[tuple[int, int], ...]
    """Laser lines and columns."""
    sources: tuple[str, ...] = ()
    """Stamps of what the pairs were made of; none in older sets. Only `jaxsim prepare` compares them with the files."""
    pictured: tuple[bool, ...] = ()
    """Whether the frames have an image; none in older sets, whose records tell it by their colours."""


@dataclass(frozen=True)
class About:
    """metadata.json: the data set, the settings and the version that a set was made with, and what is in it."""

    jaxsim: str
    """Version that made it."""
    settings: dict[str, dict[str, Any]]
    """`data` and `prepare`: all that the pairs depend on (`pair_settings`)."""
    fingerprint: str
    """Kind of data set, and a hash of the settings and of the code that made the pairs."""
    spec: LidarSpec
    length: int
    """Frames of the data set, of which some may be left out."""
    parts: dict[str, tuple[int, ...]]
    """Positions by the data set's own names of its parts."""
    splits: dict[str, SplitPairs]
    files: dict[str, int]
    """Bytes of every file of records."""
    measured: bool = True
    """Whether a LiDAR measured every frame: without, there is nothing to learn from it."""
    labelled: bool = True
    """Whether every frame has class labels."""


ABOUT_ADAPTER = TypeAdapter(About)


@dataclass(frozen=True)
class Shard:
    """One file of records to make."""

    split: str
    number: int
    of: int
    positions: tuple[int, ...]

    def file(self, folder: Path) -> Path:
        """The shard's file as TFDS names it."""
        return Path(_template(folder, self.split).sharded_filepath(shard_index=self.number, num_shards=self.of))


def shards_of(splits: Mapping[str, Sequence[int]], size: int) -> list[Shard]:
    """The files of a set: `size` pairs each, the last of a split what is left."""
    shards = []
    for split, positions in splits.items():
        pieces = [tuple(positions[i : i + size]) for i in range(0, len(positions), size)]
        shards += [Shard(split, number, len(pieces), piece) for number, piece in enumerate(pieces)]
    return shards


@cache
def features() -> tfds.features.FeaturesDict:
    """What TFDS calls the catalogue of a record. Raw bytes: ArrayRecord itself compresses them."""
    leaves: dict[str, Any] = {
        "name": tfds.features.Text(doc="of the frame, unique in its data set"),
        "scene": tfds.features.Text(doc="drive of the frame"),
        "position": tfds.features.Scalar(np.int64, doc="of the frame in its data set"),
    }
    for name, (dims, dtype, doc) in ARRAYS.items():
        shape = tuple(int(n) if n.isdigit() else None for n in dims.split())
        leaves[name] = tfds.features.Tensor(shape=shape, dtype=dtype, encoding="bytes", doc=doc)
    return tfds.features.FeaturesDict(nested(leaves))


def check_features(folder: Path) -> None:
    """Raises ValueError where a set's features.json is not that of our records.

    TFDS makes features of that file by importing the classes that it names, which may be anybody's: it is text here.
    """
    path = folder / "features.json"
    if not path.is_file():
        raise ValueError(f"prepared: no {path}; copy the whole set again")
    if read_json(path, by="prepared") != json_format.MessageToDict(features().to_proto()):
        raise ValueError(
            f"prepared: {path} does not describe the pairs of this version of jaxsim, so nothing of it is read; "
            "prepare the set again, and do not open it with TFDS where you do not know its maker: TFDS runs what the "
            "file names"
        )


def check_metadata(about: About) -> None:
    """Raises ValueError where metadata.json contradicts itself, or a name in it would leave a folder."""
    for split, split_info in about.splits.items():
        check_name(split, by="metadata.json")
        counts = {
            len(column) for column in (split_info.positions, split_info.names, split_info.scenes, split_info.windows)
        }
        counts |= {len(column) for column in (split_info.sources, split_info.pictured) if column}
        if len(counts) > 1:
            raise ValueError(f"the lists of {split} differ in length")
        if not all(0 <= position < about.length for position in split_info.positions):
            raise ValueError(f"{split} holds positions beyond 0..{about.length - 1}")
        for name in split_info.names:
            check_name(name, by="metadata.json")
        if len({*split_info.names}) < len(split_info.names):
            raise ValueError(f"{split} names a frame twice")
    for name in about.files:
        check_name(name, by="metadata.json")
    if not {"kind", "root"} <= {*about.settings.get("data", {})} or "prepare" not in about.settings:
        raise ValueError("its settings do not name the data set (kind, root) and how it was prepared")


def nested(flat: Example) -> Example:
    """`{"a/b": 1}` as `{"a": {"b": 1}}`."""
    out: Example = {}
    for name, value in flat.items():
        *folders, leaf = name.split("/")
        inner = out
        for folder in folders:
            inner = inner.setdefault(folder, {})
        inner[leaf] = value
    return out


def flattened(tree: Example) -> Example:
    """The other way round, texts decoded."""
    out: Example = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            out |= {f"{name}/{inner}": leaf for inner, leaf in flattened(value).items()}
        else:
            out[name] = value.decode() if isinstance(value, bytes) else value
    return out


def serialized(example: Example) -> bytes:
    """The record's bytes: the same for the same values, in every process."""
    layout: Any = features().get_serialized_info()
    proto = example_serializer.ExampleSerializer(layout).get_tf_example(features().encode_example(nested(example)))
    # A protocol buffer's map has no order of its own; TFDS writes it as it comes.
    return proto.SerializeToString(deterministic=True)


def write_records(path: Path, records: Iterable[bytes]) -> None:
    """One file of records, whole or not at all. Raises OSError where the disk does not take it."""
    with replacing(path) as part:
        writer = ArrayRecordWriter(str(part), "group_size:1")
        try:
            for record in records:
                _written(writer.write, record)
        finally:
            _written(writer.close)


def _written(write: Callable[..., None], *what: bytes) -> None:
    try:
        write(*what)
    except RuntimeError as error:  # what ArrayRecord makes of every error of the system
        raise OSError(
            f"prepared: a file of records cannot be written ({error}); make room, and the same command goes on"
        ) from error


class JaxsimPairs(tfds.core.ShardBasedBuilder, skip_registration=True):
    """Pairs of one kind of data set.

    `examples` makes the pairs at some positions; `download_and_prepare` then builds the set in TFDS' own way, file
    after file. `jaxsim prepare` makes the files in parallel and describes them by `write_metadata`.
    """

    name = NAME
    VERSION = tfds.core.Version(VERSION)
    BUILDER_CONFIGS: ClassVar[list[tfds.core.BuilderConfig]] = [
        tfds.core.BuilderConfig(name=kind, version=VERSION, description=f"frames of {kind}")
        for kind in get_args(DataKind)
        if kind != "prepared"
    ]
    url_infos = None  # nothing is downloaded; TFDS would look for a list of files, by a package it does not require

    def __init__(
        self,
        *,
        data_dir: Path,
        kind: str,
        shards: Sequence[Shard] = (),
        examples: Callable[[Sequence[int]], Iterator[Example]] | None = None,
        about: About | None = None,
    ):
        self.shards, self.about = list(shards), about
        self.examples = examples
        super().__init__(data_dir=data_dir, config=kind, file_format=FORMAT)

    def _info(self) -> tfds.core.DatasetInfo:
        return tfds.core.DatasetInfo(
            builder=self,
            description="Camera and LiDAR aligned on the LiDAR's polar grid: training pairs of jaxsim.",
            features=features(),
            disable_shuffling=True,
            metadata=tfds.core.MetadataDict(ABOUT_ADAPTER.dump_python(self.about, mode="json")) if self.about else None,
        )

    def _shard_iterators_per_split(
        self, dl_manager: Any
    ) -> dict[str, list[Callable[[], Iterator[tuple[int, Example]]]]]:
        splits: dict[str, list[Callable[[], Iterator[tuple[int, Example]]]]] = {}
        for shard in self.shards:
            splits.setdefault(shard.split, []).append(partial(self._keyed, shard.positions))
        return splits

    def _keyed(self, positions: Sequence[int]) -> Iterator[tuple[int, Example]]:
        if self.examples is None:
            raise ValueError(f"{NAME}: the builder was opened without `examples`, which makes the pairs")
        for position, example in zip(positions, self.examples(positions), strict=True):
            yield position, nested(example)

    def write_metadata(self, folder: Path) -> None:
        """Writes TFDS' description of the finished files in `folder`, and metadata.json."""
        infos = []
        for split in dict.fromkeys(shard.split for shard in self.shards):
            shards = [shard for shard in self.shards if shard.split == split]
            info = tfds.core.SplitInfo(
                name=split,
                shard_lengths=[len(shard.positions) for shard in shards],
                num_bytes=sum(shard.file(folder).stat().st_size for shard in shards),
                filename_template=_template(folder, split),
            )
            infos.append(info)
        info = self._info()
        info.set_file_format(FORMAT)
        info.set_splits(tfds.core.SplitDict(infos))
        info.write_to_directory(folder)


def _template(folder: Path, split: str) -> Any:
    return tfds.core.ShardedFileTemplate(
        data_dir=epath.Path(folder), dataset_name=NAME, split=split, filetype_suffix=FORMAT
    )
