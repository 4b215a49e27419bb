"""A set of pairs that `jaxsim prepare` made, as a data set: the same positions and parts as the frames it was made of.

So an experiment that trains on frames trains on their pairs with `--data.kind prepared --data.root OUT`, and sees the
same batches.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any

from array_record.python.array_record_data_source import ArrayRecordDataSource

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.config.ranges import settings_of
from jaxsim.data.kitti_files import listing
from jaxsim.data.records import (
    ARRAYS,
    LABELS,
    Entry,
    PairRecord,
    PreparedPairs,
    check_pictured,
    pair_settings,
    record_of,
)
from jaxsim.data.tfds_builder import (
    FORMAT,
    MAKING,
    NAME,
    VERSION,
    About,
    check_features,
    check_metadata,
    features,
    flattened,
)
from jaxsim.files import differences, first_line, parse_settings, placed, read_json
from jaxsim.frame import Frame
from jaxsim.geometry import LidarSpec


class PreparedSet:
    """Pairs in the folder that `jaxsim prepare --out` wrote; it, or a folder below it, holds one set.

    `len` and positions are those of the frames that the set was made of; it need not hold them all. `splits` are its
    own `train` and `eval`, and the names that the data set of the frames has. Raises ValueError where there is no set,
    several, an unfinished one, or files that are not as long as they were written.

    The folder may be a stranger's. TFDS would import what its features.json names; here the file is compared with our
    own features, which read the records.
    """

    name = "prepared"

    def __init__(self, root: Path):
        self.folder = _folder(Path(root))
        check_features(self.folder)
        metadata = self.folder / "metadata.json"
        with placed(f"prepared: {metadata} does not fit this version; prepare the set again"):
            self.about = parse_settings(About, read_json(metadata, by="prepared"))
            check_metadata(self.about)
        self._check_files()
        splits = self.about.splits
        self._place = {p: (split, i) for split, part in splits.items() for i, p in enumerate(part.positions)}

    def __len__(self) -> int:
        return self.about.length

    @property
    def spec(self) -> LidarSpec:
        """The sensor that the pairs were made for."""
        return self.about.spec

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by part."""
        of_splits = {name: list(split.positions) for name, split in self.about.splits.items()}
        return {name: list(positions) for name, positions in self.about.parts.items()} | of_splits

    def __getitem__(self, index: int) -> Frame:
        raise ValueError(
            f"prepared: {self.folder} holds pairs, not the frames that they were made of; for what needs frames "
            f"(jaxsim simulate), name their data set: --data {self._kind} --root {self._root or 'ROOT'}"
        )

    def holds(self, position: int) -> bool:
        """Whether the pair at this position is in the set."""
        return position in self._place

    def name_of(self, index: int) -> str:
        """The frame's name, without reading its pair. Raises ValueError where the set does not hold it."""
        return self._entry(index).name

    def pairs(self, positions: Sequence[int], prepare: PrepareConfig) -> PreparedPairs:
        """The pairs at these positions.

        Raises ValueError where the set does not hold them, was made with other settings than `prepare`, has no labels
        or image that `prepare.inputs` needs, or nothing that a LiDAR measured; and, on reading, for a damaged record,
        and for one without image where the set does not tell.
        """
        self._check_settings(prepare)
        entries = [self._entry(p) for p in positions]
        places = [self._place[p] for p in positions]
        pictured = {split: part.pictured for split, part in self.about.splits.items()}
        for entry, (split, i) in zip(entries, places, strict=True):
            if pictured[split]:
                check_pictured(entry.name, prepare.inputs, has_image=pictured[split][i])

        def read(k: int) -> PairRecord:
            split, i = places[k]
            record = self._read(split, i)
            if not pictured[split]:
                check_pictured(record.name, prepare.inputs, has_image=record.has_image)
            return record

        return PreparedPairs(entries, read)

    @cached_property
    def _sources(self) -> dict[str, Any]:
        return {split: ArrayRecordDataSource([str(path) for path in self._paths(split)]) for split in self.about.splits}

    def _paths(self, split: str) -> list[Path]:
        """The files of a part, in the order of its records."""
        names = sorted(name for name in self.about.files if name.startswith(f"{NAME}-{split}.{FORMAT}-"))
        return [self.folder / name for name in names]

    @property
    def _kind(self) -> str:
        return self.about.settings["data"]["kind"]

    @property
    def _root(self) -> str | None:
        return self.about.settings["data"]["root"]

    def _entry(self, position: int) -> Entry:
        if position not in self._place:
            counts = ", ".join(f"{name}: {len(split.positions)}" for name, split in self.about.splits.items())
            raise ValueError(
                f"prepared: frame {position} of {self._kind} is not in {self.folder} ({counts} frames); choose frames "
                "that are (its parts are called train and eval), or prepare a set that holds it"
            )
        split, i = self._place[position]
        about = self.about.splits[split]
        name = about.names[i]
        key = f"{self.about.fingerprint}/{name}"
        if about.sources and about.sources[i]:  # of files that have changed it is another pair
            key += f".{about.sources[i]}"
        return Entry(name, about.scenes[i], about.windows[i], key)

    def _read(self, split: str, i: int) -> PairRecord:
        about = self.about.splits[split]
        try:
            values: Any = features().deserialize_example_np(self._sources[split][i])
            record = record_of(flattened(values))
            if (record.name, record.pair.target.shape) != (about.names[i], about.windows[i]):
                raise ValueError(f"it holds {record.name}, {' x '.join(map(str, record.pair.target.shape))} cells")
        except Exception as error:
            # ArrayRecord, protocol buffers and TFDS each have errors of their own for bytes that are not theirs.
            where = f"a file of {split} in {self.folder}"
            with suppress(RuntimeError):  # of a file that cannot even be opened
                file, number = self._file_of(split, i)
                where = f"{file}, record {number}"
            raise ValueError(
                f"prepared: {where} ({about.names[i]}) is damaged ({type(error).__name__}: {first_line(error)}); copy "
                f"the file again, or make the set anew: delete {self.folder} and run the same jaxsim prepare"
            ) from error
        return record

    def _file_of(self, split: str, i: int) -> tuple[Path, int]:
        """The file of a record, and its number there."""
        paths = self._paths(split)
        ends = list(accumulate(len(ArrayRecordDataSource([str(path)])) for path in paths))
        shard = bisect_right(ends, i)
        return paths[shard], i - (ends[shard - 1] if shard else 0)

    def _check_files(self) -> None:
        for split in self.about.splits:
            if not self._paths(split):
                raise ValueError(
                    f"prepared: {self.folder / 'metadata.json'} names no file of {split}; copy it again, or make "
                    "the set anew"
                )
        for name, size in self.about.files.items():
            path = self.folder / name
            now = path.stat().st_size if path.is_file() else None
            if now != size:
                what = "is not there" if now is None else f"has {now} bytes and was written with {size}"
                raise ValueError(f"prepared: {path} {what}; copy it again, or make the set anew")

    def _check_settings(self, prepare: PrepareConfig) -> None:
        plain = pair_settings(DataConfig(), PrepareConfig())["prepare"]  # settings that came later were so
        stored, wanted = plain | self.about.settings["prepare"], pair_settings(DataConfig(), prepare)["prepare"]
        free = {"inputs": None}  # labels: below
        for name in settings_of(PrepareConfig, "weights"):
            if getattr(prepare, name) is None:  # the network has done its work, with those that the set names
                free[name] = None
        other = [f"--{text}" for text in differences(stored | free, wanted | free, "prepare")]
        if other:
            raise ValueError(
                f"prepared: {self.folder} was made with other settings ({'; '.join(other)}); give those, or prepare "
                "another set"
            )
        needs = [name for name in prepare.inputs if name in LABELS]
        if needs and not self.about.labelled:
            raise ValueError(
                f"prepared: {self.folder} was made of frames without class labels, which the inputs "
                f"{' and '.join(needs)} need; leave them out of --prepare.inputs"
            )
        if not self.about.measured:
            raise ValueError(
                f"prepared: no LiDAR measured the frames of {self.folder}, so there is nothing to learn from them or "
                f"to judge by; they are the generator's inputs alone ({', '.join(list(ARRAYS)[:3])} ...)"
            )


def _folder(root: Path) -> Path:
    """The folder of the one set in or below `root`."""

    def below(name: str) -> list[Path]:
        return sorted(path for depth in range(4) for path in root.glob("*/" * depth + name))

    folders = [path.parent for path in below("dataset_info.json")]
    if len(folders) == 1:
        return folders[0]
    if folders:
        raise ValueError(f"prepared: {root} holds several sets; pass one of {', '.join(map(str, folders))}")
    begun = below(f"{VERSION}{MAKING}")
    if begun:
        raise ValueError(f"prepared: {begun[0]} is not finished; the jaxsim prepare that began it goes on with it")
    raise ValueError(
        f"prepared: no prepared set: {listing(root)}; pass the --out of jaxsim prepare (it makes one: "
        "jaxsim prepare kitti_step --root ROOT --out OUT)"
    )
